"""Agreement of a filter with the smoother of the same measurements, and evidence for its inertia."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.special import chdtri

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.evaluation.consistency import WHOLE, compared_parts, expected_nees, finite_epochs
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import LandmarkBelief
from spinfilters.filters.history import EstimateHistory, finished_history, history_at
from spinfilters.filters.timeline import run
from spinfilters.inference.first_epochs import DETERMINED_STD, LARGEST_DEPARTURE, is_bent
from spinfilters.inference.setup import Setup
from spinfilters.inference.smoother_run import smooth_at_once
from spinfilters.models.state_blocks import MASS_DISTRIBUTION
from spinfilters.models.state_layout import Gaussian
from spinfilters.models.status import ALL, BODY, CENTRE, POSITION, ROTATION, Finding
from spinfilters.settings.run_settings import Settings
from spinfilters.verdict.checks import finding
from spinfilters.verdict.judge import own_rows, quantity_differences

RARE = 0.01
"""Probability of a NEES of a consistent filter, beyond which one that is expected with the smoother for the truth is a doubt: 1.9
per degree of freedom of a state with a place, 3.0 of a mass distribution. Of 70 filters of noisy poses on the thesis' motion those
below had a NEES of up to 1.9 and errors of up to 3.0 deviations, those beyond it of up to 14 and 58."""
HELD = 2.0
"""Expected square of a component of a published quantity in its own deviations, mean over the epochs and in the last, up to which
the quantity holds: a normal error of that size is beyond four deviations with a probability of 0.5 %."""
HELD_AT_ONCE = 16.0
"""The same at one epoch: there the smoother itself is four deviations away."""


@dataclass(frozen=True)
class OverConfidence:
    """Expected NEES per degree of freedom of a part of a filter's error.

    Attributes
    ----------
    mean, last : float
        Over its epochs, and in the last.
    dof : int
        Of the part.
    """

    part: str
    mean: float
    last: float
    dof: int

    @property
    def excess(self) -> float:
        """Times the largest that a consistent filter has."""
        return max(self.mean, self.last) / (float(chdtri(self.dof, RARE)) / self.dof)


FARTHEST: Final = 1e12
"""Expected NEES beyond which a number says no more than that two estimates have nothing to do with one another."""


def over_confidence(history: EstimateHistory, smoother: EstimateHistory) -> list[Finding] | None:
    """Finding where a filter departs from the smoother beyond its own covariance; None without a common epoch."""
    parts = compared_parts(history.layout)
    found = [
        OverConfidence(name, float(nees.mean()), float(nees[-1]), parts[name].stop - parts[name].start)
        for name, nees in expected_nees(history, smoother).items()
        if nees.size
    ]
    if not found:
        return None
    worst = max(found, key=lambda each: each.excess)
    if worst.excess <= 1:
        return []
    nees = min(max(worst.mean, worst.last), FARTHEST)
    numbers: dict[str, float | str] = {
        "nees": nees,
        "times": float(np.sqrt(nees)),
        "which": "" if worst.part == WHOLE else f" of the {MASS_DISTRIBUTION.label}",
        "where": "over its epochs" if worst.mean >= worst.last else "in the last epoch",
    }
    return [finding("over-confident", numbers, over_confident_quantities(history, smoother))]


def over_confident_quantities(history: EstimateHistory, smoother: EstimateHistory) -> frozenset[str]:
    """Published quantities whose errors a filter states too small; all where that cannot be computed."""
    rows = own_rows(history)
    rows = rows[(rows < len(smoother.time)) & finite_epochs(history)[rows]]
    rows = rows[finite_epochs(smoother)[rows]]
    if not rows.size:
        return ALL
    with np.errstate(all="ignore"):
        found = quantity_differences(history_at(history, rows), history_at(smoother, rows))
        squares = {name: each.expected_squares for name, each in found.items()}
    return ALL & frozenset(name for name, own in squares.items() if not _is_within_chance(own))


def _is_within_chance(squares: Float[np.ndarray, "n c"]) -> bool:
    typical = max(float(squares.mean(axis=0).max()), float(squares[-1].max()))
    return typical <= HELD and float(squares.max()) <= HELD_AT_ONCE


MOST_EPOCHS = 1000
"""That are looked at: a motion that does not show itself in these counts as one that does not."""
SMALLEST_REFUSAL = 1e-12
"""Probability of a refused measurement, where there is no gate."""
NOT_FINITE = 1e9
"""Evidence of a sphere whose numbers lead nowhere where those of the body do."""


@dataclass(frozen=True)
class InertiaEvidence:
    """Evidence for the inertia of the initialisation compared with a sphere.

    Attributes
    ----------
    total : float
        Twice the logarithm of the likelihood ratio.
    epochs : int
        That it was gathered over.
    """

    total: float
    epochs: int


def inertia_evidence(setup: Setup, settings: Settings) -> InertiaEvidence | None:
    """Inertia evidence of the epochs after the initialisation.

    None where that has failed or is followed by none.
    """
    first = len(setup.initial.mean)
    rest = min(len(setup.timeline) - first, MOST_EPOCHS)
    if setup.initial.has_failed or rest < 1 or not np.isfinite(setup.belief.factor).all():
        return None
    try:
        with np.errstate(all="ignore"):  # what is not finite becomes a status
            body, sphere = (
                _predict_history(setup, settings, belief)
                for belief in (setup.belief, _as_sphere(setup.belief))
            )
    except NUMERICAL_ERRORS:
        return InertiaEvidence(0.0, rest)
    if body.has_failed:
        return InertiaEvidence(0.0, len(body.time))
    if sphere.has_failed:
        return InertiaEvidence(NOT_FINITE, len(body.time))
    return InertiaEvidence(_evidence(body, sphere, settings), len(body.time))


def _predict_history(setup: Setup, settings: Settings, belief: Gaussian | LandmarkBelief) -> EstimateHistory:
    first = len(setup.initial.mean)
    ekf = MultiplicativeEkf(setup.process, settings.robust, landmarks=settings.landmarks)
    ekf.start(belief)
    setup.take_in_first_epoch(ekf)
    return run(ekf, setup.end_of_initialisation, setup.timeline[first : first + MOST_EPOCHS])


def _as_sphere(belief: Gaussian | LandmarkBelief) -> Gaussian | LandmarkBelief:
    """The belief about everything else, of a body whose inertia is known to be a sphere's."""
    layout, name = belief.layout, MASS_DISTRIBUTION.name
    mean, factor = belief.mean.copy(), belief.factor.copy()
    mean[layout.mean_slice(name)], factor[layout.slice(name)] = 0.0, 0.0
    return replace(belief, mean=mean, factor=factor)


