"""Errors of an inspector's poses about a smoothed motion: their columns, and a unit of length that moves with its disturbances."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from spinfilters.filters.timeline import times_of
from spinfilters.inference.identified_noise import Unstated, noise_model
from spinfilters.models.process import ProcessNoise
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map
from spinfilters.verdict.model_errors.alternatives import table
from spinfilters.verdict.model_errors.error_columns import levered_since_first, of_inspector
from spinfilters.verdict.model_errors.hypotheses import NOTHING_KNOWN, noise_of, solved_near
from spinfilters.verdict.model_errors.score_tests import ScoreTest, score_tests
from spinfilters.verdict.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.verdict.model_tests import landmarks_placed, linear_problem

MOVING = Scenario.simplified(
    rate_rpm=RICH_RPM, epochs=40, landmarks=100, noise=ProcessNoise(1e-6, 1e-6), inspector="sway", seed=4
)


PER_ROW = ("rows", "epoch", "states", "parameters", "whitening", "change")


@cache
def score_tested(scenario: Scenario) -> tuple[SmoothedMotion, dict[str, ScoreTest]]:
    """The whole recording smoothed, and its score tests by name."""
    settings = Settings(
        initialisation={"share": 1.0},  # pyright: ignore[reportArgumentType]
        process={"gravity": False},  # pyright: ignore[reportArgumentType]
    )
    setup = prepare(without_map(simulate(scenario)), settings)
    problem, trajectory = linear_problem(setup, setup.timeline), setup.initial.mean
    rows = solved_near(problem, trajectory, landmarks_placed(problem, trajectory))
    assert rows is not None
    model = noise_model(problem, setup.noise, Unstated.of_all(setup.log, setup.process.noise))
    assert model is not None
    motion = SmoothedMotion(times_of(setup.timeline), rows)
    tests = score_tests(motion, noise_of(model, rows, NOTHING_KNOWN), table().values())
    return motion, {each.error.name: each for each in tests}


def away(scenario: Scenario, name: str) -> float:
    """Of the size of an error without a direction from zero, in deviations."""
    test = score_tested(scenario)[1][name]
    return float(test.size[0] / test.std[0])


@pytest.mark.parametrize("late", [0.2, 0.5])
def test_late_poses_of_an_inspector_are_told_with_their_delay(late: float) -> None:
    found = score_tested(replace(MOVING, inspector_errors=(("late", late),)))[1]["inspector-delay"]
    assert found.size[0] == pytest.approx(late, abs=max(4 * found.std[0], 0.1 * late))
    assert found.p_value < 1e-3


def test_attitudes_of_an_inspector_that_drift_are_told_with_their_direction() -> None:
    span = (MOVING.epochs - 1) * MOVING.interval
    found = score_tested(replace(MOVING, inspector_errors=(("turning", 0.1),)))[1]["inspector-drift"]
    per_minute = -0.1 * 60.0 / span * np.array([0.6, -0.48, 0.64])  # where it is, seen from what is told
    assert (
        found.size @ per_minute > 0.5 * per_minute @ per_minute
    )  # about the angular momentum it is hardly told
    assert found.p_value < 1e-4


def test_poses_of_another_point_than_the_camera_are_told_with_their_lever_arm() -> None:
    found = score_tested(replace(MOVING, inspector_errors=(("lever", 0.4),)))[1]["inspector-lever"]
    arm = -0.4 * np.array([0.6, -0.48, 0.64])  # where the camera is, seen from what is told
    assert found.p_value < 1e-3
    told = found.std < 0.1  # along the axis it turns about it is a shift of frame i
    assert told.any()
    np.testing.assert_allclose(found.size[told], arm[told], atol=0.15)


def test_a_lever_arm_on_a_circle_is_told_but_along_its_axis() -> None:
    """Along that axis its column is rounding, which must not hide the other two; the circle's radius is a wrong length, too."""
    circle = replace(MOVING, inspector="circle", epochs=60, inspector_errors=(("lever", 0.4),))
    found = score_tested(circle)[1]["inspector-lever"]
    arm = -0.4 * np.array([0.6, -0.48, 0.64])
    in_plane = [0, 2]
    assert found.dof == 2
    assert found.p_value < 1e-3
    assert np.all(found.std[in_plane] < 0.1)
    assert np.all(np.abs(found.size - arm)[in_plane] < 4 * found.std[in_plane])


