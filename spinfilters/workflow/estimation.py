"""Every estimator on one prepared data set."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from spinfilters.errors import NUMERICAL_ERRORS, InputError
from spinfilters.estimators.estimator import Estimator
from spinfilters.estimators.history import FRAME_ARRAYS, EstimateHistory, GrowingHistory
from spinfilters.estimators.run import NO_FRAME_LEFT, rehearse, run
from spinfilters.estimators.timeline import Timeline, times_of
from spinfilters.evaluation.errors import Alignment
from spinfilters.evaluation.evaluation import Evaluation, evaluate
from spinfilters.logs.input_file import reason
from spinfilters.state.status import EstimatorStatus, Verdict
from spinfilters.workflow.bound import Bounding, with_bounds
from spinfilters.workflow.checkpointing import KeeperOf, forget
from spinfilters.workflow.estimator_entry import AnyEntry, estimator_entries
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.quality import filter_doubts, judged, shared_doubts
from spinfilters.workflow.settings import Settings

Progress = Callable[[str, int, int], None]
"""Called with the estimator's name, frames done and frames in all."""
Rehearsing = Callable[[Estimator, float, Timeline], None]
"""Takes a twin of an estimator, begun at a time (s), through the first of its frames, as `spinfilters.estimators.run.rehearse`."""


@dataclass(frozen=True)
class Comparison:
    """All evaluations of a run, in the order asked for, and whether Ctrl-C cut it short.

    Attributes
    ----------
    maps: by estimator, the landmarks (k, 3) m in g that it ended with, or the map that all were given; empty without any.
    """

    prepared: Prepared
    evaluations: tuple[Evaluation, ...]
    interrupted: bool
    maps: Mapping[str, Float[np.ndarray, "k 3"]] = field(default_factory=dict)


@dataclass(frozen=True)
class ComparisonExtent:
    """What a comparison does beside running and judging.

    Attributes
    ----------
    bounding: puts the bound beside the errors.   rehearsing: builds what an estimator needs before its clock runs, by a twin.
    """

    bounding: Bounding = with_bounds
    rehearsing: Rehearsing = rehearse


@dataclass(frozen=True)
class _Company:
    """Who follows an estimator's run."""

    progress: Progress
    keeper_of: KeeperOf
    rehearsing: Rehearsing


def build_estimator(name: str, prepared: Prepared, settings: Settings) -> Estimator:
    """The estimator of a name that takes this data set epoch by epoch.

    Raises
    ------
    InputError: one that takes it at once.
    """
    entry = estimator_entries()[name]
    if entry.batch(prepared, settings) is not None:
        raise InputError(f"{name} takes this data set at once; choose another estimator")
    return entry.build(prepared, settings)


def compare_estimators(
    prepared: Prepared,
    settings: Settings,
    progress: Progress,
    keeper_of: KeeperOf = forget,
    extent: ComparisonExtent = ComparisonExtent(),
) -> Comparison:
    """Run, evaluate and judge; Ctrl-C keeps what is done and leaves out the rest.

    Parameters
    ----------
    keeper_of: gives each estimator's name what keeps its run, `spinfilters.workflow.checkpointing.keep_in` for instance.
    extent: what is done beside.

    Raises
    ------
    InputError: an estimator that holds no landmarks, for tracks without a known map; no frame is left after the start; what was
        kept is damaged or of another run; it cannot be written.
    """
    evaluations: list[Evaluation] = []
    maps: dict[str, np.ndarray] = {}
    interrupted = False
    _check(settings, prepared)
    entries = estimator_entries()
    try:
        for name in settings.estimators:
            with np.errstate(all="ignore"):  # what is not finite becomes a status
                history, points = _estimated(
                    entries[name], prepared, settings, _Company(progress, keeper_of, extent.rehearsing)
                )
            evaluations.append(_evaluated(history, prepared))
            maps |= _maps(name, points)
            interrupted = _is_cut_short(history, len(prepared.timeline))
            if interrupted:
                break
    except KeyboardInterrupt:
        if not evaluations:
            raise
        interrupted = True
    judged_ones = _judge(evaluations, prepared, settings)
    bounded = judged_ones if interrupted else extent.bounding(judged_ones, prepared)
    return Comparison(prepared, tuple(bounded), interrupted, maps)


def _estimated(
    entry: AnyEntry, prepared: Prepared, settings: Settings, company: "_Company"
) -> tuple[EstimateHistory, Float[np.ndarray, "k 3"] | None]:
    """One estimator's history of all epochs, and its landmarks if it has any; numbers that lead nowhere are its failure."""
    progress = company.progress
    try:
        batch = entry.batch(prepared, settings)
        if batch is not None:
            on_epoch = lambda done, every: progress(entry.name, done, every)  # noqa: E731
            return batch.smooth(prepared.timeline, prepared.start, on_epoch), prepared.map_points
        estimator, twin = (entry.build(prepared, settings) for _ in range(2))
        passed, rows = _run(entry, estimator, twin, prepared, company)
        history = _final(entry, estimator, passed, rows, prepared)
        return history, entry.points(estimator, history, prepared)
    except NUMERICAL_ERRORS as error:
        nothing = GrowingHistory(prepared.process.layout, prepared.start_end)
        failed = EstimatorStatus().failed(f"the estimator could not be run ({reason(error)})")
        return _with_start(nothing.ended(entry.name, failed), nothing, prepared), prepared.map_points


