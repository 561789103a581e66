"""Runs of epochs in one call give the numbers of single epochs."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from spinfilters.evaluation.consistency import true_states
from spinfilters.filters import timeline as loop
from spinfilters.filters.compiled_steps import compiled_propagation
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.epoch_run import CompiledSpread
from spinfilters.filters.estimator import EpochRun, Measurement, RunsTaken
from spinfilters.filters.filter import MultiplicativeFilter
from spinfilters.filters.flow_curvature import FlowCurvature
from spinfilters.filters.history import EPOCH_ARRAYS, EstimateHistory
from spinfilters.filters.noise_levels import NoiseScale
from spinfilters.filters.timeline import LogTimeline, SensorNoise, Timeline, build_timeline, run
from spinfilters.filters.ukf import MultiplicativeUkf
from spinfilters.inference.setup import camera_view
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
    "tracks of a known map": (
        Scenario.simplified(epochs=12, landmarks=300, rate_rpm=RICH_RPM, beside=(("gyro", 0.1),)),
        FULL,
    ),
}
TRACKS = "tracks of a known map"
FILTERS = (MultiplicativeEkf, MultiplicativeUkf)
needs_compiler = pytest.mark.skipif(compiled_propagation(11) is None, reason="no compiled code")


@cache
def sample(name: str) -> tuple[LogTimeline, Gaussian]:
    """Epochs of a recording, and a belief of the first."""
    scenario, layout = SAMPLES[name]
    dataset = simulate(scenario)
    assert dataset.truth is not None
    noise = SensorNoise(gyro_noise_std=scenario.gyro_std, pixel_std=1.0)
    timeline = build_timeline(dataset.log, layout, noise, camera_view(dataset))
    assert isinstance(timeline, LogTimeline)
    return timeline, Gaussian(layout, true_states(dataset.truth, layout)[0], 0.01 * np.eye(layout.error_dim))


def estimated(
    belief: Gaussian,
    timeline: Timeline,
    identified: dict[str, NoiseScale] | None = None,
    made_of: Callable[[TorqueFreeProcess], MultiplicativeFilter] = MultiplicativeEkf,
) -> tuple[EstimateHistory, dict[str, np.ndarray], int]:
    """History and snapshot of a filter from the first epoch on, and how often it was called between epochs."""
    process = TorqueFreeProcess(belief.layout, ProcessNoise())
    estimator, calls = made_of(process), []  # pyright: ignore[reportAbstractUsage]
    if identified is not None:
        estimator.adapt_from(identified)
    estimator.start(belief)
    history = run(estimator, timeline[0].time, timeline[1:], calls.append)
    return history, estimator.snapshot(), len(calls)


def require_same(
    timeline: LogTimeline,
    belief: Gaussian,
    identified: dict[str, NoiseScale] | None = None,
    made_of: type[MultiplicativeFilter] = MultiplicativeEkf,
) -> int:
    """Require the same of runs and of single epochs; how many calls the runs took."""
    single, by_one, _ = estimated(belief, list(timeline), identified, made_of)
    together, at_once, calls = estimated(belief, timeline, identified, made_of)
    assert together.status == single.status
    for name in set(EPOCH_ARRAYS) - {"runtime"}:
        np.testing.assert_allclose(getattr(together, name), getattr(single, name), rtol=1e-9, atol=1e-12)
    assert at_once.keys() == by_one.keys()
    for name, array in by_one.items():
        np.testing.assert_allclose(at_once[name], array, rtol=1e-9, atol=1e-12)
    return calls


@needs_compiler
@pytest.mark.parametrize("made_of", FILTERS)
@pytest.mark.parametrize("name", SAMPLES)
def test_a_run_of_epochs_gives_the_numbers_of_single_ones_in_few_calls(
    name: str, made_of: type[MultiplicativeFilter]
) -> None:
    timeline, belief = sample(name)
    timeline = timeline[:600]
    assert require_same(timeline, belief, made_of=made_of) < len(timeline) / 2


@needs_compiler
@pytest.mark.parametrize("value", [np.nan, 1e3])
def test_a_rejected_value_is_left_to_a_single_epoch(value: float) -> None:
    timeline, belief = sample("gyro")
    part = timeline.sensors[0]
    values = part.every.values.copy()
    values[[300, 700, 701, 702, 703, 704]] = value
    every = replace(part.every, values=values)
    require_same(replace(timeline, sensors=(replace(part, every=every),)), belief)


def changed_tracks(change: Callable[[np.ndarray, slice, slice], None]) -> tuple[LogTimeline, Gaussian]:
    """Epochs whose pixels a function changes, given them and the rows of the sixth image and of the one before."""
    timeline, belief = sample(TRACKS)
    number = next(k for k, part in enumerate(timeline.sensors) if part.every.model.name == "stereo")
    part = timeline.sensors[number]
    values = part.every.values.copy()
    measured = np.flatnonzero(part.end > part.first)[4:6]
    before, rows = (slice(int(part.first[k]), int(part.end[k])) for k in measured)
    change(values, rows, before)
    sensors = list(timeline.sensors)
    sensors[number] = replace(part, every=replace(part.every, values=values))
    return replace(timeline, sensors=tuple(sensors)), belief


def repeat_image(values: np.ndarray, rows: slice, before: slice) -> None:
    """The image before again, as far as it goes."""
    count = min(rows.stop - rows.start, before.stop - before.start)
    values[rows.start : rows.start + count] = values[before.start : before.start + count]


def repeat_one_value(values: np.ndarray, rows: slice, before: slice) -> None:
    """One value by chance."""
    values[rows.start] = values[before.start]


def mistake_a_tenth(values: np.ndarray, rows: slice, before: slice) -> None:
    """Wrong associations."""
    values[rows][::10] += 40.0


def mistake_most(values: np.ndarray, rows: slice, before: slice) -> None:
    """So many wrong ones that the state is doubted."""
    values[rows][: 9 * (rows.stop - rows.start) // 10] += 40.0


def spoil_one_value(values: np.ndarray, rows: slice, before: slice) -> None:
    """A number that is none."""
    values[rows.start + 3] = np.nan


@needs_compiler
@pytest.mark.parametrize("made_of", FILTERS)
@pytest.mark.parametrize(
    "change", [repeat_image, repeat_one_value, mistake_a_tenth, mistake_most, spoil_one_value]
)
def test_an_unusual_image_gives_the_numbers_of_single_epochs(
    change: Callable[[np.ndarray, slice, slice], None], made_of: type[MultiplicativeFilter]
) -> None:
    require_same(*changed_tracks(change), made_of=made_of)


@needs_compiler
def test_a_vague_belief_is_updated_by_iteration_in_the_same_epochs() -> None:
    timeline, belief = sample(TRACKS)
    require_same(timeline, replace(belief, factor=10 * belief.factor))


def test_a_call_takes_in_no_more_values_than_its_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    timeline, belief = sample(TRACKS)
    few = timeline[1:]
    values = np.sum([part.end[1:] - part.first[1:] for part in timeline.sensors], axis=0)
    assert isinstance(few, LogTimeline)
    monkeypatch.setattr(loop, "MOST_VALUES", 400)
    ends, numbers = loop.ends_of_runs(few), np.arange(len(few))
    assert all(
        end == k + 1 or values[k:end].sum() <= 400 for k, end in zip(numbers, ends.tolist(), strict=True)
    )
    assert (ends > numbers + 1).any()
    require_same(timeline, belief)


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


def spied(call: Callable[..., Any], results: list[Any]) -> Callable[..., Any]:
    """A function whose results are kept."""

    def kept(*arguments: Any) -> Any:
        results.append(call(*arguments))
        return results[-1]

    return kept


@needs_compiler
@pytest.mark.parametrize("turn", [0.2, 3.0])
def test_sigma_points_in_one_call_are_those_of_arrays(turn: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where no step of so many substeps was made before."""
    x, factor = FULL.origin(), np.tril(0.03 * np.random.default_rng(1).standard_normal((20, 20)))
    x[FULL.mean_slice("w")], x[FULL.mean_slice("t")] = turn * np.array([0.6, 0.0, 0.8]), [0.1, 0.2, 2.0]
    made, calls = [], []
    monkeypatch.setattr(CompiledSpread, "__call__", spied(CompiledSpread.__call__, calls))
    for of in (CompiledSpread.of, lambda *_: None):
        monkeypatch.setattr(CompiledSpread, "of", of)
        estimator = MultiplicativeUkf(TorqueFreeProcess(FULL, ProcessNoise(), 1e-8 * turn))
        estimator.start(Gaussian(FULL, x, factor + 0.1 * np.eye(20)))
        made.append(estimator.linearise_process(1.0))
    assert calls[-1] is not None
    for compiled, reference in zip(*made, strict=True):
        np.testing.assert_allclose(compiled, reference, rtol=1e-10, atol=1e-12)


