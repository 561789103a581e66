"""What every filter does: no error from exact data, honest counts of what it leaves out, a status when it breaks."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.filters.baselines import FilterpyEkf, FilterpyUkf
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Estimator, Measurement, ProcessModel
from spinfilters.filters.measurement_prediction import SigmaPointOptions
from spinfilters.filters.outlier_rejection import RobustOptions
from spinfilters.filters.timeline import Epoch, run
from spinfilters.filters.ukf import MultiplicativeUkf
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensors.gyro import Gyro, gyro_parameters
from spinfilters.models.state_layout import ROTATION_BLOCKS, Gaussian, StateLayout
from tests.filters.filter_samples import FULL, PROCESS, START, embedded, run_on, started
from tests.filters.linear_samples import LinearProcess, linear_belief, linear_process, linear_sensor

ROTATION = StateLayout(ROTATION_BLOCKS)
OURS = (MultiplicativeEkf, MultiplicativeUkf)
ALL = (*OURS, FilterpyEkf, FilterpyUkf)
Build = Callable[[ProcessModel], Estimator]


@pytest.mark.parametrize(
    ("build", "std"), [(MultiplicativeEkf, 0.05), (MultiplicativeEkf, 1e-6), (MultiplicativeUkf, 1e-6)]
)
def test_exact_data_and_a_true_start_give_no_error(build: Build, std: float) -> None:
    """Of any start for the EKF; a UKF's mean also feels the width of its belief, so that must be narrow."""
    process = TorqueFreeProcess(FULL, ProcessNoise(0.0, 0.0), tolerance=1e-12)
    epoch = embedded(0).timeline[START.epochs].measurements[0]
    x = embedded(0).truth[0]
    estimator = build(process)
    estimator.start(Gaussian(FULL, x, std * np.eye(20)))
    for _ in range(20):
        estimator.predict(0.5)
        x = process.step(x, 0.5)
        exact = epoch.model.predict(x, epoch.parameters)
        assert estimator.update(replace(epoch, values=exact)).nis < 1e-8
        np.testing.assert_allclose(FULL.local(estimator.belief.mean, x), 0.0, atol=1e-9)


@pytest.mark.parametrize(("build", "steps"), [(MultiplicativeEkf, 2000), (MultiplicativeUkf, 800)])
def test_the_covariance_stays_symmetric_and_positive_over_a_long_run(build: Build, steps: int) -> None:
    generator, process = np.random.default_rng(1), TorqueFreeProcess(ROTATION, ProcessNoise())
    x = ROTATION.retract(ROTATION.origin(), 0.5 * generator.standard_normal(11))
    gyro, parameters = Gyro(ROTATION), gyro_parameters(1, 1e-4, 0.0)
    estimator = build(process)
    estimator.start(Gaussian(ROTATION, x, 0.1 * np.eye(11)))
    for step in range(steps):
        estimator.predict(0.05)
        x = process.step(x, 0.05)
        noise = 1e-4 * generator.standard_normal((1, 3))
        estimator.update(Measurement(gyro, x[np.newaxis, ROTATION.mean_slice("w")] + noise, parameters))
        if step % 50 == 0:
            P, std = estimator.belief.covariance, estimator.belief.std
            np.testing.assert_allclose(P, P.T, atol=0, rtol=1e-13)
            assert np.linalg.eigvalsh(P / np.outer(std, std))[0] > -1e-13
    assert np.isfinite(estimator.belief.mean).all()


@pytest.mark.parametrize("build", ALL)
def test_values_that_cannot_be_used_are_counted_and_change_nothing(build: Build) -> None:
    good = embedded(0).timeline[START.epochs].measurements[0]
    behind, damaged = good.parameters[:3].copy(), good.values[:2].copy()
    behind[:, :3] = [0.0, 0.0, -5.0]
    damaged[:, 1] = [np.nan, np.inf]
    mixed = Measurement(
        good.model,
        np.concatenate([good.values, good.values[:3], damaged]),
        np.concatenate([good.parameters, behind, good.parameters[:2]]),
    )
    clean, dirty = build(PROCESS), build(PROCESS)
    for estimator in (clean, dirty):
        estimator.start(started(0).belief)
        estimator.predict(0.5)
    wanted, report = clean.update(good), dirty.update(mixed)
    assert (report.accepted, report.rejected) == (len(good.values), 5)
    assert report.dof == wanted.dof
    assert report.nis == pytest.approx(wanted.nis, rel=1e-9)
    assert report.log_likelihood == pytest.approx(wanted.log_likelihood, rel=1e-9)
    shift = FULL.local(clean.belief.mean, dirty.belief.mean) / clean.belief.std
    np.testing.assert_allclose(shift, 0.0, atol=1e-6)
    np.testing.assert_allclose(dirty.belief.std, clean.belief.std, rtol=1e-6)


@pytest.mark.parametrize("build", ALL)
@pytest.mark.parametrize("count", [0, 4])
def test_a_measurement_without_any_usable_value_leaves_the_belief_as_it_is(build: Build, count: int) -> None:
    good = embedded(0).timeline[START.epochs].measurements[0]
    estimator = build(PROCESS)
    estimator.start(started(0).belief)
    before = estimator.belief
    unusable = replace(good, values=np.full((count, 3), np.nan), parameters=good.parameters[:count])
    report = estimator.update(unusable)
    assert (report.accepted, report.rejected, report.dof, report.nis) == (0, count, 0, 0.0)
    np.testing.assert_array_equal(estimator.belief.mean, before.mean)
    np.testing.assert_array_equal(estimator.belief.factor, before.factor)


