"""Every estimator on one prepared data set: run, evaluate, judge.

The subpackages, in the order of their use. `io` reads files into arrays; `vision` and `lidar` turn images and
scans into such arrays. `models` says how state and sensors behave, and `simulation` draws from the same models. `inference` finds
the first state, inertia and noise levels. `filters` estimate epoch by epoch, and `smoother` solves all epochs by least squares.
`evaluation` computes errors, bounds and all metrics; `verdict` tests the residuals and says what holds; `plots` draws figures and
pages. This package, `run`, calls them for one recording and writes its folder. `api` and `cli` are what users call; `live`,
`campaigns` and `embedded` use the same estimators on a stream, on many recordings, and as C.

Where one more of a kind belongs (a sensor, an estimator, a metric) is one table in docs/reference/packages.md.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError, numerical
from spinfilters.core.plugins import require_made
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.recording_bound import Bounding, with_bounds
from spinfilters.evaluation.stated_errors import with_posterior_distances
from spinfilters.filters.estimator import Estimator
from spinfilters.filters.history import EstimateHistory, GrowingHistory
from spinfilters.filters.timeline import NO_EPOCH_LEFT, Timeline, rehearse, run_interruptible
from spinfilters.inference.estimator_entry import AnyEntry, begin_with_first_epoch
from spinfilters.inference.setup import Setup
from spinfilters.inference.smoother_run import NAME as SMOOTHER
from spinfilters.inference.smoother_run import NOT_GAUSSIAN, smooth_and_sample
from spinfilters.io.input_file import reason
from spinfilters.models.status import EstimatorStatus
from spinfilters.run.checkpoints import StoreOf, no_checkpoints
from spinfilters.run.conditions import Conditions, conditions_of
from spinfilters.run.estimators import estimator_entries
from spinfilters.settings.run_settings import FILTER, Settings
from spinfilters.smoother.mass_posterior import leaves_one_direction_open
from spinfilters.verdict.calibration_errors import CalibrationErrors
from spinfilters.verdict.doubts import MotionFindings, doubts_of, evaluated, with_verdicts
from spinfilters.verdict.filter_diagnostics import motion_diagnostics
from spinfilters.verdict.tested_models import NOT_TESTED, TestedModels

CALIBRATION_ERROR_FILTER: Final = "mekf"
"""Where a smoother with landmarks takes too long to find its calibration errors, this filter's are taken (`CalibrationErrors`)."""
Progress = Callable[[str, int, int], None]
"""Called with the estimator's name, epochs done and epochs in all."""
Rehearsing = Callable[[Estimator, float, Timeline], None]
"""Runs a second copy of an estimator through its first epochs, from a time in s: compiled code is then ready before run times
are measured (`spinfilters.filters.timeline.rehearse`)."""


@dataclass(frozen=True)
class Comparison:
    """All evaluations of a run, in the order asked for, and whether Ctrl-C cut it short.

    Attributes
    ----------
    setup : Setup
        That all estimators share.
    evaluations : tuple[Evaluation, ...]
        With their verdicts.
    interrupted : bool
        Whether epochs or estimators are missing.
    maps : Mapping[str, (k, 3) float array]
        By estimator, the landmarks (m, frame g) that it ended with, or the map that all were given; empty without any.
    models : TestedModels
        Tests of the models' errors.
    """

    setup: Setup
    evaluations: tuple[Evaluation, ...]
    interrupted: bool
    maps: Mapping[str, Float[np.ndarray, "k 3"]] = field(default_factory=dict)
    models: TestedModels = NOT_TESTED

    @cached_property
    def conditions(self) -> Conditions:
        """Map, noise and seed of the run, and what contradicts itself in the data set's truth."""
        return conditions_of(self.setup)


OnEstimate = Callable[[Setup, Sequence[Evaluation], Mapping[str, np.ndarray]], None]
"""Called with the setup, the evaluations so far, whose verdicts are still to come, and their maps."""


