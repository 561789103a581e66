"""Consistency checks of an estimate against other estimates.

Beside the smoother, and by what the moments rest on.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from scipy.special import chdtri

from spinfilters.errors import NUMERICAL_ERRORS, InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.agreement import WHOLE, compared_parts, expected_nees
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.pipeline.diagnostics import RICHER
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
from spinfilters.state.blocks.rigid_body import MASS_DISTRIBUTION
from spinfilters.state.status import Verdict

RARE = 0.01
"""Probability of a NEES of a consistent filter, beyond which one that is expected with the smoother for the truth is a doubt: 1.9
per degree of freedom of a state with a place, 3.0 of a mass distribution. Of 70 filters of noisy poses on the thesis' motion those
below had a NEES of up to 1.9 and errors of up to 3.0 deviations, those beyond it of up to 14 and 58."""
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
    evaluation: Evaluation, smoother: EstimateHistory | None, unheld: Sequence[str] = ()
) -> list[str]:
    """Doubt where a filter departs from the smoother beyond its own covariance.

    Parameters
    ----------
    unheld: what is said of it where there is nothing to hold it against.
    """
    history = evaluation.history
    if smoother is None or history.status.verdict is Verdict.FAILED or history.layout != smoother.layout:
        return list(unheld)
    parts = compared_parts(history.layout)
    found = [
        _TooConfident(name, float(nees.mean()), float(nees[-1]), parts[name].stop - parts[name].start)
        for name, nees in expected_nees(history, smoother).items()
    ]
    if not found:
        return list(unheld)
    worst = max(found, key=lambda each: each.excess)
    return [] if worst.excess <= 1 else [worst.sentence]


@dataclass(frozen=True)
class _TooConfident:
    """Expected NEES per degree of freedom of a part of a filter's error.

    Attributes
    ----------
    mean, last: over its epochs, and in the last.   dof: of the part.
    """

    part: str
    mean: float
    last: float
    dof: int

    @property
    def excess(self) -> float:
        """Times the largest that a consistent filter has."""
        largest = float(chdtri(self.dof, RARE)) / self.dof
        return max(self.mean, self.last) / largest

    @property
    def sentence(self) -> str:
        """Doubt about a filter that is over-confident."""
        where = "over its epochs" if self.mean >= self.last else "in the end"
        of = "" if self.part == WHOLE else f" of the {MASS_DISTRIBUTION.label}"
        return (
            f"held against the smoother of the same measurements its squared errors{of} are {max(self.mean, self.last):.1f} times "
            f"what it states {where}: it is over-confident; take the smoother, or {RICHER}"
        )


def motion_diagnostics(setup: Setup, settings: Settings) -> list[str]:
    """Doubt where the motion does not determine the moments."""
    evidence = inertia_evidence(setup, settings)
    if evidence is None or evidence.total >= LEAST_EVIDENCE:
        return []
    why = "they are too few" if evidence.epochs < FEWEST_EPOCHS else "a steady spin tells its axis alone"
    return [
        f"the motion does not determine the moments of inertia: of {evidence.epochs} epochs behind the initialisation a sphere "
        f"predicts as much (evidence {evidence.total:.0f}, {LEAST_EVIDENCE:.0f} wanted); {why}"
    ]
