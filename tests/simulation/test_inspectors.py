"""Simulated inspectors: paths that begin as frame i, and what can be wrong with the poses that are told of them."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import angle_between, inverse, rotate
from spinfilters.core.errors import InputError
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.simulation.inspector import AXIS, BAND, INSPECTORS, STATIC, told_trajectory
from spinfilters.simulation.scenario import Scenario, inspector_of, simulate

MOVING = tuple(name for name in INSPECTORS if name != STATIC)
SHORT = Scenario.simplified(epochs=12, landmarks=60, inspector="sway", seed=3)
TIME = 0.25 * np.arange(400)


def told(**changes: object) -> MeasurementStream:
    """Poses of the inspector that a data set tells."""
    inspector = simulate(replace(SHORT, **changes)).inspector  # pyright: ignore[reportArgumentType]
    assert inspector is not None
    return inspector


def path(name: str) -> np.ndarray:
    """Poses at `TIME`."""
    make = INSPECTORS[name]
    assert make is not None
    return make(np.array([0.0, 0.0, 0.6]), 3)(TIME)


@pytest.mark.parametrize("name", MOVING)
def test_an_inspector_begins_as_frame_i_and_goes_on_without_jumps(name: str) -> None:
    poses = path(name)
    np.testing.assert_allclose(poses[0], [0, 0, 0, 0, 0, 0, 1], atol=1e-12)
    assert np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1).max() < 0.02
    assert angle_between(poses[:-1, 3:], poses[1:, 3:]).max() < 0.03


def test_a_dead_band_holds_the_inspector_and_its_arcs_are_parabolas() -> None:
    poses = path("dead-band")
    (place,), (turn,) = BAND
    assert np.ptp(poses[:, :3], axis=0).max() < 4 * place  # of a frame that stands anywhere within it
    assert angle_between(poses[:1, 3:], poses[:, 3:]).max() < 4 * turn
    bends = np.diff(poses[:, 0], n=3)
    assert (np.abs(bends) < 1e-6).mean() > 0.5  # third differences vanish but at the pulses


def test_the_same_seed_flies_the_same_dead_band() -> None:
    np.testing.assert_array_equal(path("dead-band"), path("dead-band"))


def test_late_poses_are_those_of_a_moment_before() -> None:
    right, late = told(), told(inspector_errors=(("late", 0.5),))
    np.testing.assert_allclose(late.values[1:], right.values[:-1], atol=1e-12)


@pytest.mark.parametrize(("name", "columns"), [("drifting", slice(0, 3)), ("turning", slice(3, 6))])
def test_a_drift_has_its_size_over_the_recording(name: str, columns: slice) -> None:
    right, wrong = told(), told(inspector_errors=((name, 0.02),))
    if name == "drifting":
        np.testing.assert_allclose(wrong.values[-1, columns] - right.values[-1, columns], 0.02 * AXIS)
    else:
        assert angle_between(right.values[-1, 3:], wrong.values[-1, 3:]) == pytest.approx(0.02)
    np.testing.assert_allclose(wrong.values[0], right.values[0], atol=1e-12)


def test_a_lever_arm_turns_with_the_camera() -> None:
    right, wrong = told(), told(inspector_errors=(("lever", 0.05),))
    away = rotate(inverse(right.values[:, 3:]), wrong.values[:, :3] - right.values[:, :3])
    np.testing.assert_allclose(away, np.tile(0.05 * AXIS, (len(away), 1)), atol=1e-12)


def test_sparse_poses_cover_the_recording() -> None:
    sparse = told(inspector_errors=(("sparse", 4.0),))
    np.testing.assert_allclose(sparse.time, [0.0, 4.0, 8.0])


def test_sparse_poses_cover_a_recording_whose_length_is_a_multiple_but_for_rounding() -> None:
    make, time = INSPECTORS["sway"], np.round(0.3 * np.arange(198), 9)
    assert make is not None
    trajectory = told_trajectory(make(np.array([0.0, 0.0, 0.6]), 3), time, {"sparse": 0.3})
    assert trajectory is not None
    trajectory.require_cover(time)


def test_a_missing_trajectory_is_of_an_inspector_that_moved() -> None:
    scenario = replace(SHORT, inspector_errors=(("missing", 0.0),))
    missing, there = simulate(scenario), simulate(SHORT)
    assert missing.inspector is None
    np.testing.assert_array_equal(missing.log.streams[0].values, there.log.streams[0].values)
    assert inspector_of(scenario, TIME) is not None


def test_right_poses_are_stated_to_be_exact_and_wrong_ones_are_not() -> None:
    right = simulate(SHORT).options.calibration
    wrong = simulate(replace(SHORT, inspector_errors=(("late", 0.1),))).options.calibration
    assert right["inspector_clock_std"] == 0.0
    assert "inspector_clock_std" not in wrong
    assert "inspector_clock_std" not in simulate(replace(SHORT, inspector=STATIC)).options.calibration


@pytest.mark.parametrize(
    ("errors", "inspector", "says"),
    [
        ((("slow", 1.0),), "sway", "use one of late, turning, drifting, lever, sparse, missing"),
        ((("late", 0.0),), "sway", "give a size of 1e-06 to 10"),
        ((("sparse", 1e-9),), "sway", "give a size of 0.001 to 1e.04"),
        ((("drifting", float("nan")),), "sway", "give a size of"),
        ((("late", 0.1),), STATIC, "choose one: circle, sway, dead-band"),
    ],
)
def test_errors_that_an_inspector_cannot_have_are_refused(
    errors: tuple[tuple[str, float], ...], inspector: str, says: str
) -> None:
    with pytest.raises(InputError, match=says):
        replace(SHORT, inspector_errors=errors, inspector=inspector)