def not_watched(_setup: Setup, _evaluations: Sequence[Evaluation], _maps: Mapping[str, np.ndarray]) -> None:
    """Do nothing after an estimator."""


@dataclass(frozen=True)
class ComparisonExtent:
    """Optional work of a comparison besides estimation and verdict.

    Attributes
    ----------
    bounding : Bounding
        Adds the bounds to the errors.
    rehearsing : Rehearsing or None
        Runs a second copy of an estimator first, so that compiled code is ready before its run time is measured; None where nobody
        looks at run times, and no copy is made.
    on_estimate : OnEstimate
        Called after every estimator, before the verdicts.
    motion_findings : MotionFindings
        What the motion leaves undetermined, the same for every estimator of a setup.
    """

    bounding: Bounding = with_bounds
    rehearsing: Rehearsing | None = rehearse
    on_estimate: OnEstimate = not_watched
    motion_findings: MotionFindings = motion_diagnostics


@dataclass(frozen=True)
class _RunObservers:
    """Callbacks of an estimator's run: progress, checkpoints, and the rehearsal before its run time is measured."""

    progress: Progress
    store_of: StoreOf
    rehearsing: Rehearsing | None


def build_estimator(name: str, setup: Setup, settings: Settings) -> Estimator:
    """The estimator of that name, for a data set that it takes epoch by epoch.

    Raises
    ------
    InputError
        This estimator solves all epochs in one batch.
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
    setup : Setup
        Of the data set (`spinfilters.run.preparation.prepare`).
    settings : Settings
        Its estimators are run in their order.
    progress : Progress
        Called at every epoch.
    store_of : StoreOf
        Gives the store of the checkpoints by the estimator's name, as `spinfilters.run.checkpoints.checkpoint_stores`.
    extent : ComparisonExtent
        Optional work.

    Raises
    ------
    InputError
        Tracks without a known map, and an estimator that holds no landmarks.
        No epoch is left after those of the initialisation.
        A checkpoint is damaged, belongs to another run, or cannot be written.
    """
    evaluations: list[Evaluation] = []
    maps: dict[str, np.ndarray] = {}
    interrupted = False
    observers = _RunObservers(progress, store_of, extent.rehearsing)
    entries = _fitting_entries(settings, setup)
    calibration = CalibrationErrors(setup, settings, entries[CALIBRATION_ERROR_FILTER])
    try:
        for name in settings.estimators:
            history, points = _run_estimator(entries[name], setup, settings, observers)
            interrupted = _is_cut_short(history, len(setup.timeline))
            if not interrupted:
                try:
                    history = calibration.counted(history, entries[name])
                except KeyboardInterrupt:  # its epochs are complete and stay in the result
                    interrupted = True
            evaluations.append(evaluated(history, setup))
            if points is not None:
                maps[name] = points[np.isfinite(points).all(axis=1)]
            if interrupted:
                break
            extent.on_estimate(setup, evaluations, maps)
    except KeyboardInterrupt:
        if not evaluations:
            raise
        interrupted = True
    baselines = frozenset(name for name, entry in entries.items() if entry.is_baseline)
    if not interrupted:
        evaluations = _with_sampled_moments(evaluations, setup, settings, entries)
    untested = frozenset(name for name, entry in entries.items() if not entry.tests_noise)
    doubts = doubts_of(evaluations, setup, settings, baselines, untested, extent.motion_findings)
    with_verdict = with_posterior_distances(with_verdicts(doubts, settings, entries))
    bounded = with_verdict if interrupted else extent.bounding(with_verdict, setup)
    return Comparison(setup, tuple(bounded), interrupted, maps, doubts.models)


