"""One run of a study: simulate, initialise, estimate, evaluate; always one row."""

import platform
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime
from functools import cached_property, lru_cache
from importlib.metadata import version
from typing import Any, Final, TypeVar

import numpy as np

from spinfilters.campaigns.recording_factors import (
    RecordingFactors,
    prepared_about_truth,
    prepared_with_drawn_belief,
)
from spinfilters.campaigns.row_columns import TIMES, bound_columns, noise_columns, result_columns
from spinfilters.campaigns.study import CampaignRun, Cell, Study
from spinfilters.core.errors import SpinfiltersError
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.metrics import metrics
from spinfilters.evaluation.recording_bound import with_bounds, without_bounds
from spinfilters.inference.setup import Setup
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import printable
from spinfilters.models.status import Finding
from spinfilters.run.estimation import Comparison, ComparisonExtent, compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.run.readers import read_dataset
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.measurement_faults import with_faults
from spinfilters.simulation.model_faults import faulty_recording, model_faults
from spinfilters.simulation.scenario import Motion, measured, motion_in_view, without_map, without_noise
from spinfilters.verdict.filter_diagnostics import motion_diagnostics


@dataclass(frozen=True)
class RunSeeds:
    """Independent generators of seed number ``seed``, that child of ``SeedSequence(root)``: the same for every cell.

    Each is made when it is first asked for, as child k of that child: most runs need three of them.
    """

    root: int
    seed: int

    @cached_property
    def motion(self) -> np.random.SeedSequence:
        """Of the drawn motion."""
        return self._child(0)

    @cached_property
    def measurements(self) -> np.random.SeedSequence:
        """Of the noise."""
        return self._child(1)

    @cached_property
    def faults(self) -> np.random.SeedSequence:
        """Of the faults."""
        return self._child(2)

    @cached_property
    def belief(self) -> np.random.SeedSequence:
        """Of the initial belief."""
        return self._child(3)

    @cached_property
    def factors(self) -> np.random.SeedSequence:
        """Of numbers of factors that are drawn."""
        return self._child(4)

    def _child(self, number: int) -> np.random.SeedSequence:
        return np.random.SeedSequence(self.root, spawn_key=(self.seed, number))


@lru_cache(maxsize=64)
def run_seeds(root: int, seed: int) -> RunSeeds:
    """Generators of a seed, those of the latest seeds kept: a run asks for them several times."""
    return RunSeeds(root, seed)


def whole_number(sequence: np.random.SeedSequence) -> int:
    """A seed sequence as a number below 2^63."""
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1))


LONGEST_REASON: Final = 500
"""Characters of a row's reason."""
PACKAGES: Final = ("numpy", "scipy", "casadi")
Row = dict[str, Any]
T = TypeVar("T")