def _evidence(body: EstimateHistory, sphere: EstimateHistory, settings: Settings) -> float:
    """Evidence by epoch.

    The likelihoods count where both used as much, else the squares, a refused value taken for one at the gate.
    """
    alike = body.accepted == sphere.accepted
    likelihoods = 2 * (body.log_likelihood - sphere.log_likelihood)
    refused = max(1.0 - settings.robust.gate_probability, SMALLEST_REFUSAL)
    dimension = body.dof.sum() / max(body.accepted.sum(), 1)
    at_gate = float(chdtri(max(dimension, 1.0), refused))
    squares = sphere.nis - body.nis + at_gate * (sphere.rejected - body.rejected)
    return float(np.where(alike, likelihoods, squares).sum())


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
    finished = finished_history(histories)
    if finished is not None:
        return finished
    vague = setup.initial.departure > LARGEST_DEPARTURE or not setup.initial.moments_std <= DETERMINED_STD
    vague |= setup.is_given and is_bent(setup.initial.belief)
    if histories or not vague or setup.initial.has_landmarks:
        return None
    try:
        made = smooth_at_once(setup, settings, lambda *_: None)
    except (InputError, *NUMERICAL_ERRORS):
        return None
    return None if made.has_failed else made


def agreement_diagnostics(
    evaluation: Evaluation, smoother: EstimateHistory | None, unheld: Sequence[Finding] = ()
) -> list[Finding]:
    """Findings where a filter departs from the smoother beyond its own covariance.

    Parameters
    ----------
    unheld : Sequence[Finding]
        What is found of it where there is nothing to compare it with.
    """
    history = evaluation.history
    if smoother is None or history.has_failed or history.layout != smoother.layout:
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
    wobble. An undetermined body and an identified density of torques explain the same changes of the rates: the body takes a part
    of the disturbances, the density comes out too small, and with it the deviations of rate and attitude.
    """
    quantities = BODY | {CENTRE, POSITION} if setup.process.layout.translates else BODY
    return quantities | ROTATION if "torque_psd" in setup.unstated else quantities