def _final(
    entry: AnyEntry,
    estimator: Estimator,
    passed: EstimateHistory,
    rows: GrowingHistory,
    prepared: Prepared,
) -> EstimateHistory:
    """What the estimator says in the end; where that cannot be computed, what it said of each epoch as it came, as ``failed``."""
    try:
        history = entry.final(estimator, passed, prepared)
    except NUMERICAL_ERRORS as error:
        status = passed.status.failed(f"the smoothed frames could not be computed ({reason(error)})")
        return _with_start(replace(passed, status=status), rows, prepared)
    return _with_start(passed, rows, prepared) if history is None else history


def _maps(name: str, points: Float[np.ndarray, "k 3"] | None) -> dict[str, Float[np.ndarray, "k 3"]]:
    """An estimator's landmarks by its name, those that are finite; nothing where it has none."""
    if points is None:
        return {}
    return {name: points[np.isfinite(points).all(axis=1)]}


def _check(settings: Settings, prepared: Prepared) -> None:
    entries = estimator_entries()
    without = [name for name in settings.estimators if not entries[name].holds_landmarks]
    if without and prepared.start.has_landmarks:
        holding = [name for name, entry in entries.items() if entry.holds_landmarks]
        raise InputError(
            f"{', '.join(without)}: holds no landmarks; give the tracks' map (landmarks.csv, for the bundled example "
            f"--known-map), or choose among {', '.join(holding)}"
        )


def _run(
    entry: AnyEntry,
    estimator: Estimator,
    twin: Estimator,
    prepared: Prepared,
    company: "_Company",
) -> tuple[EstimateHistory, GrowingHistory]:
    """From where the keeper left off, or from the start; a run that had ended is not made again.

    Its rows have room for those of the start in front.

    Parameters
    ----------
    twin: built alike; what it needs is built before the clock of the other runs.
    """
    rest = prepared.timeline[len(prepared.start.mean) :]
    if not len(rest):
        raise InputError(f"{prepared.dataset.name}: {NO_FRAME_LEFT}")
    progress, keeper = company.progress, company.keeper_of(entry.name)
    entry.begin(estimator, prepared)
    kept = keeper.resume(estimator)
    rows = GrowingHistory(estimator.layout, prepared.start_end) if kept is None else kept.rows
    rows.reserve(len(rest), len(prepared.start.mean))
    name = entry.name
    progress(name, len(rows), len(rest))
    if kept is not None and kept.status is not None:
        return rows.ended(name, kept.status), rows
    if len(rows) < len(rest):
        entry.begin(twin, prepared)
        company.rehearsing(twin, prepared.start_end, rest)
    with keeper.running(estimator, rows) as keep:

        def on_frame(_: int) -> None:
            progress(name, len(rows), len(rest))
            keep()

        history = replace(run(estimator, rows.time, rest[len(rows) :], on_frame, rows), name=name)
        if not _is_cut_short(history, len(rest)):
            keeper.end(estimator, history, rows)
    return history, rows


def _is_cut_short(history: EstimateHistory, frames: int) -> bool:
    """Whether Ctrl-C ended it: it neither failed nor did all its frames."""
    return history.status.verdict is not Verdict.FAILED and len(history.time) < frames


def _with_start(history: EstimateHistory, rows: GrowingHistory, prepared: Prepared) -> EstimateHistory:
    """A filter's history with its initialisation in front: smoothed epochs, of which nothing is counted."""
    start = prepared.start
    count = len(start.mean)
    before = dict.fromkeys(FRAME_ARRAYS, np.zeros(count)) | {
        "time": times_of(prepared.timeline[:count]),
        "mean": start.mean,
        "factor": start.factor,
    }
    return rows.ended(history.name, history.status, before)


def _evaluated(history: EstimateHistory, prepared: Prepared) -> Evaluation:
    alignment = Alignment.NONE if prepared.known_frames else Alignment.FIRST_FRAME
    observed = replace(history, observations=prepared.observations[: len(history.time)])
    return evaluate(observed, prepared.dataset.truth, alignment)


def _judge(evaluations: list[Evaluation], prepared: Prepared, settings: Settings) -> list[Evaluation]:
    doubts, of_filters = shared_doubts(prepared), filter_doubts(prepared)
    entries = estimator_entries()
    peers = [evaluation for evaluation in evaluations if not entries[evaluation.name].is_baseline]
    judged_ones = []
    for evaluation in evaluations:
        entry = entries[evaluation.name]
        others = [peer for peer in peers if peer.history.status.verdict is not Verdict.FAILED]
        own = [*doubts, *of_filters] if entry.continues else doubts
        status = judged(evaluation, own, others, entry.false_alarm_probability(prepared, settings))
        judged_ones.append(evaluation.with_status(status))
    return judged_ones