def test_a_lever_arm_moves_the_states_that_follow_it() -> None:
    """Told of a moved motion or not, the score and its information are the same (M J = 0)."""
    motion, _ = score_tested(MOVING)
    moved = table()["inspector-lever"].columns(motion)
    plain = of_inspector(motion, levered_since_first)
    assert moved is not None
    assert plain is not None
    assert np.all(moved.squares < 0.1 * plain.squares)
    left, own = (motion.rows.residual(each) for each in (moved, plain))
    scale = np.sqrt(np.outer(own.squares, own.squares))
    np.testing.assert_allclose(left.gram(left) / scale, own.gram(own) / scale, atol=1e-5)


def test_a_lever_arm_moves_estimates_by_all_of_its_path() -> None:
    """With the states that its rows are relative to: else an arm of any length would seem to leave the estimates alone."""
    motion, _ = score_tested(MOVING)
    moved = table()["inspector-lever"].columns(motion)
    plain = of_inspector(motion, levered_since_first)
    assert moved is not None
    assert plain is not None
    found, expected = (motion.rows.sensitivity(each).states for each in (moved, plain))
    np.testing.assert_allclose(found, expected, atol=1e-5 * float(np.abs(expected).max()))
    place = motion.rows.problem.layout.slice("t")
    beside = motion.rows.sensitivity(replace(moved, states=None)).states
    assert np.abs(found[:, place]).max() > 10 * np.abs(beside[:, place]).max()
    pair = motion.rows.sensitivity(moved.times(np.array([[1.0], [2.0], [0.0]]))).states
    np.testing.assert_allclose(pair[:, :, 0], found[:, :, 0] + 2 * found[:, :, 1], rtol=1e-9, atol=1e-9)


def test_the_delay_of_a_uniform_circle_is_hardly_told() -> None:
    _, circle = score_tested(replace(MOVING, inspector="circle"))
    _, sway = score_tested(MOVING)
    assert "inspector-delay" not in circle or circle["inspector-delay"].std > 5 * sway["inspector-delay"].std


def test_a_camera_at_rest_has_no_errors_of_an_inspector_but_that_it_moves() -> None:
    _, found = score_tested(replace(MOVING, inspector="static"))
    assert {name for name in found if name.startswith("inspector")} == {"inspector-missing"}


def test_a_known_trajectory_is_not_missing() -> None:
    assert "inspector-missing" not in score_tested(MOVING)[1]


def test_a_resting_camera_does_not_tell_its_baseline() -> None:
    """Scene, velocity and disturbances are all larger by the same factor, and nothing else has a length."""
    motion, _ = score_tested(replace(MOVING, inspector="static"))
    columns = table()["baseline"].columns(motion)
    assert columns is not None
    assert motion.rows.residual(columns).squares[0] < 1e-6 * columns.squares[0]


def test_a_baseline_score_of_right_recordings_is_zero_in_the_mean() -> None:
    """Held to the force's density it was some -3 deviations in the mean, for it has minus the squares of the force in it."""
    scores = [away(replace(MOVING, inspector="circle", seed=seed), "baseline") for seed in range(5)]
    assert abs(np.mean(scores)) < 3 / np.sqrt(len(scores))


@pytest.mark.parametrize("epochs", [0, 1])
def test_of_a_camera_that_sees_no_two_epochs_there_is_nothing_to_tell(epochs: int) -> None:
    """As of a camera that begins behind the epochs that are tested."""
    for scenario in (MOVING, replace(MOVING, inspector="static")):
        whole, _ = score_tested(scenario)
        motion = SmoothedMotion(whole.time, whole.rows)
        measured = []
        for each in whole.measured:
            few = {name: value[each.epoch < epochs] for name, value in vars(each).items() if name in PER_ROW}
            measured.append(replace(each, **few))
        vars(motion)["measured"] = tuple(measured)
        found = [each.columns(motion) for name, each in table().items() if name.startswith("inspector")]
        assert found == [None] * len(found)
        assert len(found) == 4
