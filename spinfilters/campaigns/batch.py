"""Runs of one filter in batches: many seeds of a cell are simulated, filtered and evaluated as arrays.

Counts are those of runs made one by one; beliefs, errors and NEES too, to rounding. A batch gives no verdict: rows are ``degraded``
at best, with the reason that no verdict was asked for.
"""

import json
import sys
import time
import warnings
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from multiprocessing import get_context
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.campaigns.engine import Chunk
from spinfilters.campaigns.recording_factors import FaultFactor
from spinfilters.campaigns.row_columns import columns_of_runs, noise_columns
from spinfilters.campaigns.runner import Row, Runner, asked, run_seeds, when_and_where
from spinfilters.campaigns.study import Cell, Study, study_from
from spinfilters.core.errors import InputError
from spinfilters.evaluation.consistency import normalised_errors, true_states
from spinfilters.evaluation.estimated_motion import motion_of
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.metrics import metrics
from spinfilters.evaluation.trajectory_errors import body_errors, truth_errors
from spinfilters.filters.estimator import EpochRun, Estimator, Measurement, RunsTaken, SensorTimeline
from spinfilters.filters.history import EPOCH_ARRAYS, EstimateHistory
from spinfilters.filters.timeline import MOST_TOGETHER, rehearse, sensors_of, times_of
from spinfilters.inference.estimator_entry import begin_with_first_epoch
from spinfilters.inference.setup import Setup
from spinfilters.models.body import bodies_of
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.models.status import EstimatorStatus
from spinfilters.run.estimation import build_estimator
from spinfilters.run.estimators import estimator_entries
from spinfilters.simulation.simulated_runs import SimulatedRuns, require_simulated_together, simulate_runs

RUNS_TOGETHER: Final = 64
"""Runs of a batch: their histories of a hundred epochs take some 20 MB."""
ROWS_TOGETHER: Final = 1024
"""Rows that are written at once: a second's."""
START: Final = "fork" if sys.platform == "linux" else "spawn"
"""How processes start: forked ones need not load and build everything again."""
LARGEST: Final = 1e100
"""Size of states and deviations beyond which a run is evaluated by itself."""
NO_VERDICT: Final = EstimatorStatus().degraded("runs of a batch have no verdict (leave --batch out for one)")
WITHOUT: Final = "; leave --batch out"
"""What a user does about a study that batches cannot make."""


@dataclass(frozen=True)
class Batches:
    """Makes the runs of a study in batches, on this machine.

    Attributes
    ----------
    processes : int
        Processes that share the batches; each run's numbers are the same for any number.
    """

    processes: int = 1

    def rows(self, study: Study, chunks: list[Chunk]) -> Generator[Row, None, None]:
        """Rows of all runs, batch by batch.

        Raises
        ------
        InputError
            A study that batches cannot make: of data sets, of initialisations from data, with bounds of every run, or with
            faults, landmarks or drawn factors.
        """
        _require_batches(study)
        runs, parts = [run for chunk in chunks for run in chunk], []
        for number in range(len(study.cells)):
            own = [run for run in runs if study.run(run).cell == number]
            parts += [own[begin : begin + RUNS_TOGETHER] for begin in range(0, len(own), RUNS_TOGETHER)]
        make = partial(_rows_of_batch, json.dumps(dict(study.document)))
        try:
            if self.processes == 1:
                for part in parts:
                    yield from make(part)
                return
            # of the first batch this process keeps the models and all that was compiled, and hands them on to those that it forks
            yield from make(parts.pop(0))
            if parts:
                yield from self._rows_in_processes(make, parts)
        finally:
            _batches_of.cache_clear()

    def _rows_in_processes(
        self, make: Callable[[Sequence[int]], list[Row]], parts: Sequence[Sequence[int]]
    ) -> Generator[Row, None, None]:
        with ProcessPoolExecutor(min(self.processes, len(parts)), get_context(START)) as pool:
            with warnings.catch_warnings():
                warnings.simplefilter(
                    "ignore", DeprecationWarning
                )  # threads of this process hold nothing that batches need
                found = pool.map(make, parts)
            for rows in found:
                yield from rows


@cache
def _batches_of(document: str) -> "_Batches":
    """Batches of a study, kept by the process that makes them."""
    return _Batches(Runner(study_from(json.loads(document), "study")))


def _rows_of_batch(document: str, runs: Sequence[int]) -> list[Row]:
    return _batches_of(document).rows(runs)


