"""Everything that is said of one estimator's run, put together once for tables, files and figures."""

from dataclasses import dataclass, replace

import numpy as np

from spinfilters.errors import InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.body import BodyEstimate, BodyHistory, body_history
from spinfilters.evaluation.bound import ErrorBound
from spinfilters.evaluation.consistency import NormalisedErrors, knows_state, nis_ratio, normalised_errors
from spinfilters.evaluation.errors import (
    Alignment,
    BodyErrors,
    TruthErrors,
    body_errors,
    tells_first_frame,
    truth_errors,
    truth_in_first_frame,
)
from spinfilters.evaluation.trajectory import Trajectory, trajectory_of
from spinfilters.logs.truth import Truth


@dataclass(frozen=True)
class Evaluation:
    """One estimator's run.

    Attributes
    ----------
    bodies: after every frame; `body` is the last.
    alignment: that was applied before the estimate was compared with the truth.
    errors, body_errors: against the truth, None without one.
    nees: None when the truth does not tell the whole state in the estimate's frames.
    bound: beside the errors, where it was asked for and exists.
    """

    history: EstimateHistory
    trajectory: Trajectory
    bodies: BodyHistory
    alignment: Alignment = Alignment.NONE
    errors: TruthErrors | None = None
    body_errors: BodyErrors | None = None
    nees: NormalisedErrors | None = None
    bound: ErrorBound | None = None

    @property
    def name(self) -> str:
        """Of the estimator."""
        return self.history.name

    @property
    def body(self) -> BodyEstimate:
        """The body after the last frame."""
        return self.bodies.at(-1)

    @property
    def own_begin(self) -> float | None:
        """Time of the first epoch that is the estimator's own, s; None where it has none."""
        own = self.history.time[self.history.own]
        return float(own[0]) if own.size else None

    @property
    def nis_ratio(self) -> float | None:
        """NIS per degree of freedom over the run; the initialisation has none."""
        return nis_ratio(self.history)

    @property
    def milliseconds_per_frame(self) -> float | None:
        """Median over the frames that took any time; None when none did."""
        runtime = self.history.runtime[self.history.runtime > 0]
        return 1e3 * float(np.median(runtime)) if runtime.size else None


def evaluate(
    history: EstimateHistory, truth: Truth | None = None, alignment: Alignment = Alignment.NONE
) -> Evaluation:
    """Trajectory and body of a history, and their errors where there is a truth.

    Parameters
    ----------
    alignment: how the g of the estimate relates to that of the truth; `Alignment.FIRST_FRAME` becomes `Alignment.BODY_FRAME`
        where the truth does not tell enough for it.

    Raises
    ------
    InputError: a history without frames, or a truth without any of its time stamps.
    """
    if not len(history.time):
        raise InputError(
            f"{history.name} left no frame to evaluate: {'; '.join(history.status.reasons) or 'no reason'}"
        )
    evaluation = Evaluation(history, trajectory_of(history), body_history(history))
    if truth is None:
        return evaluation
    if alignment is Alignment.FIRST_FRAME and not tells_first_frame(history, truth):
        alignment = Alignment.BODY_FRAME
    return _compared(evaluation, truth, alignment)


def _compared(evaluation: Evaluation, truth: Truth, alignment: Alignment) -> Evaluation:
    history = evaluation.history
    errors = truth_errors(evaluation.trajectory, truth, alignment)
    common = truth_in_first_frame(history, truth) if alignment is Alignment.FIRST_FRAME else truth
    frame = errors.frame if alignment is Alignment.BODY_FRAME else None
    known = frame is None and knows_state(common, history.layout)
    return replace(
        evaluation,
        alignment=alignment,
        errors=errors,
        body_errors=body_errors(evaluation.body, common, frame),
        nees=normalised_errors(history, common) if known else None,
    )
