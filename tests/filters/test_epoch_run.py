"""Runs of epochs in one call give the numbers of single epochs."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from spinfilters.evaluation.consistency import true_states
from spinfilters.filters.compiled_steps import compiled_propagation
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.history import EPOCH_ARRAYS, EstimateHistory
from spinfilters.filters.noise_levels import NoiseScale
from spinfilters.filters.timeline import LogTimeline, SensorNoise, Timeline, build_timeline, run
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, Gaussian, StateLayout
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate

FULL, ROTATION = StateLayout(FULL_BLOCKS), StateLayout(("a", "w", "s"))
SAMPLES = {
    "gyro": (Scenario(kind="gyro", epochs=900, interval=0.01, rate_rpm=RICH_RPM), ROTATION),
    "poses": (Scenario(kind="pose", epochs=60, interval=0.5, rate_rpm=RICH_RPM), FULL),
    "poses and gyro": (
        Scenario(kind="pose", epochs=12, interval=0.5, rate_rpm=RICH_RPM, beside=(("gyro", 0.02),)),
        FULL,
    ),
}
needs_compiler = pytest.mark.skipif(compiled_propagation(11) is None, reason="no compiled code")


@cache
def sample(name: str) -> tuple[LogTimeline, Gaussian]:
    """Epochs of a recording, and a belief of the first."""
    scenario, layout = SAMPLES[name]
    dataset = simulate(scenario)
    assert dataset.truth is not None
    timeline = build_timeline(dataset.log, layout, SensorNoise())
    assert isinstance(timeline, LogTimeline)
    return timeline, Gaussian(layout, true_states(dataset.truth, layout)[0], 0.01 * np.eye(layout.error_dim))


def estimated(
    belief: Gaussian, timeline: Timeline, identified: dict[str, NoiseScale] | None = None
) -> tuple[EstimateHistory, dict[str, np.ndarray], int]:
    """History and snapshot of an EKF from the first epoch on, and how often it was called between epochs."""
    estimator, calls = MultiplicativeEkf(TorqueFreeProcess(belief.layout, ProcessNoise())), []
    if identified is not None:
        estimator.adapt_from(identified)
    estimator.start(belief)
    history = run(estimator, timeline[0].time, timeline[1:], calls.append)
    return history, estimator.snapshot(), len(calls)


def require_same(
    timeline: LogTimeline, belief: Gaussian, identified: dict[str, NoiseScale] | None = None
) -> int:
    """Require the same of runs and of single epochs; how many calls the runs took."""
    single, by_one, _ = estimated(belief, list(timeline), identified)
    together, at_once, calls = estimated(belief, timeline, identified)
    assert together.status == single.status
    for name in set(EPOCH_ARRAYS) - {"runtime"}:
        np.testing.assert_allclose(getattr(together, name), getattr(single, name), rtol=1e-9, atol=1e-12)
    assert at_once.keys() == by_one.keys()
    for name, array in by_one.items():
        np.testing.assert_allclose(at_once[name], array, rtol=1e-9, atol=1e-12)
    return calls


@needs_compiler
@pytest.mark.parametrize("name", SAMPLES)
def test_a_run_of_epochs_gives_the_numbers_of_single_ones_in_few_calls(name: str) -> None:
    timeline, belief = sample(name)
    assert require_same(timeline, belief) < len(timeline) / 2


@needs_compiler
@pytest.mark.parametrize("value", [np.nan, 1e3])
def test_a_rejected_value_is_left_to_a_single_epoch(value: float) -> None:
    timeline, belief = sample("gyro")
    part = timeline.sensors[0]
    values = part.every.values.copy()
    values[[300, 700, 701, 702, 703, 704]] = value
    every = replace(part.every, values=values)
    require_same(replace(timeline, sensors=(replace(part, every=every),)), belief)


@needs_compiler
def test_levels_are_learned_in_the_same_epochs() -> None:
    timeline, belief = sample("gyro")
    levels = {"sensor.gyro": NoiseScale(0.3, 500.0), "process.torque": NoiseScale(-0.2, 400.0, 0.5)}
    require_same(timeline, belief, levels)


def test_a_filter_that_changes_a_step_takes_every_epoch_by_itself() -> None:
    class Counting(MultiplicativeEkf):
        steps = 0

        def predict(self, dt: float) -> None:
            self.steps += 1
            super().predict(dt)

    timeline, belief = sample("gyro")
    estimator = Counting(TorqueFreeProcess(belief.layout, ProcessNoise()))
    estimator.start(belief)
    run(estimator, timeline[0].time, timeline[1:100])
    assert estimator.steps == 99