def _require_batches(study: Study) -> None:
    """InputError: a study that batches cannot make."""
    options = study.options
    if options.initialisation != "drawn":
        raise InputError(f'a batch needs drawn beliefs; give initialisation = "drawn"{WITHOUT}')
    if options.bound == "run":
        raise InputError(f'a batch has no bound of every run; give bound = "motion" or "none"{WITHOUT}')
    for cell in study.cells:
        if cell.own_recording or cell.drawn or cell.recording.fault != FaultFactor():
            raise InputError(f"a batch is of simulated recordings without drawn factors and faults{WITHOUT}")
        if not (cell.recording.noise.stated and cell.recording.noise.calibrated):
            raise InputError(f"a batch needs stated noise and an exact calibration{WITHOUT}")
        if cell.recording.motion.epochs > MOST_TOGETHER:
            raise InputError(f"a batch has runs of at most {MOST_TOGETHER} epochs{WITHOUT}")
        require_simulated_together(cell.recording.scenario)


class _Batches:
    """Batches of a study's runs; what is the same in all runs of a cell stays until another cell comes."""

    def __init__(self, runner: Runner) -> None:
        self._runner = runner
        self._latest: _CellFilter | None = None

    def rows(self, runs: Sequence[int]) -> list[Row]:
        """Rows of some runs of one cell; those that need more than compiled epochs are made one by one."""
        number = self._runner.study.run(runs[0]).cell
        begin = time.process_time()
        if self._latest is None or self._latest.number != number:
            self._latest = _CellFilter(self._runner, number)
        return _Batch(self._runner, self._latest, runs).rows(begin)


class _CellFilter:
    """The filter of a cell, and the data set of its first seed, initialised: of those of other seeds only values differ."""

    def __init__(self, runner: Runner, number: int) -> None:
        self.number = number
        self.cell: Cell = runner.study.cells[number]
        self.first = runner.study.run(number)
        self.setup: Setup = runner.setup(self.first)
        self.estimator = self._started()
        self.shared_begin = runner.shared_begin(self.first)
        levels = noise_columns(self.setup.identified, self.cell.recording.levels)
        bounds = runner.motion_bound(self.first) if runner.study.options.bound == "motion" else {}
        self.known: Row = {"outcome": "done", "reason": "", "model_errors": ""} | levels | bounds

    def _started(self) -> Estimator:
        """The filter, started, and with everything compiled that its epochs need."""
        name, setup = self.cell.estimator, self.setup
        entry, estimator, twin = (
            estimator_entries()[name],
            *(build_estimator(name, setup, self.cell.settings) for _ in range(2)),
        )
        begin_with_first_epoch(entry, twin, setup)
        rehearse(twin, setup.end_of_initialisation, setup.timeline[1:])
        entry.begin(estimator, setup)
        return estimator


class _Batch:
    """Some runs of one cell."""

    def __init__(self, runner: Runner, filter_of_cell: _CellFilter, runs: Sequence[int]) -> None:
        self._runner, self._filter, self._runs = runner, filter_of_cell, runs
        root, seeds = runner.study.options.root_seed, [runner.study.run(run).seed for run in runs]
        self._seeds = [run_seeds(root, seed) for seed in seeds]

    def rows(self, begin: float) -> list[Row]:
        """Rows of the runs, begun at this processor time, s."""
        spent, setup, cell = {}, self._filter.setup, self._filter.cell
        spent["initialise"] = time.process_time() - begin
        simulated = simulate_runs(
            cell.recording.scenario,
            [np.random.default_rng(each.motion) for each in self._seeds],
            [np.random.default_rng(each.measurements) for each in self._seeds],
        )
        spent["simulate"] = time.process_time() - begin - sum(spent.values())
        mean = self._beliefs(setup, simulated)
        taken = self._filter.estimator.take_in_runs(
            _epochs(setup, simulated), mean, _tile_factor(setup, mean)
        )
        if taken is None:
            return [self._runner.row(run) for run in self._runs]
        spent["estimate"] = time.process_time() - begin - sum(spent.values())
        ended = taken.done == len(setup.timeline)
        whole = np.flatnonzero(ended & _are_numbers(taken.rows["mean"][:, -1], taken.rows["factor"][:, -1]))
        results: dict[int, Row] = {}
        if whole.size:
            _repeat_first(whole, [mean, *taken.rows.values()])
            evaluation = _evaluation(cell.estimator, setup, simulated, mean, taken, spent["estimate"])
            found = columns_of_runs(evaluation, len(mean), self._filter.shared_begin, metrics())
            results = {k: found[k] for k in whole.tolist()}
        spent["evaluate"] = time.process_time() - begin - sum(spent.values())
        share = {f"time_{name}_s": seconds / len(self._runs) for name, seconds in spent.items()}
        share["time_total_s"] = sum(share.values())
        study, end = self._runner.study, self._runner.versions | share | when_and_where()
        return [
            asked(study, run) | self._filter.known | results[k] | end
            if k in results
            else self._runner.row(run)
            for k, run in enumerate(self._runs)
        ]

    def _beliefs(self, setup: Setup, simulated: SimulatedRuns) -> Float[np.ndarray, "r m"]:
        """Means of the first beliefs, as `drawn_start` draws them about each run's truth."""
        layout = setup.process.layout
        true = true_states(simulated.truth.chosen(slice(None, None, simulated.epochs)), layout)
        drawn = [np.random.default_rng(each.belief).standard_normal(layout.error_dim) for each in self._seeds]
        return layout.retract(true, np.stack([setup.initial.factor[0] @ each for each in drawn]))


