"""Consistency checks of an estimate against other estimates.

Beside the smoother, and by what the moments rest on.
"""

from collections.abc import Sequence

from spinfilters.errors import NUMERICAL_ERRORS, InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.pipeline.inertia_evidence import inertia_evidence
from spinfilters.pipeline.initialisation_length import (
    DETERMINED_STD,
    LARGEST_DEPARTURE,
    is_bent,
    moments_std_of,
)
from spinfilters.pipeline.setup import Setup
from spinfilters.pipeline.smoother_run import smooth_at_once
from spinfilters.settings.run_settings import Settings
from spinfilters.state.quantities import BODY, CENTRE, POSITION, ROTATION
from spinfilters.state.status import Finding, Verdict
from spinfilters.verdict.agreement_tests import over_confidence
from spinfilters.verdict.checks import finding

LEAST_EVIDENCE = 30.0
"""Of moments that a motion determines (`inertia_evidence`)."""
FEWEST_EPOCHS = 10
"""With less the evidence, at three numbers an epoch, says nothing of the motion."""


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
    vague = setup.initial.departure > LARGEST_DEPARTURE or not moments_std_of(setup.initial) <= DETERMINED_STD
    vague |= setup.is_given and is_bent(setup.initial.belief)
    if histories or not vague or setup.initial.has_landmarks:
        return None
    try:
        made = smooth_at_once(setup, settings, lambda *_: None)
    except (InputError, *NUMERICAL_ERRORS):
        return None
    return None if made.status.verdict is Verdict.FAILED else made


def agreement_diagnostics(
    evaluation: Evaluation, smoother: EstimateHistory | None, unheld: Sequence[Finding] = ()
) -> list[Finding]:
    """Findings where a filter departs from the smoother beyond its own covariance.

    Parameters
    ----------
    unheld: what is found of it where there is nothing to compare it with.
    """
    history = evaluation.history
    if smoother is None or history.status.verdict is Verdict.FAILED or history.layout != smoother.layout:
        return list(unheld)
    found = over_confidence(history, smoother)
    return list(unheld) if found is None else found


def motion_diagnostics(setup: Setup, settings: Settings) -> list[Finding]:
    """Finding where the motion does not determine the moments."""
    evidence = inertia_evidence(setup, settings)
    if evidence is None or evidence.total >= LEAST_EVIDENCE:
        return []
    few = evidence.epochs < FEWEST_EPOCHS
    why = "they are too few" if few else "a steady spin shows its axis only"
    numbers = {"epochs": evidence.epochs, "evidence": evidence.total, "limit": LEAST_EVIDENCE, "why": why}
    return [finding("motion-shows-no-moments", numbers, _resting_on_moments(setup))]


def _resting_on_moments(setup: Setup) -> frozenset[str]:
    """Quantities that rest on the wobble as the moments do.

    A steady spin shows the centre of mass across its axis only; along it the centre, and its place with it, follow from the same
    wobble. Of a gyro alone an undetermined body and an identified density of torques explain the same changes of the rates: the
    body takes a part of the disturbances, the density comes out too small, and with it the deviations of rate and attitude.
    """
    if setup.process.layout.translates:
        return BODY | {CENTRE, POSITION}
    return ROTATION if "torque_psd" in setup.unstated else BODY
