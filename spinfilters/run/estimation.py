"""Every estimator on one prepared data set."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError, numerical
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.recording_bound import Bounding, with_bounds
from spinfilters.filters.estimator import Estimator
from spinfilters.filters.history import EPOCH_ARRAYS, EstimateHistory, GrowingHistory
from spinfilters.filters.timeline import NO_EPOCH_LEFT, Timeline, rehearse, run_interruptible, times_of
from spinfilters.inference.estimator_entry import AnyEntry
from spinfilters.inference.setup import Setup
from spinfilters.io.input_file import reason
from spinfilters.models.status import EstimatorStatus, Verdict
from spinfilters.run.checkpoints import StoreOf, no_checkpoints
from spinfilters.run.estimators import estimator_entries
from spinfilters.settings.run_settings import Settings
from spinfilters.verdict.calibration_errors import CalibrationErrors
from spinfilters.verdict.doubts import doubts_of, evaluated, with_verdicts
from spinfilters.verdict.tested_models import NOT_TESTED, TestedModels

Progress = Callable[[str, int, int], None]
"""Called with the estimator's name, epochs done and epochs in all."""
Rehearsing = Callable[[Estimator, float, Timeline], None]
"""Takes a twin of an estimator, begun at a time (s), through its first epochs, as `spinfilters.filters.timeline.rehearse`."""


@dataclass(frozen=True)
class Comparison:
    """All evaluations of a run, in the order asked for, and whether Ctrl-C cut it short.

    Attributes
    ----------
    maps: by estimator, the landmarks (k, 3) m in g that it ended with, or the map that all were given; empty without any.
    models: tests of the models' errors.
    """

    setup: Setup
    evaluations: tuple[Evaluation, ...]
    interrupted: bool
    maps: Mapping[str, Float[np.ndarray, "k 3"]] = field(default_factory=dict)
    models: TestedModels = NOT_TESTED


@dataclass(frozen=True)
class ComparisonExtent:
    """Optional work of a comparison besides estimation and diagnostics.

    Attributes
    ----------
    bounding: puts the bound beside the errors.   rehearsing: builds what an estimator needs before its clock runs, by a twin.
    """

    bounding: Bounding = with_bounds
    rehearsing: Rehearsing = rehearse


@dataclass(frozen=True)
class _Company:
    """Observers of an estimator's run."""

    progress: Progress
    store_of: StoreOf
    rehearsing: Rehearsing


def build_estimator(name: str, setup: Setup, settings: Settings) -> Estimator:
    """The estimator of a name that takes this data set epoch by epoch.

    Raises
    ------
    InputError: one that takes it at once.
    """
    entry = estimator_entries()[name]
    if entry.batch(setup, settings) is not None:
        raise InputError(f"{name} takes this data set at once; choose another estimator")
    return entry.build(setup, settings)


def compare_estimators(
    setup: Setup,
    settings: Settings,
    progress: Progress,
    store_of: StoreOf = no_checkpoints,
    extent: ComparisonExtent = ComparisonExtent(),
) -> Comparison:
    """Run, evaluate and judge; Ctrl-C keeps what is done and leaves out the rest.

    Parameters
    ----------
    store_of: gives each estimator's name what keeps its run, `spinfilters.run.checkpoints.checkpoint_stores` for instance.
    extent: what is done beside.

    Raises
    ------
    InputError: an estimator that holds no landmarks, for tracks without a known map; no epoch is left after the start; what was
        kept is damaged or of another run; it cannot be written.
    """
    evaluations: list[Evaluation] = []
    maps: dict[str, np.ndarray] = {}
    interrupted = False
    company = _Company(progress, store_of, extent.rehearsing)
    entries = _fit_entries(settings, setup)
    calibration = CalibrationErrors(setup, settings, entries["mekf"])
    try:
        for name in settings.estimators:
            history, points = _estimated(entries[name], setup, settings, company)
            interrupted = _is_cut_short(history, len(setup.timeline))
            if not interrupted:
                history, interrupted = _with_calibration(calibration, history, entries[name])
            evaluations.append(evaluated(history, setup))
            maps |= _maps(name, points)
            if interrupted:
                break
    except KeyboardInterrupt:
        if not evaluations:
            raise
        interrupted = True
    baselines = frozenset(name for name, entry in entries.items() if entry.is_baseline)
    doubts = doubts_of(evaluations, setup, settings, baselines)
    found = with_verdicts(doubts, settings, entries)
    bounded = found if interrupted else extent.bounding(found, setup)
    return Comparison(setup, tuple(bounded), interrupted, maps, doubts.models)


def _with_calibration(
    calibration: CalibrationErrors, history: EstimateHistory, entry: AnyEntry
) -> tuple[EstimateHistory, bool]:
    """The history with what the calibration's errors make of it, and whether Ctrl-C came before."""
    try:
        return calibration.counted(history, entry), False
    except KeyboardInterrupt:
        return history, True