def changed_runs(timeline: LogTimeline, runs: int) -> list[LogTimeline]:
    """The same epochs with other values in each run; a gross error in the last run but one."""
    rng, found = np.random.default_rng(3), []
    for k in range(runs):
        sensors = []
        for part in timeline.sensors:
            noise = 1e-4 * rng.standard_normal(part.every.values.shape)
            if k == runs - 2:
                noise[part.end[7] - 1] += 50.0
            sensors.append(replace(part, every=replace(part.every, values=part.every.values + noise)))
        found.append(replace(timeline, sensors=tuple(sensors)))
    return found


def widening(turn: float) -> Callable[[TorqueFreeProcess], MultiplicativeEkf]:
    """Filters that widen their beliefs once in a turn by this angle, rad."""
    return lambda process: MultiplicativeEkf(process, curvature=FlowCurvature(turn))


def runs_side_by_side(
    belief: Gaussian, timeline: LogTimeline, several: list[LogTimeline], turn: float
) -> RunsTaken | None:
    """Epochs of many runs behind the first, from the same belief."""
    estimator = widening(turn)(TorqueFreeProcess(belief.layout, ProcessNoise()))
    estimator.start(belief)
    loop.rehearse(estimator, timeline[0].time, timeline[1:])
    estimator.start(belief)
    parts = []
    for k, part in enumerate(timeline.sensors):
        every = [one.sensors[k].every for one in several]
        values, parameters = (
            np.concatenate([getattr(each, name) for each in every]) for name in ("values", "parameters")
        )
        parts.append(replace(part, every=Measurement(part.every.model, values, parameters)))
    first = EpochRun(
        np.diff(loop.times_of(timeline)), tuple(replace(p, first=p.first[1:], end=p.end[1:]) for p in parts)
    )
    beliefs = [np.tile(array, (len(several), *[1] * array.ndim)) for array in (belief.mean, belief.factor)]
    return estimator.take_in_runs(first, *beliefs)


