"""Jumps amid a recording: the score of every step, and what a verdict calls them."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from plain_comparison import plain_comparison
from smoothed_motions import motion_near

from spinfilters.core.attitude_conversions import multiply
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.run.estimation import Comparison
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.model_faults import faulty_recording, model_faults
from spinfilters.simulation.scenario import (
    RICH_RPM,
    Motion,
    Scenario,
    first_state,
    measured,
    simulate,
    simulate_motion,
    without_map,
    without_noise,
)
from spinfilters.verdict.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.verdict.model_tests import FEWEST_STEPS, KINDS, interval_of_jump, jumps, step_statistics

SMOOTHER = Settings(estimators=("smoother",))
WHOLE = Settings(process={"gravity": False}, initialisation={"share": 1.0})  # pyright: ignore[reportArgumentType]
AT = 50
"""Epoch of the jump."""


def scenario(kind: str) -> Scenario:
    """A rich motion that little disturbs."""
    return Scenario.simplified(
        kind=kind,
        principal_moments=(1.0, 0.8, 0.55),
        rate_rpm=RICH_RPM,
        epochs=90,
        interval=0.2,
        gyro_std=0.002,
        position_std=0.002,
        rotation_std=0.004,
        landmarks=40,
        noise=ProcessNoise(1e-8, 1e-8),
    )


@cache
def smoothed(kind: str) -> SmoothedMotion:
    """About the most probable motion; tracks without their map."""
    dataset = simulate(replace(scenario(kind), epochs=40))
    setup = prepare(without_map(dataset) if dataset.known_map is not None else dataset, WHOLE)
    return motion_near(setup, setup.initial.mean)


@pytest.mark.parametrize("kind", ["pose", "gyro", "stereo-tracks"])
def test_the_score_of_a_step_is_that_of_its_kick_as_measurements_see_it(kind: str) -> None:
    motion = smoothed(kind)
    kicks = {kind.name: kind.kicks for kind in KINDS}
    for jump in jumps(motion):
        H = jump.columns(motion)
        assert H is not None
        H = H.times(np.diag(1 / np.sqrt(np.maximum(np.diag(H.gram(H)), 1e-300))))
        left = motion.rows.residual(H)
        F, u = left.gram(left), H.gram(motion.rows.left)[:, 0]
        expected = u @ np.linalg.pinv(F, rcond=1e-7) @ u
        largest = step_statistics(motion, kicks[jump.name])[FEWEST_STEPS:-FEWEST_STEPS].max()
        assert largest == pytest.approx(expected, rel=0.01, abs=0.01)
        assert expected < 40  # nothing jumped


def test_every_kind_says_what_it_is_and_what_to_do() -> None:
    assert len({kind.name for kind in KINDS}) == len(KINDS)
    for kind in KINDS:
        assert kind.phrase
        assert kind.unit
        assert 10 < len(kind.cure) < 120


def touched(kind: str) -> Dataset:
    """The rate jumps by a tenth of itself."""
    own, layout = scenario(kind), StateLayout(FULL_BLOCKS)
    generator, time = np.random.default_rng(3), own.interval * np.arange(own.epochs)
    process = TorqueFreeProcess(layout, own.noise)
    before = simulate_motion(process, first_state(own, layout), time[: AT + 1], generator)
    kicked = before[-1].copy()
    kicked[layout.mean_slice("w")] += [0.06, -0.05, 0.08]
    behind = simulate_motion(process, kicked, time[AT:], generator)
    states = np.concatenate([before[:-1], behind])
    return measured(own, Motion(layout, time, states), generator)


def with_samples_lost(kind: str) -> Dataset:
    """Two samples are missing, and the clock counts what is left."""
    dataset = without_noise(simulate(scenario(kind)))
    (stream,) = dataset.log.streams
    kept = np.delete(np.arange(len(stream.time)), [AT, AT + 1])
    moved = replace(stream, time=stream.time[: len(kept)], values=stream.values[kept])
    return replace(dataset, log=MeasurementLog((moved,)), truth=None)


def with_camera_pushed() -> Dataset:
    """All later poses in a camera that was turned by 0.03 rad."""
    dataset = simulate(scenario("pose"))
    (stream,) = dataset.log.streams
    values, turn = stream.values.copy(), np.array([0.0, np.sin(0.015), 0.0, np.cos(0.015)])
    values[AT:, 3:] = multiply(turn, values[AT:, 3:])
    return replace(dataset, log=MeasurementLog((replace(stream, values=values),)), truth=None)


def compared(dataset: Dataset) -> Comparison:
    """With no noise stated."""
    return plain_comparison(without_noise(dataset), SMOOTHER)


@pytest.mark.parametrize("kind", ["gyro", "pose"])
def test_a_touch_amid_a_recording_is_named_at_its_time_and_size(kind: str) -> None:
    comparison = compared(touched(kind))
    assert "contact-amid" in comparison.models.names[0].split("/")
    (test,) = (each for each in comparison.models.named if each.error.name == "contact-amid")
    assert f"t = {AT * 0.2:.4g} s" in test.error.phrase or f"t = {(AT + 1) * 0.2:.4g} s" in test.error.phrase
    assert np.linalg.norm(test.size[:3]) == pytest.approx(np.sqrt(0.0125), rel=0.25)
    interval = re.search(r", between (\S+) and (\S+) s", test.error.phrase)
    assert interval is not None
    begin, end = interval.groups()
    assert float(begin) <= AT * 0.2 <= float(end) <= float(begin) + 2.0
    assert test.error.cure == f"use the recording before {begin} s or after {end} s (--segment)"
    assert comparison.evaluations[0].history.status.verdict == "degraded"


def test_steps_whose_statistics_hardly_differ_may_all_contain_the_jump() -> None:
    time, among = 0.5 * np.arange(20), np.zeros(11)
    among[2:6] = 80.0, 89.5, 100.0, 89.5  # of steps 6 to 9; the limit is 10.6 below the largest
    assert interval_of_jump(time, among) == (3.5, 5.5)
    among[5] = 89.3
    assert interval_of_jump(time, among) == (3.5, 5.0)


@pytest.mark.parametrize("kind", ["gyro", "pose"])
def test_samples_that_are_lost_are_a_jump_of_the_clock(kind: str) -> None:
    comparison = compared(with_samples_lost(kind))
    assert "clock-jump" in "/".join(comparison.models.names[:2]).split("/")
    (test,) = (each for each in comparison.models.named if each.error.name == "clock-jump")
    assert abs(test.size[0]) == pytest.approx(0.4, rel=0.25)
    assert comparison.evaluations[0].history.status.verdict == "degraded"


def test_a_camera_that_is_pushed_is_a_jump_of_the_frame() -> None:
    comparison = compared(with_camera_pushed())
    assert "frame-jump" in "/".join(comparison.models.names[:2]).split("/")
    assert comparison.evaluations[0].history.status.verdict == "degraded"


def test_positions_later_than_their_attitudes_are_named() -> None:
    dataset = simulate(scenario("pose"))
    (stream,) = dataset.log.streams
    values = stream.values.copy()
    values[1:, :3] = stream.values[:-1, :3]
    comparison = compared(replace(dataset, log=MeasurementLog((replace(stream, values=values),)), truth=None))
    assert "position-delay" in "/".join(comparison.models.names[:2]).split("/")
    assert comparison.evaluations[0].history.status.verdict == "degraded"


def test_a_tracked_point_that_moves_in_the_body_is_named_with_its_way() -> None:
    right = scenario("pose")
    seeds = tuple(np.random.SeedSequence(3).spawn(3))
    faulty = faulty_recording(right, model_faults()["point-drift"], 0.03, seeds)
    comparison = compared(replace(faulty, truth=None))
    assert comparison.models.names[0] == "point-drift"
    assert np.linalg.norm(comparison.models.named[0].size) == pytest.approx(0.03, rel=0.3)
    assert [each.history.status.verdict for each in comparison.evaluations] == ["degraded"]


def test_positions_that_wander_are_not_late() -> None:
    restless = replace(scenario("pose"), noise=ProcessNoise(1e-6, 1e-5))
    comparison = compared(simulate(restless))
    assert comparison.models.names == ()


@pytest.mark.parametrize("kind", ["gyro", "pose"])
def test_a_right_recording_shows_no_jump(kind: str) -> None:
    comparison = compared(simulate(scenario(kind)))
    assert comparison.models.names == ()
    assert comparison.evaluations[0].history.status.verdict == "ok"


def test_rates_that_never_change_leave_errors_to_look_for() -> None:
    dataset = simulate(scenario("gyro"))
    (stream,) = dataset.log.streams
    constant = replace(stream, values=np.tile([0.3, 0.1, -0.2], (len(stream.time), 1)))
    comparison = plain_comparison(replace(dataset, log=MeasurementLog((constant,)), truth=None), SMOOTHER)
    assert comparison.models.trouble == ""
    assert comparison.evaluations[0].history.status.verdict != "ok"
