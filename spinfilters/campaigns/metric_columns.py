"""Metrics of an evaluation as columns of a campaign."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from spinfilters.campaigns.schema import BLOCKS, BODY_ERRORS, ERRORS, LEVELS, MOST_EPOCHS
from spinfilters.campaigns.stated_errors import LARGEST, stated_errors
from spinfilters.data.truth import Truth
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.identification.components import VarianceComponent
from spinfilters.evaluation.consistency import true_states
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.span import span_errors
from spinfilters.evaluation.trajectory_errors import BodyErrors, RmsErrors, TruthErrors, common_stamps
from spinfilters.linear_algebra.normalised_square import normalised_square
from spinfilters.state.status import Verdict


def metrics(evaluation: Evaluation, truth: Truth | None) -> dict[str, Any]:
    """Columns of a run that ended; those of errors are absent without a truth."""
    history = evaluation.history
    found: dict[str, Any] = {
        "verdict": str(history.status.verdict),
        "verdict_reasons": "; ".join(history.status.reasons),
        "verdict_checks": " ".join(each.check for each in history.status.findings),
        **{f"holds_{name}": str(state) for name, state in history.status.holds.items()},
        "epochs": len(history.time),
        "accepted": int(history.accepted[history.own].sum()),
        "rejected": int(history.rejected[history.own].sum()),
        "nis": evaluation.nis_ratio,
    }
    if truth is None or evaluation.errors is None:
        return found
    return (
        found | _error_metrics(evaluation) | nees_metrics(evaluation, truth) | _rightness(evaluation, truth)
    )


def bound_metrics(evaluation: Evaluation) -> dict[str, Any]:
    """Columns of the Cramer-Rao bound; empty without one."""
    bound, begin = evaluation.bound, evaluation.own_begin
    if bound is None or begin is None:
        return {}
    span = span_errors(evaluation, begin)
    rms = {} if span is None or span.bound is None else _rms("bound", span.bound)
    return rms | _body("bound", bound.body)


def noise_metrics(identified: Sequence[VarianceComponent], true: Mapping[str, float]) -> dict[str, Any]:
    """Columns of identified noise levels beside the true ones."""
    found: dict[str, Any] = {f"true_{name}": level for name, level in true.items()}
    for each in identified:
        if each.name in LEVELS:
            found |= {f"found_{each.name}": each.value, f"log_std_{each.name}": each.log_std}
    return found


def _rightness(evaluation: Evaluation, truth: Truth) -> dict[str, Any]:
    failed = evaluation.history.status.verdict is Verdict.FAILED
    sizes = stated_errors(evaluation, truth)
    if not sizes:
        return {}
    quantity, worst = max(sizes.items(), key=lambda each: each[1])
    right = worst <= LARGEST and not (failed and not np.isfinite(worst))
    return {"right": bool(right), "worst_error": worst, "worst_quantity": quantity}


def _error_metrics(evaluation: Evaluation) -> dict[str, Any]:
    errors, body, begin = evaluation.errors, evaluation.body_errors, evaluation.own_begin
    assert errors is not None
    own = None if begin is None else errors.within(begin, np.inf)
    found = {} if own is None else _rms("error", own.rms) | _last(own)
    if body is None:
        return found
    estimate = evaluation.body
    deviations = [*estimate.principal_moments_std[:2], estimate.k1_std, estimate.k2_std]
    stated = {f"std_{name}": float(std) for name, std in zip(BODY_ERRORS[:4], deviations, strict=True)}
    return found | _body("error", body) | stated


def _last(errors: TruthErrors) -> dict[str, Any]:
    each = (errors.position, errors.attitude, errors.velocity, errors.rate)
    return {
        f"last_{name}": None if values is None else float(np.linalg.norm(values[-1]))
        for name, values in zip(ERRORS, each, strict=True)
    }


def _rms(prefix: str, rms: RmsErrors) -> dict[str, Any]:
    each = (rms.position, rms.attitude, rms.velocity, rms.rate)
    return {f"{prefix}_{name}": value for name, value in zip(ERRORS, each, strict=True)}


def _body(prefix: str, body: BodyErrors) -> dict[str, Any]:
    moments = (None, None) if body.principal_moments is None else body.principal_moments[:2].tolist()
    centre = None if body.center_of_mass_g is None else float(np.linalg.norm(body.center_of_mass_g))
    each = (*moments, body.k1, body.k2, centre)
    return {f"{prefix}_{name}": value for name, value in zip(BODY_ERRORS, each, strict=True)}


def nees_metrics(evaluation: Evaluation, truth: Truth) -> dict[str, Any]:
    """NEES per degree of freedom over the filter's epochs; for a gyro, without attitude."""
    nees, begin = evaluation.nees, evaluation.own_begin
    if nees is None and begin is not None and not evaluation.history.layout.translates:
        return _body_nees(evaluation.history, truth)
    own = None if nees is None or begin is None else nees.within(begin, np.inf)
    if own is None:
        return {}
    every = -(-len(own.time) // MOST_EPOCHS)
    kept = slice((len(own.time) - 1) % every, None, every)
    blocks = {f"nees_{name}": value for name, value in own.block_means.items() if name in BLOCKS}
    return {
        "dof": own.dof,
        "nees": own.mean,
        "nees_last": float(own.total[-1]) / own.dof,
        **blocks,
        "nees_time_s": own.time[kept].tolist(),
        "nees_over_time": (own.total[kept] / own.dof).tolist(),
    }


def _body_nees(history: EstimateHistory, truth: Truth) -> dict[str, Any]:
    """NEES of rate and mass distribution, which need no frame i.

    Serves a gyro, whose axes are those of g.
    """
    layout, (epochs, rows) = history.layout, common_stamps(history.time, truth.time)
    own = epochs >= history.initialisation
    epochs, rows = epochs[own], rows[own]
    if not len(epochs):
        return {}
    error = layout.local(history.mean[epochs], true_states(truth, layout)[rows])

    columns = {block: np.arange(layout.error_dim)[layout.slice(block)] for block in "ws"}

    def of(at: Int[np.ndarray, " j"]) -> Float[np.ndarray, " n"]:
        """NEES per dimension of these components."""
        return normalised_square(error[:, at], history.factor[epochs][:, at]) / len(at)

    both = np.concatenate(list(columns.values()))
    total = of(both)
    each = {f"nees_{block}": float(np.mean(of(at))) for block, at in columns.items()}
    return {"dof": len(both), "nees": float(np.mean(total)), "nees_last": float(total[-1]), **each}
