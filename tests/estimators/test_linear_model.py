import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from linear_models import DIM, LAYOUT, MATRIX, NOISE_FACTOR, LinearProcess, LinearSensor

from spinfilters.estimators.estimator import Measurement
from spinfilters.estimators.multiplicative_ekf import MultiplicativeEkf
from spinfilters.estimators.multiplicative_filter import MultiplicativeFilter
from spinfilters.estimators.multiplicative_ukf import MultiplicativeUkf, SigmaPointOptions
from spinfilters.state.gaussian import Gaussian

STD = 0.3


def textbook(mean, covariance):
    kalman = KalmanFilter(dim_x=DIM, dim_z=4)
    kalman.x, kalman.P = mean.copy(), covariance.copy()
    kalman.H, kalman.R = MATRIX, STD**2 * NOISE_FACTOR @ NOISE_FACTOR.T
    return kalman


def filters(process):
    return [
        MultiplicativeEkf(process),
        MultiplicativeUkf(process),
        MultiplicativeUkf(process, SigmaPointOptions(1.0)),
    ]


@pytest.mark.parametrize("which", [0, 1, 2])
def test_a_linear_model_makes_every_filter_the_textbook_kalman_filter(which):
    generator = np.random.default_rng(which)
    process, sensor = LinearProcess(generator), LinearSensor(LAYOUT)
    root = generator.standard_normal((DIM, DIM)) + np.eye(DIM)
    mean, covariance = generator.standard_normal(DIM), root @ root.T
    ours, kalman = filters(process)[which], textbook(mean, covariance)
    ours.start(Gaussian.from_covariance(LAYOUT, mean, covariance))
    for _ in range(50):
        dt = float(generator.uniform(0.01, 0.5))
        ours.predict(dt)
        kalman.predict(F=process.matrix(dt), Q=dt * process.noise @ process.noise.T)
        z, offset = 3 * generator.standard_normal(4), float(generator.standard_normal())
        report = ours.update(Measurement(sensor, z[None], np.array([[offset, STD]])))
        kalman.update(z - np.array([0, 0, 0, offset]))
        innovation = kalman.y
        assert report.nis == pytest.approx(innovation @ np.linalg.solve(kalman.S, innovation), rel=1e-9)
        assert report.log_likelihood == pytest.approx(kalman.log_likelihood, rel=1e-9)
    belief = ours.belief
    scale = np.abs(kalman.P).max()
    np.testing.assert_allclose(belief.mean, kalman.x, rtol=0, atol=1e-10 * max(1.0, np.abs(kalman.x).max()))
    np.testing.assert_allclose(belief.covariance, kalman.P, rtol=0, atol=1e-10 * scale)


def test_two_measurements_at_once_equal_one_after_the_other():
    generator = np.random.default_rng(5)
    process, sensor = LinearProcess(generator), LinearSensor(LAYOUT)
    belief = Gaussian.from_covariance(LAYOUT, np.zeros(DIM), np.eye(DIM))
    values, parameters = generator.standard_normal((2, 4)), np.array([[0.1, 0.2], [-0.3, 0.7]])
    together, apart = MultiplicativeEkf(process), MultiplicativeEkf(process)
    together.start(belief)
    apart.start(belief)
    together.update(Measurement(sensor, values, parameters))
    for row in (1, 0):
        apart.update(Measurement(sensor, values[row : row + 1], parameters[row : row + 1]))
    np.testing.assert_allclose(together.belief.mean, apart.belief.mean, atol=1e-12)
    np.testing.assert_allclose(together.belief.covariance, apart.belief.covariance, atol=1e-12)
