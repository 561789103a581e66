"""Predictions compared with the truth where it goes on after the measurements, and several inertias propagated side by side.

The inertias start without torques from one attitude and rate, as in Figures 6-23 to 6-26 of Tweddle (2013).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import (
    angle_between,
    inverse,
    matrix_from_quaternion,
    multiply,
    quaternion_from_matrix,
    rotate,
)
from spinfilters.core.errors import InputError
from spinfilters.core.linear_algebra import at_times
from spinfilters.core.torque_free import torque_free_motion
from spinfilters.evaluation.consistency import chi_square_band, normalised_errors, rotation_nees
from spinfilters.evaluation.continuous_motion import ContinuousMotion
from spinfilters.evaluation.estimated_motion import trajectory_of
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.reference_fit import ReferenceFit, fitted_residuals
from spinfilters.evaluation.trajectory_errors import Alignment, TruthErrors, truth_errors
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.reference_motion import ReferenceMotion
from spinfilters.io.truth import Truth, truth_in_moved_frame

UNITS: Final[Mapping[str, str]] = {
    "position": "m",
    "attitude": "rad",
    "velocity": "m/s",
    "rate": "rad/s",
}
"""Of the quantities that have errors."""


@dataclass(frozen=True)
class ErrorCourse:
    """Errors of one quantity with their stated standard deviations.

    Attributes
    ----------
    error, std : (k, 3) float array
        In the unit that `UNITS` names.
    """

    error: Float[np.ndarray, "k 3"]
    std: Float[np.ndarray, "k 3"]

    @property
    def length(self) -> Float[np.ndarray, " k"]:
        """Length of the error."""
        return np.linalg.norm(self.error, axis=1)

    @property
    def stated(self) -> Float[np.ndarray, " k"]:
        """Root of the sum of the axes' stated variances, which is the root mean square of the length."""
        return np.linalg.norm(self.std, axis=1)


@dataclass(frozen=True)
class PredictionErrors:
    """Prediction minus truth or reference at the stamps of that.

    Attributes
    ----------
    judge : str
        "truth", or the name of the reference.
    ahead : (k,) float array
        Time after the last measurement, s.
    courses : mapping of str to ErrorCourse
        By the names of `UNITS`; those that the judge knows.
    nees : (k,) float array or None
        Of the whole error; None where the reference does not give the state, with ``why`` in words.
    dof : int
        Dimension of the error in ``nees``.
    why : str
        Why there is no NEES; empty where there is one.
    """

    judge: str
    ahead: Float[np.ndarray, " k"]
    courses: Mapping[str, ErrorCourse]
    nees: Float[np.ndarray, " k"] | None
    dof: int
    why: str = ""

    @property
    def band(self) -> tuple[float, float]:
        """Interval that holds the NEES per degree of freedom of one prediction at one time with probability 95 %."""
        low, high = chi_square_band(self.dof, 1)
        return float(low) / self.dof, float(high) / self.dof

    @property
    def ratio(self) -> Float[np.ndarray, " k"] | None:
        """NEES per degree of freedom, 1 for a consistent prediction."""
        return None if self.nees is None else self.nees / self.dof

    @property
    def document(self) -> dict[str, Any]:
        """The errors as prediction.json holds them: at the end, and the largest."""
        ratio = self.ratio
        quantities = {
            name: {
                "unit": UNITS[name],
                "end": float(course.length[-1]),
                "end_std": float(course.stated[-1]),
                "largest": float(course.length.max()),
            }
            for name, course in self.courses.items()
        }
        return {
            "judge": self.judge,
            "rows": len(self.ahead),
            "seconds": float(self.ahead[-1]),
            "errors": quantities,
            "nees_per_dof_end": None if ratio is None else float(ratio[-1]),
            "nees_per_dof_mean": None if ratio is None else float(np.mean(ratio)),
            "nees_dof": None if ratio is None else self.dof,
            "nees_band_95": None if ratio is None else list(self.band),
            "nees_missing": self.why or None,
        }


def errors_ahead(predicted: EstimateHistory, evaluation: Evaluation) -> PredictionErrors | None:
    """Errors of a prediction against the truth of the run that it goes on from.

    The truth is related to the estimate as it was over the measurements: nothing is fitted to what was predicted.

    Parameters
    ----------
    predicted : EstimateHistory
        The last epoch of the run, and what is predicted from it.
    evaluation : Evaluation
        Of the run.

    Returns
    -------
    PredictionErrors or None
        None without a truth, or where it has no row at a time that was predicted.
    """
    truth = truth_in_frames_of(evaluation)
    if truth is None or len(predicted.time) < 2 or not (truth.time > predicted.time[0]).any():
        return None
    trajectory, now = trajectory_of(predicted), float(predicted.time[0])
    try:
        errors = _errors_after(truth_errors(trajectory, truth), now)
    except InputError:  # no stamp in common
        return None
    if errors is None:
        return None
    std = {name: getattr(trajectory, f"std_{name}")[errors.rows] for name in UNITS}
    courses = {
        name: ErrorCourse(error, std[name]) for name in UNITS if (error := getattr(errors, name)) is not None
    }
    nees, dof = _nees(predicted, truth, evaluation, errors)
    why = (
        ""
        if nees is not None
        else "the truth does not contain every block of the state in the estimate's frames"
    )
    return PredictionErrors("truth", errors.time - now, courses, nees, dof, why)


