"""Every estimator on the identical measurements of one prepared data set."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Estimator
from spinfilters.estimators.history import EstimateHistory, GrowingHistory
from spinfilters.estimators.landmarks.belief import LandmarkBelief
from spinfilters.estimators.multiplicative_ekf import MultiplicativeEkf
from spinfilters.estimators.multiplicative_filter import MultiplicativeFilter
from spinfilters.estimators.multiplicative_ukf import MultiplicativeUkf
from spinfilters.estimators.run import run
from spinfilters.estimators.smoothing.recursive import RecursiveSmoother
from spinfilters.evaluation.errors import Alignment
from spinfilters.evaluation.evaluation import Evaluation, evaluate
from spinfilters.state.status import Verdict
from spinfilters.workflow.bound import with_bounds
from spinfilters.workflow.checkpointing import Keeper, KeeperOf, forget
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.quality import filter_doubts, judged, shared_doubts
from spinfilters.workflow.settings import Settings
from spinfilters.workflow.smoothing import NAME as SMOOTHER
from spinfilters.workflow.smoothing import begin_at_start, sliding_smoother, smooth_at_once, smoothed_history

OURS = ("mekf", "ukf", SMOOTHER)
"""Estimators whose disagreement casts doubt; a baseline that goes astray says nothing of them."""

Progress = Callable[[str, int, int], None]
"""Called with the estimator's name, frames done and frames in all."""


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


def build_estimator(name: str, prepared: Prepared, settings: Settings) -> Estimator:
    """The estimator of a name in `spinfilters.workflow.settings.ESTIMATORS`; filterpy's need a known map or none at all."""
    process, robust, adaptation = prepared.process, settings.robust, settings.adaptation
    if name == "mekf":
        return MultiplicativeEkf(process, robust, adaptation, settings.iteration, settings.landmarks)
    if name == "ukf":
        return MultiplicativeUkf(process, settings.ukf, robust, adaptation, settings.landmarks)
    from spinfilters.estimators.filterpy_baselines import (
        FilterpyEkf,
        FilterpyUkf,
    )  # slow to import, rarely asked for

    return FilterpyEkf(prepared.process) if name == "filterpy-ekf" else FilterpyUkf(prepared.process)


def compare_estimators(
    prepared: Prepared, settings: Settings, progress: Progress, keeper_of: KeeperOf = forget
) -> Comparison:
    """Run, evaluate and judge; Ctrl-C keeps what is done and leaves out the rest.

    Parameters
    ----------
    keeper_of: gives each estimator's name what keeps its run, `spinfilters.workflow.checkpointing.keep_in` for instance.

    Raises
    ------
    InputError: an estimator that holds no landmarks, for tracks without a known map; no frame is left after the start; what was
        kept is damaged or of another run; it cannot be written.
    """
    evaluations: list[Evaluation] = []
    maps: dict[str, np.ndarray] = {}
    interrupted = False
    _check(settings, prepared)
    try:
        for name in settings.estimators:
            history, points = _estimated(name, prepared, settings, (progress, keeper_of))
            evaluations.append(_evaluated(history, prepared))
            maps |= {} if points is None else {name: points}
            interrupted = _is_cut_short(history, len(prepared.timeline))
            if interrupted:
                break
    except KeyboardInterrupt:
        if not evaluations:
            raise
        interrupted = True
    judged_ones = _judge(evaluations, prepared)
    bounded = judged_ones if interrupted else with_bounds(judged_ones, prepared)
    return Comparison(prepared, tuple(bounded), interrupted, maps)


def _estimated(
    name: str, prepared: Prepared, settings: Settings, follow: tuple[Progress, KeeperOf]
) -> tuple[EstimateHistory, Float[np.ndarray, "k 3"] | None]:
    """One estimator's history of all frames, and its landmarks if it has any."""
    progress, keeper_of = follow
    if name == SMOOTHER:
        smoother = sliding_smoother(prepared, settings)
        if smoother is None:
            history = smooth_at_once(prepared, settings, lambda done, every: progress(name, done, every))
            return history, prepared.map_points
        passed = _run(name, smoother, prepared, progress, keeper_of(name))
        return smoothed_history(smoother, passed, prepared), smoother.sliding.window.points
    estimator = build_estimator(name, prepared, settings)
    history = _with_start(_run(name, estimator, prepared, progress, keeper_of(name)), prepared)
    return history, _map_of(estimator, history, prepared)


