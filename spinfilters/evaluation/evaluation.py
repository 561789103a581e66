"""Everything that is said of one estimator's run, put together once for tables, files and figures."""

from dataclasses import dataclass

import numpy as np

from spinfilters.errors import InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.body import BodyEstimate, BodyHistory, body_history
from spinfilters.evaluation.consistency import NormalisedErrors, knows_state, nis_ratio, normalised_errors
from spinfilters.evaluation.errors import (
    Alignment,
    BodyErrors,
    RmsErrors,
    TruthErrors,
    body_errors,
    truth_errors,
)
from spinfilters.evaluation.trajectory import Trajectory, trajectory_of
from spinfilters.logs.truth import Truth


@dataclass(frozen=True)
class Evaluation:
    """One estimator's run.

    Attributes
    ----------
    bodies: after every frame; `body` is the last.
    errors, body_errors: against the truth, None without one.
    nees: None when the truth does not tell the whole state in the estimate's frames.
    """

    history: EstimateHistory
    trajectory: Trajectory
    bodies: BodyHistory
    errors: TruthErrors | None = None
    body_errors: BodyErrors | None = None
    nees: NormalisedErrors | None = None

    @property
    def name(self) -> str:
        """Of the estimator."""
        return self.history.name

    @property
    def body(self) -> BodyEstimate:
        """The body after the last frame."""
        return self.bodies.at(-1)

    @property
    def nis_ratio(self) -> float | None:
        """NIS per degree of freedom over the run."""
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
    alignment: whether the g of the estimate is that of the truth (known map) or turned by a constant.

    Raises
    ------
    InputError: a history without frames, or a truth without any of its time stamps.
    """
    if not len(history.time):
        raise InputError(
            f"{history.name} left no frame to evaluate: {'; '.join(history.status.reasons) or 'no reason'}"
        )
    trajectory, bodies = trajectory_of(history), body_history(history)
    if truth is None:
        return Evaluation(history, trajectory, bodies)
    errors = truth_errors(trajectory, truth, alignment)
    same_frames = alignment is Alignment.NONE and knows_state(truth, history.layout)
    nees = normalised_errors(history, truth) if same_frames else None
    return Evaluation(
        history, trajectory, bodies, errors, body_errors(bodies.at(-1), truth, errors.frame), nees
    )


def numbers(evaluation: Evaluation) -> dict[str, float | int | str | list[float] | None]:
    """The figures of a run by name (with its unit), ready for JSON; None where there is no such figure."""
    history, body = evaluation.history, evaluation.body
    return {
        "estimator": evaluation.name,
        "status": str(history.status.verdict),
        "frames": len(history.time),
        "principal_moments": body.principal_moments.tolist(),
        "principal_moments_std": body.principal_moments_std.tolist(),
        "principal_axes_std_rad": body.principal_axes_std.tolist(),
        "k1": body.k1,
        "k1_std": body.k1_std,
        "k2": body.k2,
        "k2_std": body.k2_std,
        "center_of_mass_g_m": _listed(body.center_of_mass_g),
        "center_of_mass_std_m": _listed(body.center_of_mass_std),
        "drag_per_rad": body.drag,
        "drag_std_per_rad": body.drag_std,
        "nis_per_dof": evaluation.nis_ratio,
        "accepted": int(history.accepted.sum()),
        "rejected": int(history.rejected.sum()),
        "milliseconds_per_frame": evaluation.milliseconds_per_frame,
        **_error_numbers(evaluation),
    }


def _error_numbers(evaluation: Evaluation) -> dict[str, float | int | str | list[float] | None]:
    errors, body, nees = evaluation.errors, evaluation.body_errors, evaluation.nees
    if errors is None or body is None:
        return {}
    return {
        **_rms_numbers("rms", errors.rms),
        **_rms_numbers("rms_second_half", errors.rms_second_half),
        "ape_rmse_m": errors.ape_rmse,
        "ape_angle_rmse_deg": errors.ape_angle_rmse_deg,
        "principal_moments_error": _listed(body.principal_moments),
        "k1_error": body.k1,
        "k2_error": body.k2,
        "axes_angle_rad": _listed(body.axes_angle),
        "center_of_mass_error_m": _listed(body.center_of_mass_g),
        "nees_per_dof": None if nees is None else _finite(np.mean(nees.total) / nees.dof),
    }


def _rms_numbers(prefix: str, rms: RmsErrors) -> dict[str, float | None]:
    return {
        f"{prefix}_position_m": rms.position,
        f"{prefix}_attitude_rad": rms.attitude,
        f"{prefix}_velocity_m_s": rms.velocity,
        f"{prefix}_rate_rad_s": rms.rate,
    }


def _listed(values: np.ndarray | None) -> list[float] | None:
    return None if values is None else values.tolist()


def _finite(value: float | np.floating) -> float | None:
    return float(value) if np.isfinite(value) else None
