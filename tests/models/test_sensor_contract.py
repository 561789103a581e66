"""Every sensor keeps the contract, over every layout it is used with, and the check notices one that does not."""

import casadi as ca
import numpy as np
import pytest
from jaxtyping import Float

from spinfilters.core.attitude_expressions import Expression
from spinfilters.core.cameras import NEAREST_DEPTH
from spinfilters.models.camera_landmarks import StereoLandmark, camera_parameters
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.sensor_noise import CorrelatedNoise, IsotropicNoise, NoiseLevel, SensorNoiseModel
from spinfilters.models.sensors.gyro import Gyro, gyro_parameters
from spinfilters.models.sensors.pose import Pose, pose_parameters
from spinfilters.models.state_blocks import GYRO_BIAS
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout
from tests.models.sensor_contract import check_sensor_contract

FULL = StateLayout(FULL_BLOCKS)
WITH_DRAG = StateLayout((*FULL_BLOCKS, "d"))
ROTATION = StateLayout(ROTATION_BLOCKS)
WITH_BIAS = ROTATION.joined(GYRO_BIAS)
POSE_ONLY = StateLayout(("t", "a"))
CALIBRATION = np.array([466.7, 470.0, 320.0, 240.0, 0.09])


def _point(layout: StateLayout, seed: int = 0) -> Float[np.ndarray, " m"]:
    """Anywhere, but with the origin of g 0.6 m before the camera."""
    x = layout.retract(layout.origin(), 0.3 * np.random.default_rng(seed).standard_normal(layout.error_dim))
    if "t" in layout.blocks:
        x[layout.mean_slice("t")] = [0.02, -0.03, 0.6]
    return x


def _random_parameters(model: MeasurementModel, count: int = 5) -> Float[np.ndarray, "count p"]:
    generator = np.random.default_rng(1)
    if isinstance(model, Gyro):
        return gyro_parameters(count, _level(model.noise, 0.01), 0.05)
    if isinstance(model, Pose):
        roots = 0.01 * generator.standard_normal((count, 6, 6))
        return pose_parameters(roots @ np.swapaxes(roots, 1, 2) + 1e-5 * np.eye(6))
    assert isinstance(model, StereoLandmark)
    points = 0.1 * generator.uniform(-1, 1, (count, 3))
    return camera_parameters(points, CALIBRATION, _level(model.noise, 0.8, count))


def _level(noise: SensorNoiseModel, std: float, count: int = 5) -> NoiseLevel:
    """One deviation, or covariances with correlations about it."""
    if isinstance(noise, IsotropicNoise):
        return std
    roots = std * (np.eye(3) + 0.3 * np.random.default_rng(2).standard_normal((count, 3, 3)))
    return roots @ np.swapaxes(roots, 1, 2)


@pytest.mark.parametrize(
    "model",
    [
        *[Gyro(layout) for layout in (ROTATION, FULL, WITH_DRAG, WITH_BIAS)],
        *[Pose(layout) for layout in (POSE_ONLY, FULL, WITH_DRAG)],
        *[StereoLandmark(layout) for layout in (POSE_ONLY, FULL, WITH_DRAG)],
        Gyro(ROTATION, CorrelatedNoise(3)),
        StereoLandmark(POSE_ONLY, CorrelatedNoise(3)),
    ],
    ids=lambda model: f"{model.name}-{''.join(model.layout.blocks)}-{model.parameter_dim}",
)
@pytest.mark.parametrize("seed", [0, 1])
def test_every_sensor_keeps_the_contract(model: MeasurementModel, seed: int) -> None:
    check_sensor_contract(model, _point(model.layout, seed), _random_parameters(model))


def test_whitened_noise_of_a_covariance_has_unit_covariance() -> None:
    covariance = np.array([[[4e-4, 1e-4, 0.0], [1e-4, 9e-4, -2e-4], [0.0, -2e-4, 1e-4]]])
    model, x = Gyro(ROTATION, CorrelatedNoise(3)), _point(ROTATION)
    w = x[ROTATION.mean_slice("w")]
    W = model.whitening(x, gyro_parameters(1, covariance, 0.1))[0]
    assert np.allclose(W @ (covariance[0] + 0.01 * (w @ w) * np.eye(3)) @ W.T, np.eye(3), atol=1e-12)


