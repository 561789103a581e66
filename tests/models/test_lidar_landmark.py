"""The lidar's landmark keeps the contract of sensors, and its noise is that of a range, an azimuth and an elevation."""

import casadi as ca
import numpy as np
import pytest

from spinfilters.models.sensors.lidar_points import NEAREST_RANGE, LidarLandmark
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from tests.models.sensor_contract import check_sensor_contract

FULL, POSE_ONLY = StateLayout(FULL_BLOCKS), StateLayout(("t", "a"))
RANGE_STD, ANGLE_STD = 0.01, 0.002


def _parameters(points: np.ndarray) -> np.ndarray:
    """Of points (frame g, m) for a lidar with these deviations."""
    return np.concatenate([points, np.tile([RANGE_STD, ANGLE_STD], (len(points), 1))], axis=1)


def _point(layout: StateLayout, seed: int) -> np.ndarray:
    x = layout.retract(layout.origin(), 0.3 * np.random.default_rng(seed).standard_normal(layout.error_dim))
    x[layout.mean_slice("t")] = [0.02, -0.03, 0.6]
    return x


@pytest.mark.parametrize(
    "layout", [FULL, StateLayout((*FULL_BLOCKS, "d")), POSE_ONLY], ids=lambda layout: "".join(layout.blocks)
)
@pytest.mark.parametrize("seed", [0, 1])
def test_a_lidar_keeps_the_contract(layout: StateLayout, seed: int) -> None:
    points = 0.1 * np.random.default_rng(2).uniform(-1, 1, (5, 3))
    check_sensor_contract(LidarLandmark(layout), _point(layout, seed), _parameters(points))


@pytest.mark.parametrize("azimuth", [-2.0, 0.0, 0.7, 3.1])
@pytest.mark.parametrize("elevation", [-1.2, 0.0, 0.4])
def test_its_noise_is_that_of_range_azimuth_and_elevation(azimuth: float, elevation: float) -> None:
    """Covariance of the point by derivatives of r (cos e cos a, cos e sin a, sin e)."""
    r, a, e = (ca.SX.sym(name) for name in ("r", "a", "e"))
    point = r * ca.vertcat(ca.cos(e) * ca.cos(a), ca.cos(e) * ca.sin(a), ca.sin(e))
    at = ca.Function("at", [r, a, e], [point, ca.jacobian(point, ca.vertcat(r, a, e))])
    z, slopes = (np.asarray(value) for value in at(0.6, azimuth, elevation))
    std = np.diag(
        [RANGE_STD, ANGLE_STD / np.cos(elevation), ANGLE_STD]
    )  # an arc along a parallel is cos(e) da
    model = LidarLandmark(POSE_ONLY)
    factor = np.asarray(
        ca.DM(
            model.noise_factor(
                POSE_ONLY.unpack(ca.DM(POSE_ONLY.origin())),
                ca.DM(_parameters(z.T)[0]),
            )
        )
    )
    np.testing.assert_allclose(factor @ factor.T, slopes @ std**2 @ slopes.T, atol=1e-16)


@pytest.mark.parametrize(
    ("distance", "valid"), [(0.5, True), (2 * NEAREST_RANGE, True), (0.0, False), (-0.5, True)]
)
def test_a_point_at_the_lidar_is_not_valid_one_behind_it_is_and_both_stay_finite(
    distance: float, valid: bool
) -> None:
    parameters = _parameters(np.array([[0.0, 0.0, distance]]))
    about = LidarLandmark(POSE_ONLY).linearise(POSE_ONLY.origin(), parameters, np.zeros((1, 3)))
    assert about.valid[0] == valid
    assert np.isfinite(about.jacobian).all()
