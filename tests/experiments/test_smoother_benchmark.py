"""What the smoother's benchmark times is what it says: our solvers end at the optimum, ratios are of medians, a scene goes on."""

from functools import cache

import numpy as np

from experiments.benchmarks.endless_scene import PIECE, SCENARIO, EndlessScene
from experiments.benchmarks.floor import least_multiply_adds
from experiments.benchmarks.own_smoother import OwnIterations, own_batch, own_resolved, own_window
from experiments.benchmarks.smoother_checks import in_turn, ratio
from experiments.benchmarks.smoother_workload import PeerResult, Workload, simulated_workload
from spinfilters.simulation.scenario import RICH_RPM, Scenario

FRAMES = 12


@cache
def workload() -> Workload:
    """Some frames of a rich motion with a few landmarks."""
    return simulated_workload(
        Scenario.simplified(rate_rpm=RICH_RPM, epochs=FRAMES, landmarks=80, fewest_observations=2, seed=4)
    )


def result(seconds: float) -> PeerResult:
    return PeerResult("", np.zeros((0, 0)), np.zeros((0, 3)), 0.0, seconds, 0.0)


def test_solving_again_after_every_epoch_ends_near_the_batch() -> None:
    """One step per frame leaves the latest frames of a short recording a little above the optimum."""
    best = own_batch(workload()).cost
    assert best - 1e-3 < own_resolved(workload()).cost < 1.01 * best


def test_a_window_longer_than_the_recording_solves_everything() -> None:
    window, whole = own_window(workload(), FRAMES + 1), own_resolved(workload())
    np.testing.assert_allclose(window.trajectory, whole.trajectory, atol=1e-9)


def test_single_iterations_take_some_time() -> None:
    assert OwnIterations(workload()).seconds(2) > 0


def test_a_ratio_is_of_medians_with_its_range_by_rounds_and_without_our_python() -> None:
    found = ratio([8.0, 10.0, 30.0], [1.0, 2.0, 3.0], [2.0, 4.0, 6.0])
    assert (found.value, found.least, found.greatest, found.own_code) == (5.0, 5.0, 10.0, 3.0)


def test_a_bar_is_passed_when_the_ratio_reaches_it() -> None:
    found = ratio([8.0], [1.0])
    assert found.check("", 8.0).passed
    assert not found.check("", 8.1).passed


def test_solvers_take_turns_forwards_and_backwards() -> None:
    order: list[str] = []

    def solver(name: str) -> PeerResult:
        order.append(name)
        return result(0.0)

    found = in_turn({"a": lambda: solver("a"), "b": lambda: solver("b")}, 2)
    assert order == ["a", "b", "b", "a"]
    assert [len(results) for results in found.values()] == [2, 2]


def test_an_endless_scene_goes_on_over_its_pieces() -> None:
    scene = EndlessScene(0)
    epochs = [*scene.epochs(PIECE + 2), *scene.epochs(2)]
    times = [frame.time for frame in epochs]
    np.testing.assert_allclose(times, SCENARIO.interval * np.arange(PIECE + 4), atol=1e-9)
    assert all(50 < len(frame.measurements[0].values) < 500 for frame in epochs)


def test_a_landmark_of_an_endless_scene_keeps_its_number_from_piece_to_piece() -> None:
    epochs = list(EndlessScene(0).epochs(PIECE + 1))
    before, after = epochs[PIECE - 1].measurements[0].ids, epochs[PIECE].measurements[0].ids
    assert before is not None
    assert after is not None
    assert len(np.intersect1d(before, after)) > 0.3 * len(after)


def test_the_floor_counts_every_pair_of_frames_of_a_landmark_once() -> None:
    problem = workload()
    added = 0
    for number in range(len(problem.trial.ids)):
        frames = problem.observations.epoch[problem.observations.landmark == number].tolist()
        added += sum(6 * 3 * 6 for j in frames for i in frames if i <= j)
        added += sum(3 * (6 * 6 + 3 * 3 + 3 * 6) for _ in frames)
    unknowns = 6 * FRAMES + 8
    assert least_multiply_adds(problem) == added + unknowns**3 // 6