@np.errstate(all="ignore")  # what is not finite becomes a status
def _estimated(
    entry: AnyEntry, setup: Setup, settings: Settings, company: "_Company"
) -> tuple[EstimateHistory, Float[np.ndarray, "k 3"] | None]:
    """One estimator's history of all epochs, and its landmarks.

    If it has any; numbers that lead nowhere are its failure.
    """
    progress = company.progress
    try:
        batch = entry.batch(setup, settings)
        if batch is not None:
            on_epoch = lambda done, every: progress(entry.name, done, every)  # noqa: E731
            return batch.smooth(setup.timeline, setup.initial, on_epoch), setup.map_points
        estimator, twin = (entry.build(setup, settings) for _ in range(2))
        passed, rows = _run(entry, estimator, twin, setup, company)
        history = _final(entry, estimator, passed, rows, setup)
        history = replace(history, noise=entry.noise(estimator, history, setup))
        return history, entry.points(estimator, history, setup)
    except NUMERICAL_ERRORS as error:
        nothing = GrowingHistory(setup.process.layout, setup.end_of_initialisation)
        failed = EstimatorStatus().failed(f"the estimator could not be run ({reason(numerical(error))})")
        return _with_initialisation(nothing.ended(entry.name, failed), nothing, setup), setup.map_points


def _final(
    entry: AnyEntry,
    estimator: Estimator,
    passed: EstimateHistory,
    rows: GrowingHistory,
    setup: Setup,
) -> EstimateHistory:
    """Final estimates, or those of each epoch as ``failed``.

    The latter where the final ones cannot be computed.
    """
    try:
        history = entry.final(estimator, passed, setup)
    except NUMERICAL_ERRORS as error:
        status = passed.status.failed(
            f"the smoothed epochs could not be computed ({reason(numerical(error))})"
        )
        return _with_initialisation(replace(passed, status=status), rows, setup)
    return _with_initialisation(passed, rows, setup) if history is None else history


def _maps(name: str, points: Float[np.ndarray, "k 3"] | None) -> dict[str, Float[np.ndarray, "k 3"]]:
    """An estimator's landmarks by its name, those that are finite; nothing where it has none."""
    if points is None:
        return {}
    return {name: points[np.isfinite(points).all(axis=1)]}


def _fit_entries(settings: Settings, setup: Setup) -> dict[str, AnyEntry]:
    """Entries of all estimators. InputError: one of the settings that holds no landmarks, where it must."""
    entries = estimator_entries()
    without = [name for name in settings.estimators if not entries[name].holds_landmarks]
    if without and setup.initial.has_landmarks:
        holding = [name for name, entry in entries.items() if entry.holds_landmarks]
        raise InputError(
            f"{', '.join(without)}: holds no landmarks; give the tracks' map (landmarks.csv, for the bundled example "
            f"--known-map), or choose among {', '.join(holding)}"
        )
    return entries


def _remaining(setup: Setup) -> Timeline:
    """Epochs behind the initialisation. InputError: none."""
    rest = setup.timeline[len(setup.initial.mean) :]
    if not len(rest):
        raise InputError(f"{setup.dataset.name}: {NO_EPOCH_LEFT}")
    return rest


def _run(
    entry: AnyEntry,
    estimator: Estimator,
    twin: Estimator,
    setup: Setup,
    company: "_Company",
) -> tuple[EstimateHistory, GrowingHistory]:
    """Run from the last checkpoint, or from the start.

    A run that had ended is not made again.
    Its rows have room for those of the start in front.

    Parameters
    ----------
    twin: built alike; what it needs is built before the clock of the other runs.
    """
    rest, store, name = _remaining(setup), company.store_of(entry.name), entry.name
    entry.begin(estimator, setup)
    kept = store.resume(estimator)
    rows = GrowingHistory(estimator.layout, setup.end_of_initialisation) if kept is None else kept.rows
    rows.reserve(len(rest), len(setup.initial.mean))
    company.progress(name, len(rows), len(rest))
    if kept is not None and kept.status is not None:
        return rows.ended(name, kept.status), rows
    if len(rows) < len(rest):
        entry.begin(twin, setup)
        company.rehearsing(twin, setup.end_of_initialisation, rest)
    with store.running(estimator, rows) as keep:

        def on_epoch(_: int) -> None:
            """Report an epoch and keep it."""
            company.progress(name, len(rows), len(rest))
            keep()

        history = run_interruptible(estimator, rows.time, rest[len(rows) :], on_epoch, rows)
        history = replace(history, name=name)
        if not _is_cut_short(history, len(rest)):
            store.end(estimator, history, rows)
    return history, rows


def _is_cut_short(history: EstimateHistory, epochs: int) -> bool:
    """Whether Ctrl-C ended it: it neither failed nor did all its epochs."""
    return history.status.verdict is not Verdict.FAILED and len(history.time) < epochs


def _with_initialisation(history: EstimateHistory, rows: GrowingHistory, setup: Setup) -> EstimateHistory:
    """A filter's history with its initialisation in front: smoothed epochs, of which nothing is counted."""
    start = setup.initial
    count = len(start.mean)
    before = dict.fromkeys(EPOCH_ARRAYS, np.zeros(count)) | {
        "time": times_of(setup.timeline[:count]),
        "mean": start.mean,
        "factor": start.factor,
        "runtime": setup.initial_runtime,
    }
    return rows.ended(history.name, history.status, before)
