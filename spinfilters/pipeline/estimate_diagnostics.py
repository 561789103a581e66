"""Consistency checks of an estimate against other estimates.

Beside the smoother, and by what the moments rest on.
"""

from spinfilters.errors import NUMERICAL_ERRORS, InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.agreement import expected_nees
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.pipeline.diagnostics import RICHER
from spinfilters.pipeline.inertia_evidence import inertia_evidence
from spinfilters.pipeline.initialisation_length import LARGEST_DEPARTURE, is_bent
from spinfilters.pipeline.setup import Setup
from spinfilters.pipeline.smoother_run import smooth_at_once
from spinfilters.settings.run_settings import Settings
from spinfilters.state.status import Verdict

LARGEST_EXPECTED_NEES = 3.0
"""Per degree of freedom, with the smoother for the truth. On simulated motions filters beyond it had a NEES of 2.7 to 57 (a noisy
gyro, flips), those below one of up to 2.6, as chi-square numbers do; throws of a racquet below it agree with the reference."""
LEAST_EVIDENCE = 30.0
"""Of moments that a motion determines (`inertia_evidence`)."""


def reference_smoother(
    histories: list[EstimateHistory], setup: Setup, settings: Settings
) -> EstimateHistory | None:
    """The reference smoother of the filters.

    One of these histories, or made where what they begin from is vague.
    None where it has failed, or where it would have to be made with landmarks.
    """
    for history in histories:
        if history.status.verdict is not Verdict.FAILED:
            return history
    vague = setup.initial.departure > LARGEST_DEPARTURE
    vague |= setup.is_given and is_bent(setup.initial.belief)
    if histories or not vague or setup.initial.has_landmarks:
        return None
    try:
        made = smooth_at_once(setup, settings, lambda *_: None)
    except (InputError, *NUMERICAL_ERRORS):
        return None
    return None if made.status.verdict is Verdict.FAILED else made


def agreement_diagnostics(evaluation: Evaluation, smoother: EstimateHistory | None) -> list[str]:
    """Doubt where a filter departs from the smoother beyond its own covariance."""
    history = evaluation.history
    if smoother is None or history.status.verdict is Verdict.FAILED or history.layout != smoother.layout:
        return []
    expected = expected_nees(history, smoother)
    if not expected.size:
        return []
    mean, last = float(expected.mean()), float(expected[-1])
    if max(mean, last) <= LARGEST_EXPECTED_NEES:
        return []
    where = "over its epochs" if mean >= last else "in the end"
    return [
        f"held against the smoother of the same measurements its squared errors are {max(mean, last):.1f} times what it states "
        f"{where}: it is over-confident; take the smoother, or {RICHER}"
    ]


def motion_diagnostics(setup: Setup, settings: Settings) -> list[str]:
    """Doubt where the motion does not determine the moments."""
    evidence = inertia_evidence(setup, settings)
    if evidence is None or evidence.total >= LEAST_EVIDENCE:
        return []
    return [
        f"the motion does not determine the moments of inertia: of {evidence.epochs} epochs behind the initialisation a sphere "
        f"predicts as much (evidence {evidence.total:.0f}, {LEAST_EVIDENCE:.0f} wanted); a steady spin tells its axis alone"
    ]
