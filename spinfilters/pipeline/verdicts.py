"""Verdicts on the estimates of a run.

The covariances they speak of hold with errors that may be correlated, too.
"""

from dataclasses import replace

import numpy as np

from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.estimator_evaluation import Evaluation, evaluate
from spinfilters.evaluation.trajectory_errors import Alignment
from spinfilters.pipeline.diagnostics import LARGEST_MOMENT_STD, with_verdict
from spinfilters.pipeline.doubts import Doubts
from spinfilters.pipeline.estimator_entry import estimator_entries
from spinfilters.pipeline.setup import Setup
from spinfilters.settings.run_settings import Settings
from spinfilters.state.status import Verdict


def evaluated(history: EstimateHistory, setup: Setup) -> Evaluation:
    """A history of this data set, with its errors where there is a truth."""
    alignment = Alignment.NONE if setup.known_frames else Alignment.FIRST_FRAME
    observed = replace(history, observations=setup.observations[: len(history.time)])
    return evaluate(observed, setup.dataset.truth, alignment)


def with_verdicts(doubts: Doubts, settings: Settings) -> list[Evaluation]:
    """Evaluations with their verdicts."""
    setup, entries = doubts.setup, estimator_entries()
    widened = {each.name: _widened(each, doubts) for each in doubts.evaluations}
    peers = [each for each in widened.values() if not entries[each.name].is_baseline]
    others = [peer for peer in peers if peer.history.status.verdict is not Verdict.FAILED]
    found = []
    for evaluation in doubts.evaluations:
        entry, wider = entries[evaluation.name], widened[evaluation.name]
        own = [*doubts.of(evaluation, entry), *_undetermined(evaluation, wider, doubts)]
        status = with_verdict(wider, own, others, entry.false_alarm_probability(setup, settings))
        found.append(wider.with_status(status))
    return found


def _widened(evaluation: Evaluation, doubts: Doubts) -> Evaluation:
    """With covariances that hold with possibly correlated errors."""
    widening, history = doubts.models.correlated.widening, evaluation.history
    failed = history.status.verdict is Verdict.FAILED
    if widening is None or failed or history.layout != doubts.setup.process.layout:
        return evaluation
    return evaluated(history.widened(widening), doubts.setup)


def _undetermined(evaluation: Evaluation, wider: Evaluation, doubts: Doubts) -> list[str]:
    """Why moments are not determined that would be, were errors surely white."""
    before, after = (float(np.max(each.body.principal_moments_std)) for each in (evaluation, wider))
    return [doubts.models.correlated.undecided] if before <= LARGEST_MOMENT_STD < after else []