def errors_against_reference(
    predicted: EstimateHistory, reference: ReferenceMotion, fit: ReferenceFit
) -> PredictionErrors | None:
    """Errors of a prediction against a reference that goes on, related to the estimate as it was over the measurements.

    The deviations hold the noise of the reference and all that was fitted in addition to what the prediction states.

    Parameters
    ----------
    predicted : EstimateHistory
        The last epoch of the run, and what is predicted from it.
    reference : ReferenceMotion
        In the form that was fitted.
    fit : ReferenceFit
        Of the estimate over the measurements.

    Returns
    -------
    PredictionErrors or None
        None where the reference has no row at a time that was predicted.

    Raises
    ------
    InputError
        A prediction that is not finite.
    """
    motion = ContinuousMotion(predicted)
    found = fitted_residuals(fit, motion, reference)
    if found is None:
        return None
    R, courses = matrix_from_quaternion(motion.at(found.time).q_ig), {}
    if found.place is not None and found.place_std is not None:
        courses["position"] = ErrorCourse(
            -found.place @ fit.frame, _rotate_deviations(found.place_std, fit.frame.T)
        )
    if reference.attitude is not None:
        courses["attitude"] = ErrorCourse(
            found.rotation @ fit.axes.T, _rotate_deviations(found.rotation_std, fit.axes)
        )
    else:
        R_im = R @ fit.axes
        stated = at_times(found.time, predicted.time, trajectory_of(predicted).std_rate)
        courses["rate"] = ErrorCourse(
            -np.einsum("kij,kj->ki", R_im, found.rotation),
            np.hypot(_rotate_deviations(found.rotation_std, R_im), stated),
        )
    why = "a reference does not give every block of the state"
    judge = PurePath(reference.name).name
    return PredictionErrors(judge, found.time - float(predicted.time[0]), courses, None, 0, why)


def _rotate_deviations(
    std: Float[np.ndarray, "k 3"], R: Float[np.ndarray, "*k 3 3"]
) -> Float[np.ndarray, "k 3"]:
    """Deviations along other axes, R b of those along the axes of b, whose errors count as independent."""
    return np.sqrt(np.einsum("...ij,...j->...i", R**2, std**2))


def truth_in_frames_of(evaluation: Evaluation) -> Truth | None:
    """The truth in the estimate's frames; where a fit relates the frames g, turned as the fit says."""
    truth, errors = evaluation.truth, evaluation.errors
    if truth is None or evaluation.alignment is not Alignment.BODY_FRAME:
        return evaluation.truth_in_own_frames
    if errors is None or errors.frame is None:
        return None
    return truth_in_moved_frame(truth, errors.frame, np.zeros(3))


def _errors_after(errors: TruthErrors, now: float) -> TruthErrors | None:
    """Errors after the last measurement."""
    later = errors.time[errors.time > now]
    return errors.within(float(later[0]), np.inf) if later.size else None


def _nees(
    predicted: EstimateHistory, truth: Truth, evaluation: Evaluation, errors: TruthErrors
) -> tuple[Float[np.ndarray, " k"] | None, int]:
    """NEES at the times of the errors, of the state or of rate and mass distribution, as the run itself has it."""
    if evaluation.nees is not None:
        found = normalised_errors(predicted, truth)
    elif evaluation.rotation_nees is not None:
        found = rotation_nees(predicted, truth)
    else:
        found = None
    if found is None:
        return None, 0
    part = found.within(float(errors.time[0]), np.inf)
    if part is None or len(part.time) != len(errors.time):
        return None, 0
    return part.total, part.dof


@dataclass(frozen=True)
class NamedInertia:
    """Principal moments and axes of a body under a name.

    Attributes
    ----------
    name : str
        Whose they are.
    moments : (3,) float array
        Principal moments of any common scale.
    axes_g : (3, 3) float array
        Rows are the principal axes in g, so that it is R_bg.
    """

    name: str
    moments: Float[np.ndarray, "3"]
    axes_g: Float[np.ndarray, "3 3"]


@dataclass(frozen=True)
class PropagatedInertia:
    """The motion of one inertia.

    Attributes
    ----------
    name : str
        Of the inertia.
    attitude : (k, 4) float array
        q_ig, scalar last.
    rate : (k, 3) float array
        About the axes of g, rad/s.
    """

    name: str
    attitude: Float[np.ndarray, "k 4"]
    rate: Float[np.ndarray, "k 3"]

    def angle_from(self, attitude: Float[np.ndarray, "k 4"]) -> Float[np.ndarray, " k"]:
        """Closest angle to other attitudes, rad."""
        return angle_between(self.attitude, attitude)

    def rate_from(self, rate: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, " k"]:
        """Length of the difference of the body rates, rad/s."""
        return np.linalg.norm(self.rate - rate, axis=1)


def propagate_inertias(
    inertias: Sequence[NamedInertia],
    attitude: Float[np.ndarray, "4"],
    rate: Float[np.ndarray, "3"],
    time: Float[np.ndarray, " k"],
) -> list[PropagatedInertia]:
    """The torque-free motion of every inertia from one state.

    Parameters
    ----------
    inertias : sequence of NamedInertia
        Bodies that are compared.
    attitude : (4,) float array
        q_ig at time zero.
    rate : (3,) float array
        About the axes of g at time zero, rad/s.
    time : (k,) float array
        Since then, s.

    Returns
    -------
    list of PropagatedInertia
        In the order of the inertias.

    Raises
    ------
    InputError
        Moments of no rigid body.
    """
    found = []
    for each in inertias:
        q_gb = quaternion_from_matrix(each.axes_g.T)
        motion = torque_free_motion(each.moments, each.axes_g @ rate, time, multiply(attitude, q_gb))
        back, turned = (np.broadcast_to(q, motion.attitude.shape) for q in (inverse(q_gb), q_gb))
        found.append(
            PropagatedInertia(each.name, multiply(motion.attitude, back), rotate(turned, motion.rate))
        )
    return found
