"""Everything that is said of one estimator's run, put together once for tables, files and figures."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from spinfilters.errors import InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.body import BodyEstimate, BodyHistory, body_estimate, body_history
from spinfilters.evaluation.bound import ErrorBound
from spinfilters.evaluation.consistency import NormalisedErrors, knows_state, nis_ratio, normalised_errors
from spinfilters.evaluation.errors import (
    Alignment,
    BodyErrors,
    RmsErrors,
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
    alignment: that was applied before the estimate was compared with the truth.
    errors, body_errors: against the truth, None without one.
    nees: None when the truth does not tell the whole state in the estimate's frames.
    bound: beside the errors, where it was asked for and exists.
    """

    history: EstimateHistory
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
    def trajectory(self) -> Trajectory:
        """The motion after every frame, made anew from the history: a long recording has no room for both."""
        return trajectory_of(self.history)

    @property
    def bodies(self) -> BodyHistory:
        """The body after every frame, made anew; `body` is the last."""
        return body_history(self.history)

    @cached_property
    def body(self) -> BodyEstimate:
        """The body after the last frame."""
        return body_estimate(self.history.belief(-1))

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
    """A history, with its errors where there is a truth.

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
    evaluation = Evaluation(history)
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


def numbers(evaluation: Evaluation) -> dict[str, Any]:
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


def _error_numbers(evaluation: Evaluation) -> dict[str, Any]:
    errors, body = evaluation.errors, evaluation.body_errors
    if errors is None or body is None:
        return {}
    return {
        "alignment": str(evaluation.alignment),
        **_rms_numbers("rms", errors.rms),
        **_rms_numbers("rms_second_half", errors.rms_second_half),
        "ape_rmse_m": errors.ape_rmse,
        "ape_angle_rmse_deg": errors.ape_angle_rmse_deg,
        **_body_numbers(body),
        **_nees_numbers(evaluation),
        "bound": None if evaluation.bound is None else _bound_numbers(evaluation.bound),
    }


def _bound_numbers(bound: ErrorBound) -> dict[str, Any]:
    """Under the names of the errors."""
    return {
        **_rms_numbers("rms", bound.rms),
        **_rms_numbers("rms_second_half", bound.rms_second_half),
        **_body_numbers(bound.body),
    }


def _body_numbers(body: BodyErrors) -> dict[str, float | list[float] | None]:
    return {
        "principal_moments_error": _listed(body.principal_moments),
        "k1_error": body.k1,
        "k2_error": body.k2,
        "axes_angle_rad": _listed(body.axes_angle),
        "center_of_mass_error_m": _listed(body.center_of_mass_g),
    }


def _nees_numbers(evaluation: Evaluation) -> dict[str, float | None]:
    """NEES per degree of freedom, mean over the frames: of the whole state, and of each block as nees_per_dof_<block>."""
    nees = evaluation.nees
    if nees is None:
        return {"nees_per_dof": None}
    blocks = {f"nees_per_dof_{block}": _finite(mean) for block, mean in nees.block_means.items()}
    return {"nees_per_dof": _finite(np.mean(nees.total) / nees.dof), **blocks}


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