@needs_compiler
@pytest.mark.parametrize(
    ("name", "turn"), [("poses", np.inf), ("poses", 0.3), ("poses and gyro", 0.3), (TRACKS, np.inf)]
)
def test_runs_side_by_side_have_the_beliefs_of_runs_by_themselves(name: str, turn: float) -> None:
    timeline, belief = sample(name)
    softly = np.array(belief.factor)
    softly[belief.layout.slice("s")] *= 10.0 if np.isfinite(turn) else 1.0
    belief = replace(belief, factor=softly)
    several = changed_runs(timeline, 10)
    singles = [estimated(belief, one, made_of=widening(turn))[0] for one in several]
    taken = runs_side_by_side(belief, timeline, several, turn)
    assert taken is not None
    assert np.count_nonzero(taken.done == len(timeline) - 1) >= 8  # the others may need single epochs
    for k, (single, done) in enumerate(zip(singles, taken.done.tolist(), strict=True)):
        rows = {key: array[k, :done] for key, array in taken.rows.items()}
        factor, expected = rows.pop("factor"), single.factor[:done]
        deviations = np.linalg.norm(expected, axis=2)
        scale = deviations[:, :, np.newaxis] * deviations[:, np.newaxis]
        squares = [each @ np.swapaxes(each, 1, 2) / scale for each in (factor, expected)]
        np.testing.assert_allclose(*squares, atol=1e-8)
        for key, array in rows.items():
            np.testing.assert_allclose(array, getattr(single, key)[:done], rtol=1e-7, atol=1e-9, err_msg=key)


@needs_compiler
def test_a_run_has_the_same_bits_whatever_runs_are_beside_it() -> None:
    timeline, belief = sample("poses")
    several = changed_runs(timeline, 10)
    every, alone = (runs_side_by_side(belief, timeline, runs, turn=0.3) for runs in (several, several[6:7]))
    assert every is not None
    assert alone is not None
    for key, array in alone.rows.items():
        np.testing.assert_array_equal(array[0, : alone.done[0]], every.rows[key][6, : every.done[6]])