def test_a_covariance_tells_how_sure_a_disparity_is() -> None:
    """u_left and u_right that err together leave the depth of a far point known."""
    model = StereoLandmark(POSE_ONLY, CorrelatedNoise(3))
    pixels = np.array([[330.0, 240.0, 326.0]])
    for correlation, known in ((0.0, False), (0.99, True)):
        noise = np.eye(3)
        noise[0, 2] = noise[2, 0] = correlation
        parameters = camera_parameters(np.zeros((1, 3)), CALIBRATION, noise[None])
        assert model.new_landmarks(POSE_ONLY.origin(), parameters, pixels).determined[0] == known


class _ForgetsItsNeeds(Pose):
    """Says that it depends on the position alone."""

    needs = ("t",)


class _Biased(Gyro):
    """Is not zero where the measurement is exact."""

    def innovation(self, expected: Expression, measured: Expression) -> Expression:
        return measured - expected + 1e-6


class _JumpsWithTheState(Gyro):
    """Has no derivative at the point."""

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        return state["w"] + ca.floor(1e7 * state["w"]) / 1e3


@pytest.mark.parametrize("broken", [_ForgetsItsNeeds(FULL), _Biased(FULL), _JumpsWithTheState(FULL)])
def test_the_contract_notices_a_broken_sensor(broken: MeasurementModel) -> None:
    with pytest.raises(AssertionError):
        check_sensor_contract(broken, _point(FULL), _random_parameters(broken))


@pytest.mark.parametrize(
    ("depth", "valid"), [(0.5, True), (2 * NEAREST_DEPTH, True), (0.0, False), (-1e-12, False), (-0.5, False)]
)
def test_a_landmark_at_or_behind_the_camera_is_not_valid_and_stays_finite(depth: float, valid: bool) -> None:
    model, x = StereoLandmark(POSE_ONLY), POSE_ONLY.origin()
    parameters = camera_parameters(np.array([[0.1, 0.2, depth]]), CALIBRATION, 1.0)
    about = model.linearise(x, parameters, np.zeros((1, 3)))
    assert about.valid[0] == valid
    assert np.isfinite(about.innovation).all()
    assert np.isfinite(about.jacobian).all()


def test_stereo_pixels_are_those_of_the_pinhole_pair() -> None:
    model, x = StereoLandmark(POSE_ONLY), POSE_ONLY.origin()
    pixels = model.predict(x, camera_parameters(np.array([[0.1, -0.2, 0.5]]), CALIBRATION, 1.0))
    expected = [466.7 * 0.2 + 320.0, -470.0 * 0.4 + 240.0, 466.7 * (0.1 - 0.09) / 0.5 + 320.0]
    np.testing.assert_allclose(pixels[0], expected, rtol=1e-14)


def test_a_gyro_has_more_noise_the_faster_it_turns() -> None:
    model, x = Gyro(ROTATION), ROTATION.origin()
    x[ROTATION.mean_slice("w")] = [3.0, 0.0, 4.0]
    whitening = model.whitening(x, gyro_parameters(1, 0.3, 0.08))[0]
    np.testing.assert_allclose(whitening, np.eye(3) / np.hypot(0.3, 0.08 * 5.0), rtol=1e-14)


def test_a_pose_turned_further_than_half_a_revolution_is_seen_the_short_way_round() -> None:
    model, x = Pose(POSE_ONLY), POSE_ONLY.origin()
    parameters = pose_parameters(np.eye(6)[np.newaxis])
    measured = np.concatenate([np.zeros(3), [np.sin(1.8), 0.0, 0.0, np.cos(1.8)]])[np.newaxis]
    turned = model.innovations(x, parameters, measured)[0]
    np.testing.assert_array_equal(turned, model.innovations(x, parameters, -measured)[0])
    np.testing.assert_allclose(turned[0, 3:], [4 * np.tan((3.6 - 2 * np.pi) / 4), 0.0, 0.0], atol=1e-12)
