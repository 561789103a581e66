"""The figures of a run by name, ready for JSON."""

from typing import Any

import numpy as np

from spinfilters.evaluation.error_bound import ErrorBound
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.reported_constants import constant_numbers
from spinfilters.evaluation.span import (
    ALWAYS,
    ObservationUse,
    SpanErrors,
    middle,
    observation_use,
    span_errors,
)
from spinfilters.evaluation.trajectory_errors import BodyErrors, RmsErrors


def numbers(evaluation: Evaluation, shared: float = ALWAYS) -> dict[str, Any]:
    """The figures of a run by name with unit, None if absent.

    Errors, NEES and counts are over the estimator's own epochs, which a filter has behind its initialisation; ``ape`` is over
    all, as evo has it of the files.

    Parameters
    ----------
    shared: time (s) from which on all estimators of a run have epochs of their own; ``shared_epochs`` are over these.
    """
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
        **constant_numbers(evaluation.constants),
        "nis_per_dof": evaluation.nis_ratio,
        "accepted": int(history.accepted[history.own].sum()),
        "rejected": int(history.rejected[history.own].sum()),
        "milliseconds_per_frame": evaluation.milliseconds_per_frame,
        **_error_numbers(evaluation, shared),
    }


def use_numbers(evaluation: Evaluation, shared: float) -> dict[str, Any]:
    """Numbers of used observations of an estimator.

    Over its own epochs, and over those that all estimators of the run have.
    """
    history = evaluation.history
    return {
        **_use(observation_use(history, ALWAYS)),
        "shared_epochs": _use(observation_use(history, shared)),
    }


def _use(use: ObservationUse | None) -> dict[str, float | None]:
    return {
        "epochs": 0 if use is None else len(use.accepted),
        "used_per_epoch": None if use is None else use.used_per_epoch,
        "available_per_epoch": None if use is None else use.available_per_epoch,
        "share_used": None if use is None else use.share,
    }


def _error_numbers(evaluation: Evaluation, shared: float) -> dict[str, Any]:
    errors, body, begin = evaluation.errors, evaluation.body_errors, evaluation.own_begin
    if errors is None or body is None:
        return {}
    own = None if begin is None else span_errors(evaluation, begin)
    late = None if begin is None else span_errors(evaluation, max(begin, middle(evaluation)))
    first = evaluation.history.initialisation_end
    return {
        "alignment": str(evaluation.alignment),
        **_rms_numbers("rms", None if own is None else own.rms),
        **_rms_numbers("rms_second_half", None if late is None else late.rms),
        "ape_rmse_m": errors.ape_rmse,
        "ape_angle_rmse_deg": errors.ape_angle_rmse_deg,
        **_body_numbers(body),
        **_nees_numbers(own),
        "bound": None if evaluation.bound is None else _bound_numbers(evaluation.bound, own, late),
        **({} if evaluation.bound_missing is None else {"bound_missing": evaluation.bound_missing}),
        "shared_epochs": None
        if begin is None
        else _span_numbers(span_errors(evaluation, max(shared, begin))),
        "initialisation": None if first is None else _span_numbers(span_errors(evaluation, ALWAYS, first)),
    }


def _span_numbers(span: SpanErrors | None) -> dict[str, Any] | None:
    if span is None:
        return None
    bound = {} if span.bound is None else _rms_numbers("bound_rms", span.bound)
    return {"epochs": span.epochs, **_rms_numbers("rms", span.rms), **bound, **_nees_numbers(span)}


def _bound_numbers(bound: ErrorBound, own: SpanErrors | None, late: SpanErrors | None) -> dict[str, Any]:
    """Numbers of the bound under the names of the errors."""
    return {
        **_rms_numbers("rms", None if own is None else own.bound),
        **_rms_numbers("rms_second_half", None if late is None else late.bound),
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


def _nees_numbers(span: SpanErrors | None) -> dict[str, float | None]:
    """Mean NEES per degree of freedom over the epochs.

    It is told of the whole state, and of each block as nees_per_dof_<block>.
    """
    if span is None or span.nees is None:
        return {"nees_per_dof": None}
    blocks = {f"nees_per_dof_{block}": _finite(mean) for block, mean in span.nees_blocks.items()}
    return {"nees_per_dof": _finite(span.nees), **blocks}


def _rms_numbers(prefix: str, rms: RmsErrors | None) -> dict[str, float | None]:
    return {
        f"{prefix}_position_m": None if rms is None else rms.position,
        f"{prefix}_attitude_rad": None if rms is None else rms.attitude,
        f"{prefix}_velocity_m_s": None if rms is None else rms.velocity,
        f"{prefix}_rate_rad_s": None if rms is None else rms.rate,
    }


def _listed(values: np.ndarray | None) -> list[float] | None:
    return None if values is None else values.tolist()


def _finite(value: float | np.floating) -> float | None:
    return float(value) if np.isfinite(value) else None