def _check(settings: Settings, prepared: Prepared) -> None:
    without = [name for name in settings.estimators if name not in OURS]
    if without and isinstance(prepared.belief, LandmarkBelief):
        raise InputError(
            f"{', '.join(without)}: holds no landmarks; give the tracks' map (landmarks.csv), or choose estimators among "
            f"{', '.join(OURS)}"
        )


def _run(
    name: str, estimator: Estimator, prepared: Prepared, progress: Progress, keeper: Keeper
) -> EstimateHistory:
    """From where the keeper left off, or from the start; a run that had ended is not made again."""
    rest = prepared.timeline[len(prepared.start.frames.mean) :]
    _start(estimator, prepared)
    kept = keeper.resume(estimator)
    rows = GrowingHistory(estimator.layout, prepared.start_end) if kept is None else kept.rows
    progress(name, len(rows), len(rest))
    if kept is not None and kept.status is not None:
        return rows.ended(name, kept.status)
    with keeper.running(estimator, rows) as keep:

        def on_frame(_: int) -> None:
            progress(name, len(rows), len(rest))
            keep()

        history = replace(run(estimator, rows.time, rest[len(rows) :], on_frame, rows), name=name)
        if not _is_cut_short(history, len(rest)):
            keeper.end(estimator, history, rows)
    return history


def _map_of(
    estimator: Estimator, history: EstimateHistory, prepared: Prepared
) -> Float[np.ndarray, "k 3"] | None:
    """The landmarks that an estimator ended with; those of the start where it failed or holds none."""
    if not isinstance(estimator, MultiplicativeFilter) or not isinstance(prepared.belief, LandmarkBelief):
        return prepared.map_points
    if history.status.verdict is not Verdict.FAILED:
        return estimator.landmark_belief.points_in_g
    return prepared.map_points


def _start(estimator: Estimator, prepared: Prepared) -> None:
    """With its landmarks for a filter that holds them."""
    if isinstance(estimator, RecursiveSmoother):
        begin_at_start(estimator, prepared)
    elif isinstance(estimator, MultiplicativeFilter):
        estimator.start(prepared.belief)
    else:
        estimator.start(prepared.start.belief)


def _is_cut_short(history: EstimateHistory, frames: int) -> bool:
    """Whether Ctrl-C ended it: it neither failed nor did all its frames."""
    return history.status.verdict is not Verdict.FAILED and len(history.time) < frames


def _with_start(history: EstimateHistory, prepared: Prepared) -> EstimateHistory:
    """The history with the smoothed frames of the start in front, which cost no filter time and count no innovation."""
    frames = prepared.start.frames
    count = len(frames.mean)
    time = np.array([frame.time for frame in prepared.timeline[:count]])
    used = np.array([sum(len(m.values) for m in frame.measurements) for frame in prepared.timeline[:count]])
    nothing = np.zeros(count)
    return replace(
        history,
        time=np.concatenate([time, history.time]),
        mean=np.concatenate([frames.mean, history.mean]),
        factor=np.concatenate([frames.factor, history.factor]),
        nis=np.concatenate([nothing, history.nis]),
        dof=np.concatenate([nothing.astype(int), history.dof]),
        log_likelihood=np.concatenate([nothing, history.log_likelihood]),
        accepted=np.concatenate([used, history.accepted]),
        rejected=np.concatenate([nothing.astype(int), history.rejected]),
        runtime=np.concatenate([nothing, history.runtime]),
    )


def _evaluated(history: EstimateHistory, prepared: Prepared) -> Evaluation:
    alignment = Alignment.NONE if prepared.known_frames else Alignment.FIRST_FRAME
    return evaluate(history, prepared.dataset.truth, alignment)


def _judge(evaluations: list[Evaluation], prepared: Prepared) -> list[Evaluation]:
    doubts, of_filters = shared_doubts(prepared), filter_doubts(prepared)
    peers = [evaluation for evaluation in evaluations if evaluation.name in OURS]
    judged_ones = []
    for evaluation in evaluations:
        others = [peer for peer in peers if peer.history.status.verdict is not Verdict.FAILED]
        own = doubts if evaluation.name == SMOOTHER else [*doubts, *of_filters]
        status = judged(evaluation, own, others)
        judged_ones.append(replace(evaluation, history=replace(evaluation.history, status=status)))
    return judged_ones