def _tile_factor(setup: Setup, mean: Float[np.ndarray, "r m"]) -> Float[np.ndarray, "r n n"]:
    """The first covariance factor, the same of all runs."""
    return np.tile(setup.belief.state.factor, (len(mean), 1, 1))


def _epochs(setup: Setup, simulated: SimulatedRuns) -> EpochRun:
    """All epochs, with the values of all runs; the first belief holds before the measurements of the first."""
    sensors = []
    for part, stream in zip(sensors_of(setup.timeline), simulated.log.streams, strict=True):
        bound = sensor_of(stream.sensor).bind(stream, setup.process.layout, setup.noise, None)
        every = Measurement(part.every.model, bound.values, bound.parameters)
        sensors.append(SensorTimeline(every, part.first, part.end))
    times = times_of(setup.timeline)
    return EpochRun(np.diff(times, prepend=times[0]), tuple(sensors))


def _evaluation(
    name: str,
    setup: Setup,
    simulated: SimulatedRuns,
    first: Float[np.ndarray, "r m"],
    taken: RunsTaken,
    seconds: float,
) -> Evaluation:
    """Evaluation of all runs together.

    Errors and NEES are computed of one history with the epochs of all runs, one run behind the other.
    """
    layout, times, count = setup.process.layout, times_of(setup.timeline), len(setup.timeline)
    before = {"mean": first[:, np.newaxis], "factor": _tile_factor(setup, first)[:, np.newaxis]}
    arrays = {name: _rows_after_first(before.get(name), values) for name, values in taken.rows.items()}
    long = {key: array.reshape(-1, *array.shape[2:]) for key, array in arrays.items()}
    long["time"] = (times + simulated.period * np.arange(len(first))[:, np.newaxis]).ravel()
    long["runtime"] = np.zeros(len(long["time"]))
    truth, every = simulated.truth, _history(name, setup, long)
    errors, nees = truth_errors(motion_of(every), truth), normalised_errors(every, truth)
    last = slice(simulated.epochs - 1, None, simulated.epochs)
    true = true_states(truth.chosen(last), layout)
    ends = arrays["mean"][:, -1], arrays["factor"][:, -1]
    body = bodies_of(layout, times[-1:].repeat(len(first)), *ends).together
    arrays["time"] = times
    arrays["runtime"] = np.r_[0.0, np.full(count - 1, seconds / (len(first) * (count - 1)))]
    moving = {name: getattr(errors, name) for name in ("position", "attitude", "velocity", "rate")}
    moving = {name: _by_runs(error, count) for name, error in moving.items() if error is not None}
    blocks = {block: _by_runs(values, count) for block, values in nees.blocks.items()}
    evaluation = Evaluation(
        _history(name, setup, arrays, setup.observations),
        errors=replace(errors, time=times, rows=np.arange(count), **moving),
        body_errors=body_errors(body, truth),
        nees=replace(nees, time=times, total=_by_runs(nees.total, count), blocks=blocks),
        last_error=layout.local(ends[0], true),
    )
    evaluation.__dict__["body"] = body
    return evaluation


def _repeat_first(whole: Int[np.ndarray, " w"], arrays: Sequence[np.ndarray]) -> None:
    """Put the first run that was taken in whole in place of those that were not, whose numbers are left out."""
    left = np.setdiff1d(np.arange(len(arrays[0])), whole)
    for array in arrays if left.size else ():
        array[left] = array[whole[0]]


def _by_runs(values: np.ndarray, count: int) -> np.ndarray:
    """Values of all epochs by run and epoch."""
    return values.reshape(-1, count, *values.shape[1:])


def _are_numbers(
    mean: Float[np.ndarray, "r m"], factor: Float[np.ndarray, "r e e"]
) -> Bool[np.ndarray, " r"]:
    """Whether the last belief of each run is of numbers whose squares are numbers, too; what is not stays so."""
    sizes = np.abs(mean).max(axis=1), np.abs(factor).max(axis=(1, 2))
    return (sizes[0] < LARGEST) & (sizes[1] < LARGEST)


def _rows_after_first(before: np.ndarray | None, values: np.ndarray) -> np.ndarray:
    """Rows of each run with its first belief in place of the first, which counts nothing."""
    values[:, :1] = 0 if before is None else before
    return values


def _history(
    name: str, setup: Setup, arrays: dict[str, Any], observations: np.ndarray | None = None
) -> EstimateHistory:
    own = {key: arrays[key] for key in EPOCH_ARRAYS}
    return EstimateHistory(
        name, setup.process.layout, status=NO_VERDICT, initialisation=1, observations=observations, **own
    )