@pytest.mark.parametrize("build", ALL)
def test_a_run_that_breaks_ends_as_failed_and_keeps_only_what_is_finite(build: Build) -> None:
    generator = np.random.default_rng(3)
    calm, sensor = linear_process(generator), linear_sensor(2, generator)
    exploding = LinearProcess(1e80 * calm.A, calm.noise)
    epochs = tuple(Epoch(0.1 * k, (sensor.measurement(np.zeros((1, 2))),)) for k in range(1, 12))
    estimator = build(exploding)
    estimator.start(linear_belief(generator))
    with np.errstate(all="ignore"):
        history = run(estimator, 0.0, epochs)
    assert history.has_failed
    assert "epoch" in history.status.reasons[0]
    assert len(history.time) < len(epochs)
    assert len(history.mean) == len(history.factor) == len(history.time)
    assert np.isfinite(history.mean).all()
    assert np.isfinite(history.factor).all()


def test_ekf_and_ukf_agree_closely_on_the_known_map_example() -> None:
    """Both describe the same belief where it is narrow: their difference is a small share of its width."""
    for seed in range(3):
        ekf, ukf = run_on(MultiplicativeEkf(PROCESS), seed), run_on(MultiplicativeUkf(PROCESS), seed)
        assert np.abs(FULL.local(ekf.mean, ukf.mean) / ekf.std).max() < 0.05
        np.testing.assert_allclose(ukf.std, ekf.std, rtol=0.02)
        np.testing.assert_allclose(ukf.nis, ekf.nis, rtol=1e-3)


@pytest.mark.parametrize("build", ALL)
def test_a_belief_over_other_blocks_is_refused(build: Build) -> None:
    with pytest.raises(InputError, match="blocks"):
        build(PROCESS).start(Gaussian(ROTATION, ROTATION.origin(), np.eye(11)))


def test_sigma_points_with_a_negative_covariance_weight_are_refused() -> None:
    with pytest.raises(InputError, match="alpha"):
        MultiplicativeUkf(PROCESS, SigmaPointOptions(alpha=0.5))


@pytest.mark.parametrize(
    "options", [SigmaPointOptions(), SigmaPointOptions(1.0), SigmaPointOptions(0.8, 2.0, 3.0)]
)
def test_the_ukf_is_exact_for_a_linear_model_with_any_set_of_points(options: SigmaPointOptions) -> None:
    generator = np.random.default_rng(6)
    process, belief = linear_process(generator), linear_belief(generator)
    sensor = linear_sensor(3, generator)
    ekf, ukf = MultiplicativeEkf(process), MultiplicativeUkf(process, options)
    for estimator in (ekf, ukf):
        estimator.start(belief)
        estimator.predict(0.1)
        estimator.update(sensor.measurement(np.ones((2, 3))))
    np.testing.assert_allclose(ukf.belief.mean, ekf.belief.mean, atol=1e-12)
    np.testing.assert_allclose(ukf.belief.covariance, ekf.belief.covariance, atol=1e-12)


def test_a_ukf_update_is_that_of_its_sigma_points_one_by_one() -> None:
    """The reference forms every point's measurement, P_zz and P_xz as sums over all 41 points."""
    belief, epoch = started(0).belief, embedded(0).timeline[START.epochs]
    model, values, parameters = (getattr(epoch.measurements[0], k) for k in ("model", "values", "parameters"))
    ukf = MultiplicativeUkf(PROCESS, robust=RobustOptions(gate_probability=1.0))
    wide = Gaussian(FULL, belief.mean, 20 * belief.factor)
    ukf.start(wide)
    report = ukf.update(Measurement(model, values[:30], parameters[:30]))
    n, alpha, beta = 20, SigmaPointOptions().alpha, SigmaPointOptions().beta
    spread = alpha**2 * n
    offsets = np.sqrt(spread) * np.concatenate([np.zeros((1, n)), np.eye(n), -np.eye(n)]) @ wide.factor.T
    Wm = np.full(41, 0.5 / spread)
    Wc = Wm.copy()
    Wm[0] = (spread - n) / spread
    Wc[0] = Wm[0] + 1 - alpha**2 + beta
    whitening = model.whitening(wide.mean, parameters[:30])
    seen = np.array(
        [
            np.einsum("kij,kj->ki", whitening, model.innovations(x, parameters[:30], values[:30])[0]).reshape(
                -1
            )
            for x in FULL.retract(wide.mean, offsets)
        ]
    )
    rho = Wm @ seen
    S = (Wc[:, None] * (seen - rho)).T @ (seen - rho) + np.eye(90)
    gain = np.linalg.solve(S, (Wc[:, None] * (rho - seen)).T @ offsets).T
    assert report.nis == pytest.approx(rho @ np.linalg.solve(S, rho), rel=1e-9)
    error = FULL.local(wide.mean, ukf.belief.mean) / wide.std
    np.testing.assert_allclose(error, gain @ rho / wide.std, atol=1e-9)
    reset = FULL.reset_jacobian(gain @ rho)
    P = reset @ (wide.covariance - gain @ S @ gain.T) @ reset.T
    np.testing.assert_allclose(
        ukf.belief.covariance / np.outer(wide.std, wide.std), P / np.outer(wide.std, wide.std), atol=1e-9
    )