class Runner:
    """Runs of a study, one at a time and independent of their order."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self._latest: dict[str, tuple[object, Any]] = {}
        self._bounds: dict[int, dict[str, Any]] = {}
        self._spent = dict.fromkeys(TIMES, 0.0)
        self._metrics = metrics()
        self.versions = _versions()

    def row(self, index: int) -> Row:
        """Row of a run; an error of the run is recorded in it."""
        run, begin = self.study.run(index), time.perf_counter()
        self._spent = dict.fromkeys(TIMES, 0.0)
        try:
            result = self._result(run)
        except KeyboardInterrupt:
            raise
        except SpinfiltersError as error:
            result = {"outcome": "refused", "reason": _short(str(error))}
        except Exception as error:  # one run's fault is that run's row
            result = {"outcome": "raised", "reason": _short(f"{type(error).__name__}: {error}")}
        spent = {f"time_{name}_s": seconds for name, seconds in self._spent.items()}
        taken = {"time_total_s": time.perf_counter() - begin}
        return asked(self.study, index) | result | self.versions | spent | taken | when_and_where()

    def recording(self, run: CampaignRun) -> Dataset:
        """The data set of a run."""
        path = self.study.cells[run.cell].own_recording
        if path:
            return self._cache_latest("recording", path, lambda: read_dataset(path))
        factors = self._factors(run)
        return self._cache_latest("recording", (run.seed, factors), lambda: self._simulated(run, factors))

    def setup(self, run: CampaignRun) -> Setup:
        """The run's data set, initialised."""
        cell = self.study.cells[run.cell]
        dataset = self.recording(run)
        with self._timed("initialise"):
            return self._cache_latest(
                "prepared", self._setup_key(run), lambda: self._initialised(run, cell, dataset)
            )

    def _setup_key(self, run: CampaignRun) -> tuple[Any, ...]:
        """What runs of the same initialisation have in common."""
        cell = self.study.cells[run.cell]
        tables = (
            getattr(cell.settings, name) for name in ("process", "sensors", "initialisation", "landmarks")
        )
        return cell.own_recording, run.seed, self._factors(run), cell.belief, *tables

    def compared(self, run: CampaignRun, with_bound: bool) -> Comparison:
        """The run's estimator, evaluated."""
        setup, settings = self.setup(run), self.study.cells[run.cell].settings
        extent = ComparisonExtent(
            with_bounds if with_bound else without_bounds,
            rehearsing=None,
            motion_findings=lambda *_: self._motion_findings(run, setup, settings),
        )
        with self._timed("estimate"):
            found = compare_estimators(setup, settings, lambda *_: None, extent=extent)
        if found.interrupted:
            raise KeyboardInterrupt
        return found

    def _motion_findings(self, run: CampaignRun, setup: Setup, settings: Settings) -> Sequence[Finding]:
        """Findings of a recording's motion, asked once of all estimators with the same settings."""
        others = [getattr(settings, each.name) for each in fields(settings) if each.name != "estimators"]
        key = (self._setup_key(run), *others)
        return self._cache_latest("motion findings", key, lambda: motion_diagnostics(setup, settings))

    def _result(self, run: CampaignRun) -> Row:
        bound = self.study.options.bound
        comparison = self.compared(run, bound == "run")
        (evaluation,) = comparison.evaluations
        with self._timed("evaluate"):
            shared = self.shared_begin(run)
            found = result_columns(evaluation, shared, self._metrics) | self._levels(run, evaluation)
            found["model_errors"] = " ".join(comparison.models.names)
        limits = self.motion_bound(run) if bound == "motion" else bound_columns(evaluation, shared)
        return {"outcome": "done", "reason": ""} | found | limits

    def shared_begin(self, run: CampaignRun) -> float | None:
        """Time of the first epoch after the filters' initialisation, s; None where each estimator has its own epochs."""
        if self.study.options.epochs == "own":
            return None
        setup = self.setup(run)
        return setup.timeline[min(len(setup.initial.mean), len(setup.timeline) - 1)].time

    def _levels(self, run: CampaignRun, evaluation: Evaluation) -> Row:
        """True and identified levels of noise."""
        identified = evaluation.history.noise or self.setup(run).identified
        is_own = bool(self.study.cells[run.cell].own_recording)
        return noise_columns(identified, {} if is_own else self._factors(run).levels)

    def motion_bound(self, run: CampaignRun) -> dict[str, Any]:
        """The bound of the cell's first seed."""
        if run.cell not in self._bounds:
            spent = self._spent
            self._spent = dict.fromkeys(TIMES, 0.0)
            try:
                first = self.study.run(run.cell)
                (evaluation,) = self.compared(first, with_bound=True).evaluations
                self._bounds[run.cell] = bound_columns(evaluation, self.shared_begin(first))
            except SpinfiltersError:
                self._bounds[run.cell] = {}
            self._spent = spent
        return self._bounds[run.cell]

    def _factors(self, run: CampaignRun) -> RecordingFactors:
        """Factors of the run's recording."""
        seeds = run_seeds(self.study.options.root_seed, run.seed)
        return self.study.cells[run.cell].recording_of(seeds.factors)

    def _simulated(self, run: CampaignRun, factors: RecordingFactors) -> Dataset:
        with self._timed("simulate"):
            seeds, scenario = run_seeds(self.study.options.root_seed, run.seed), factors.scenario
            if model := factors.fault.model:
                fault, drawn = model_faults()[model], (seeds.motion, seeds.measurements, seeds.faults)
                dataset = faulty_recording(scenario, fault, factors.fault.model_size * fault.size, drawn)
                return self._hide_from_estimators(dataset, factors, seeds)
            key = (run.seed, factors.motion, factors.body, scenario.noise, scenario.kinds)
            motion: Motion = self._cache_latest(
                "motion", key, lambda: motion_in_view(scenario, np.random.default_rng(seeds.motion))
            )
            dataset = measured(scenario, motion, np.random.default_rng(seeds.measurements))
            return self._hide_from_estimators(dataset, factors, seeds)

    def _hide_from_estimators(self, dataset: Dataset, factors: RecordingFactors, seeds: RunSeeds) -> Dataset:
        """Recording as estimators get it: without what the study leaves unstated, with the faults of its measurements."""
        if not factors.sensor.known_map:
            dataset = without_map(dataset)
        if not factors.noise.stated:
            dataset = without_noise(dataset)
        if not factors.noise.calibrated:
            dataset = replace(dataset, options=replace(dataset.options, calibration={}))
        return with_faults(dataset, factors.fault.faults, whole_number(seeds.faults))

    def _initialised(self, run: CampaignRun, cell: Cell, dataset: Dataset) -> Setup:
        if self.study.options.initialisation == "data":
            return prepare(dataset, cell.settings)
        if cell.own_recording:
            drawn = int(run_seeds(self.study.options.root_seed, run.seed).belief.generate_state(1)[0])
            return prepared_about_truth(dataset, cell.settings, cell.belief, drawn)
        generator = np.random.default_rng(run_seeds(self.study.options.root_seed, run.seed).belief)
        return prepared_with_drawn_belief(dataset, cell.settings, cell.belief, generator)

    def _cache_latest(self, what: str, key: object, make: Callable[[], T]) -> T:
        """The latest result, made again where its key differs."""
        if what not in self._latest or self._latest[what][0] != key:
            self._latest.pop(what, None)
            self._latest[what] = (key, make())
        return self._latest[what][1]

    @contextmanager
    def _timed(self, what: str) -> Iterator[None]:
        begin = time.process_time()
        try:
            yield
        finally:
            self._spent[what] += time.process_time() - begin


def asked(study: Study, index: int) -> Row:
    """Columns of a row that identify the run and its factors."""
    run = study.run(index)
    return {"run": index, "cell": run.cell, "seed": run.seed, **study.cells[run.cell].levels}


def ended(study: Study, index: int, outcome: str, reason: str, seconds: float) -> Row:
    """The row of a run whose process was ended."""
    result = {"outcome": outcome, "reason": _short(reason), "time_total_s": seconds}
    return asked(study, index) | result | _versions() | when_and_where()


def when_and_where() -> Row:
    """When and where a run was made."""
    return {"finished": datetime.now(UTC).isoformat(timespec="milliseconds"), "host": platform.node()}


def _versions() -> Row:
    packages = " ".join(
        [f"python {platform.python_version()}", *(f"{name} {version(name)}" for name in PACKAGES)]
    )
    return {"version": version("spinfilters"), "packages": packages}


def _short(text: str) -> str:
    return printable(" ".join(text.split()))[:LONGEST_REASON]
