"""The rate stays on the invariable plane, the cones roll on one another, and the herpolhode advances as the motion does."""

import math

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.core.rolling_motion import cones, rolling_motion

TRIAXIAL = np.array([1.3, 1.0, 0.5])
PRINTED = np.array([3.0, 1.0, 1.0 / 3.0])


@pytest.mark.parametrize("moments", [TRIAXIAL, PRINTED, np.array([1.0, 1.0, 1.7])])
@pytest.mark.parametrize("rate", [[0.0, 2.0, 1e-3], [2.0, 1.0, 1.0], [0.0, 0.5, 2.0]])
def test_the_rate_touches_the_invariable_plane_at_all_times(moments: np.ndarray, rate: list[float]) -> None:
    motion = rolling_motion(moments, np.array(rate))
    np.testing.assert_allclose(motion.space_rate[:, 2], motion.plane_distance, rtol=1e-10)
    momentum = np.einsum("nij,nj->ni", motion.axes, moments * motion.body_rate)
    np.testing.assert_allclose(momentum[:, :2], 0.0, atol=1e-10 * np.abs(momentum).max())


def test_after_a_period_the_body_is_turned_about_its_momentum_by_the_advance() -> None:
    rate = np.array([0.4, 1.2, 0.8])
    period = rolling_motion(TRIAXIAL, rate).period
    motion = rolling_motion(TRIAXIAL, rate, duration=period)
    first, last = motion.axes[0], motion.axes[-1]
    c, s = math.cos(motion.advance), math.sin(motion.advance)
    np.testing.assert_allclose(last, np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ first, atol=1e-10)
    low, high = motion.herpolhode_radii
    assert 0.0 < low < high


@pytest.mark.parametrize(
    ("moments", "sense"), [([1.0, 1.0, 1.7], "retrograde"), ([1.0, 1.0, 0.4], "prograde")]
)
def test_cones_of_a_symmetric_body_are_those_of_its_motion(moments: list[float], sense: str) -> None:
    J, w = np.array(moments), np.array([0.3, 0.2, 1.1])
    found = cones(J, w)
    assert found is not None
    motion = rolling_motion(J, w)
    assert found.sense == sense
    axis, rate = motion.axes[:, :, 2], motion.space_rate
    speed = np.linalg.norm(rate, axis=-1)
    np.testing.assert_allclose(np.arccos(axis[:, 2]), found.nutation_angle, rtol=1e-9)
    np.testing.assert_allclose(np.arccos(rate[:, 2] / speed), found.space_half_angle, rtol=1e-7)
    np.testing.assert_allclose(
        np.arccos(np.sum(axis * rate, axis=-1) / speed), found.body_half_angle, rtol=1e-9
    )
    azimuth = np.unwrap(np.arctan2(axis[:, 1], axis[:, 0]))
    slope = (azimuth[-1] - azimuth[0]) / (motion.time[-1] - motion.time[0])
    assert slope == pytest.approx(found.precession_rate, rel=1e-9)
    # w = precession about h + spin about the axis
    parts = found.precession_rate * np.array([0, 0, 1]) + found.spin_rate * axis
    np.testing.assert_allclose(parts, rate, atol=1e-9)


def test_bodies_without_one_axis_of_symmetry_have_no_circular_cones() -> None:
    assert cones(TRIAXIAL, np.array([0.1, 0.2, 0.3])) is None
    assert cones(np.ones(3), np.array([0.1, 0.2, 0.3])) is None
    across = cones(np.array([1.0, 1.0, 0.5]), np.array([0.1, 0.2, 0.0]))
    assert across is not None
    assert across.sense == "none"


def test_a_spin_about_an_axis_stays_a_point() -> None:
    motion = rolling_motion(TRIAXIAL, np.array([0.0, 0.0, 2.0]))
    assert motion.herpolhode_radii == pytest.approx((0.0, 0.0), abs=1e-14)
    assert math.isinf(motion.period)
    assert math.isnan(motion.advance)


def test_rest_and_endless_durations_are_refused() -> None:
    with pytest.raises(InputError, match="at rest"):
        rolling_motion(TRIAXIAL, np.zeros(3))
    with pytest.raises(InputError, match="at rest"):
        cones(TRIAXIAL, np.zeros(3))
    with pytest.raises(InputError, match="duration"):
        rolling_motion(TRIAXIAL, np.array([0.1, 0.2, 2.0]), duration=1e9)
    with pytest.raises(InputError, match="Jyy"):
        rolling_motion(np.array([1.0, 0.0, 2.0]), np.array([0.1, 0.2, 2.0]))