def _with_sampled_moments(
    evaluations: list[Evaluation], setup: Setup, settings: Settings, entries: Mapping[str, AnyEntry]
) -> list[Evaluation]:
    """Filters with samples of the moments' posterior where their last belief hardly determines one direction of the inertia.

    The posterior after the last epoch is the same for every estimator: the smoother's samples serve where it is in the run. A
    filter's own Gaussian is centred at the mode that the first epochs have, not at the posterior's mean. Others' estimators stay
    as they are.
    """

    def is_open(each: Evaluation) -> bool:
        own, entry = each.history, entries[each.name]
        is_filter = (entry.continues or entry.forgets) and not entry.is_baseline
        return (
            is_filter and not own.has_failed and leaves_one_direction_open(own.layout, own.belief(-1).factor)
        )

    if setup.is_given or setup.initial.has_landmarks:
        return evaluations
    left_open = {each.name for each in evaluations if is_open(each)}
    if not left_open:
        return evaluations
    smoothed = next((each.history for each in evaluations if each.name == SMOOTHER), None)
    if smoothed is None:
        try:
            smoothed = smooth_and_sample(setup, settings, lambda *_: None)
        except (InputError, *NUMERICAL_ERRORS):
            return evaluations
    if smoothed.has_failed:
        return evaluations
    doubts = [found for found in smoothed.status.findings if found.check == NOT_GAUSSIAN]

    def sampled(history: EstimateHistory) -> EstimateHistory:
        """A filter's history with the smoother's samples, or with the doubt that there are none to rely upon."""
        status = history.status
        for doubt in doubts:
            status = status.doubted(doubt)
        return replace(history, mass=smoothed.mass, status=status)

    if smoothed.mass is None and not doubts:
        return evaluations
    return [
        evaluated(sampled(each.history), setup) if each.name in left_open else each for each in evaluations
    ]


def _fitting_entries(settings: Settings, setup: Setup) -> dict[str, AnyEntry]:
    """Entries of all estimators. InputError: a chosen estimator cannot hold landmarks, and the data set has some."""
    entries = estimator_entries()
    without = [name for name in settings.estimators if not entries[name].holds_landmarks]
    if without and setup.maps_landmarks:
        holding = [name for name, entry in entries.items() if entry.holds_landmarks]
        raise InputError(
            f"{', '.join(without)}: holds no landmarks; give the tracks' map (landmarks.csv, for the bundled example "
            f"--known-map), or choose among {', '.join(holding)}"
        )
    if not (setup.is_given and setup.maps_landmarks):
        return entries
    smoothed = [name for name in settings.estimators if not entries[name].continues]
    if smoothed:
        raise InputError(
            f"{', '.join(smoothed)}: begins with smoothed first epochs where landmarks are not known, not from a belief; leave it "
            "out, as with --estimators mekf,ukf, or give the tracks' map (landmarks.csv)"
        )
    if settings.verdict != FILTER:
        raise InputError(
            "from a belief, filters that find the landmarks themselves are over-confident (by a third in the mean), and no "
            "smoother shows it: use --verdict filter, whose estimates are degraded at best, give the tracks' map "
            "(landmarks.csv), or leave the belief out"
        )
    return entries


@np.errstate(all="ignore")  # what is not finite becomes a status
def _run_estimator(
    entry: AnyEntry, setup: Setup, settings: Settings, observers: _RunObservers
) -> tuple[EstimateHistory, Float[np.ndarray, "k 3"] | None]:
    """One estimator's history of all epochs, and its landmarks if it has any; numerical trouble is its failure."""
    try:
        batch = entry.batch(setup, settings)
        if batch is not None:
            on_epoch = lambda done, every: observers.progress(entry.name, done, every)  # noqa: E731
            return batch.smooth(setup.timeline, setup.initial, on_epoch), setup.map_points
        what = f"estimator {entry.name!r}"
        copies = 1 if observers.rehearsing is None else 2
        estimator, *twins = (
            require_made(entry.build(setup, settings), Estimator, what) for _ in range(copies)
        )
        filtered, record = _run_epochs(entry, estimator, twins, setup, observers)
        history = _final_history(entry, estimator, filtered, record, setup)
        history = replace(history, noise=entry.noise(estimator, history, setup))
        return history, entry.points(estimator, history, setup)
    except NUMERICAL_ERRORS as error:
        empty_record = GrowingHistory(setup.process.layout, setup.end_of_initialisation)
        failed = EstimatorStatus().failed(f"the estimator could not be run ({reason(numerical(error))})")
        history = _with_initialisation(empty_record.ended(entry.name, failed), empty_record, setup)
        return history, setup.map_points


