"""Verdicts on the estimates of a run.

The covariances they speak of hold with errors that may be correlated, too.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.estimator_evaluation import Evaluation, evaluate
from spinfilters.evaluation.trajectory_errors import Alignment
from spinfilters.pipeline.doubts import Doubts
from spinfilters.pipeline.estimator_entry import AnyEntry
from spinfilters.pipeline.setup import Setup
from spinfilters.settings.run_settings import Settings
from spinfilters.state.blocks.rigid_body import CENTRE_OF_MASS
from spinfilters.state.status import Finding, Verdict
from spinfilters.verdict.estimate_tests import LARGEST_MOMENT_STD
from spinfilters.verdict.evidence import Evidence
from spinfilters.verdict.judge import judge


def evaluated(history: EstimateHistory, setup: Setup) -> Evaluation:
    """A history of this data set, with its errors where there is a truth."""
    alignment = Alignment.NONE if setup.known_frames else Alignment.FIRST_FRAME
    observed = replace(history, observations=setup.observations[: len(history.time)])
    return evaluate(observed, setup.dataset.truth, alignment)


def with_verdicts(doubts: Doubts, settings: Settings, entries: Mapping[str, AnyEntry]) -> list[Evaluation]:
    """Evaluations with their verdicts, for estimators of a table of entries by name."""
    setup = doubts.setup
    widened = {each.name: _widened(each, doubts) for each in doubts.evaluations}
    peers = [each for each in widened.values() if not entries[each.name].is_baseline]
    others = [peer for peer in peers if peer.history.status.verdict is not Verdict.FAILED]
    found = []
    for evaluation in doubts.evaluations:
        entry, wider = entries[evaluation.name], widened[evaluation.name]
        evidence = Evidence(
            wider,
            others,
            entry.false_alarm_probability(setup, settings),
            [*doubts.of(evaluation, entry), *_undetermined(evaluation, wider, doubts)],
            _centre_prior_std(setup),
        )
        found.append(wider.with_status(judge(evidence)))
    return found


def _widened(evaluation: Evaluation, doubts: Doubts) -> Evaluation:
    """With covariances that hold with possibly correlated errors."""
    widening, history = doubts.models.correlated.widening, evaluation.history
    failed = history.status.verdict is Verdict.FAILED
    if widening is None or failed or history.layout != doubts.setup.process.layout:
        return evaluation
    return evaluated(history.widened(widening), doubts.setup)


def _centre_prior_std(setup: Setup) -> float:
    """Standard deviation of the centre of mass before anything was measured, m; infinite without a prior of it."""
    layout, prior = setup.process.layout, setup.initial.prior
    if not layout.has(CENTRE_OF_MASS) or prior is None:
        return np.inf
    std = np.linalg.norm(prior.factor[layout.slice(CENTRE_OF_MASS.name)], axis=1).max()
    return float(std) if np.isfinite(std) else np.inf


def _undetermined(evaluation: Evaluation, wider: Evaluation, doubts: Doubts) -> list[Finding]:
    """Why moments are not determined that would be, were errors surely white."""
    before, after = (float(np.max(each.body.principal_moments_std)) for each in (evaluation, wider))
    undecided = doubts.models.correlated.undecided
    return [undecided] if undecided is not None and before <= LARGEST_MOMENT_STD < after else []
