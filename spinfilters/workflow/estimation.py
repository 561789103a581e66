"""Every estimator on the identical measurements of one prepared data set."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from spinfilters.estimators.estimator import Estimator
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.multiplicative_ekf import MultiplicativeEkf
from spinfilters.estimators.multiplicative_ukf import MultiplicativeUkf
from spinfilters.estimators.run import run
from spinfilters.evaluation.errors import Alignment
from spinfilters.evaluation.evaluation import Evaluation, evaluate
from spinfilters.state.status import Verdict
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.quality import judged, shared_doubts
from spinfilters.workflow.settings import Settings

OURS = ("mekf", "ukf")
"""Estimators whose disagreement casts doubt; a baseline that goes astray says nothing of them."""

Progress = Callable[[str, int, int], None]
"""Called with the estimator's name, frames done and frames in all."""


@dataclass(frozen=True)
class Comparison:
    """All evaluations of a run, in the order asked for, and whether Ctrl-C cut it short."""

    prepared: Prepared
    evaluations: tuple[Evaluation, ...]
    interrupted: bool


def build_estimator(name: str, prepared: Prepared, settings: Settings) -> Estimator:
    """The estimator of a name in `spinfilters.workflow.settings.ESTIMATORS`."""
    if name == "mekf":
        return MultiplicativeEkf(prepared.process)
    if name == "ukf":
        return MultiplicativeUkf(prepared.process, settings.ukf)
    from spinfilters.estimators.filterpy_baselines import (
        FilterpyEkf,
        FilterpyUkf,
    )  # slow to import, rarely asked for

    return FilterpyEkf(prepared.process) if name == "filterpy-ekf" else FilterpyUkf(prepared.process)


def compare_estimators(prepared: Prepared, settings: Settings, progress: Progress) -> Comparison:
    """Run, evaluate and judge; Ctrl-C keeps what is done and leaves out the rest."""
    evaluations: list[Evaluation] = []
    interrupted = False
    try:
        for name in settings.estimators:
            history = _run(name, prepared, settings, progress)
            evaluations.append(_evaluated(history, prepared))
            interrupted = any("interrupted" in reason for reason in history.status.reasons)
            if interrupted:
                break
    except KeyboardInterrupt:
        if not evaluations:
            raise
        interrupted = True
    return Comparison(prepared, tuple(_judge(evaluations, prepared)), interrupted)


def _run(name: str, prepared: Prepared, settings: Settings, progress: Progress) -> EstimateHistory:
    first = len(prepared.start.frames.mean)
    rest = prepared.timeline[first:]
    progress(name, 0, len(rest))
    history = run(
        build_estimator(name, prepared, settings),
        prepared.start.belief,
        prepared.start_end,
        rest,
        lambda index: progress(name, index + 1, len(rest)),
    )
    return _with_start(replace(history, name=name), prepared)


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
    alignment = Alignment.NONE if prepared.known_frames else Alignment.BODY_FRAME
    return evaluate(history, prepared.dataset.truth, alignment)


def _judge(evaluations: list[Evaluation], prepared: Prepared) -> list[Evaluation]:
    doubts = shared_doubts(prepared)
    peers = [evaluation for evaluation in evaluations if evaluation.name in OURS]
    judged_ones = []
    for evaluation in evaluations:
        others = [peer for peer in peers if peer.history.status.verdict is not Verdict.FAILED]
        status = judged(evaluation, doubts, others)
        judged_ones.append(replace(evaluation, history=replace(evaluation.history, status=status)))
    return judged_ones