def _run_epochs(
    entry: AnyEntry,
    estimator: Estimator,
    twins: Sequence[Estimator],
    setup: Setup,
    observers: _RunObservers,
) -> tuple[EstimateHistory, GrowingHistory]:
    """Estimate the epochs after the initialisation, from the last checkpoint if there is one; a finished run is only read.

    Parameters
    ----------
    twins : sequence of Estimator
        A copy that runs first, so that compiled code is ready before the run time of ``estimator`` is measured, or none.

    Returns
    -------
    history : EstimateHistory
        Of these epochs.
    record : GrowingHistory
        Its rows as they grow, with room in front for the epochs of the initialisation.
    """
    rest, name = setup.timeline[len(setup.initial.mean) :], entry.name
    if not len(rest):
        raise InputError(f"{setup.dataset.name}: {NO_EPOCH_LEFT}")
    store = observers.store_of(name)
    begin_with_first_epoch(entry, estimator, setup)
    checkpoint = store.resume(estimator)
    record = (
        GrowingHistory(estimator.layout, setup.end_of_initialisation)
        if checkpoint is None
        else checkpoint.rows
    )
    record.reserve(len(rest), len(setup.initial.mean))
    observers.progress(name, len(record), len(rest))
    if checkpoint is not None and checkpoint.status is not None:
        return record.ended(name, checkpoint.status), record
    if len(record) < len(rest) and observers.rehearsing is not None:
        for twin in twins:
            begin_with_first_epoch(entry, twin, setup)
            observers.rehearsing(twin, setup.end_of_initialisation, rest)
    with store.running(estimator, record) as save_checkpoint:

        def on_epoch(_: int) -> None:
            """Report an epoch, and write a checkpoint when one is due."""
            observers.progress(name, len(record), len(rest))
            save_checkpoint()

        history = run_interruptible(estimator, record.time, rest[len(record) :], on_epoch, record)
        history = replace(history, name=name)
        if not _is_cut_short(history, len(rest)):
            store.end(estimator, history, record)
    return history, record


def _final_history(
    entry: AnyEntry,
    estimator: Estimator,
    filtered: EstimateHistory,
    record: GrowingHistory,
    setup: Setup,
) -> EstimateHistory:
    """Final estimates. Where they cannot be computed, the filtered estimates of each epoch, with the verdict ``failed``."""
    try:
        history = entry.final(estimator, filtered, setup)
    except NUMERICAL_ERRORS as error:
        status = filtered.status.failed(
            f"the smoothed epochs could not be computed ({reason(numerical(error))})"
        )
        return _with_initialisation(replace(filtered, status=status), record, setup)
    return _with_initialisation(filtered, record, setup) if history is None else history


def _is_cut_short(history: EstimateHistory, epochs: int) -> bool:
    """Whether Ctrl-C ended it: it did not fail, and did not do all its epochs or was stopped after the last one."""
    was_told = any(each.check == "interrupted" for each in history.status.findings)
    return not history.has_failed and (was_told or len(history.time) < epochs)


def _with_initialisation(history: EstimateHistory, record: GrowingHistory, setup: Setup) -> EstimateHistory:
    """A filter's history with its initialisation in front: smoothed epochs, which no error or count includes."""
    return record.ended(history.name, history.status, setup.initial_arrays)
