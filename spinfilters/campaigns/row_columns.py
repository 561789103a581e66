"""Columns of a campaign's rows: factors, results and cost, and how an evaluation fills them."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import pyarrow as pa
from jaxtyping import Float, Int

from spinfilters.core.linear_algebra import normalised_square
from spinfilters.evaluation.consistency import true_states
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.metrics import span_errors
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR, stated_errors
from spinfilters.evaluation.trajectory_errors import BodyErrors, RmsErrors, TruthErrors, common_stamps
from spinfilters.filters.history import EstimateHistory
from spinfilters.filters.noise_levels import DISTURBANCES, VarianceComponent
from spinfilters.io.sensor_format import noise_options
from spinfilters.io.truth import Truth
from spinfilters.models.status import QUANTITIES, Verdict

ERRORS: Final = ("position_m", "attitude_rad", "velocity_m_s", "rate_rad_s")
"""Root mean square over the estimator's own epochs, and at the last one."""
BODY_ERRORS: Final = ("moment_1", "moment_2", "k1", "k2", "center_of_mass_m")
"""At the last epoch; moments relative to the largest."""
BLOCKS: Final = ("t", "a", "v", "w", "c", "s")
"""Of the state, whose NEES per degree of freedom is kept."""
TIMES: Final[tuple[str, ...]] = ("simulate", "initialise", "estimate", "evaluate")
"""Seconds of processor time of one run's parts."""
OUTCOMES: Final = ("done", "refused", "raised", "timeout", "killed")
"""How a run ended: "refused" by a message to the user, "raised" by an unexpected error, "timeout" by its own time limit,
"killed" by a signal, as from the system's memory killer."""
MOST_EPOCHS: Final = 60
"""Epochs of which NEES is kept, at most; of longer runs some."""
VOLATILE: Final = ("time_", "host", "finished")
"""How columns begin that depend on when and where a run was made."""

_TEXT, _WHOLE, _NUMBER = pa.string(), pa.int64(), pa.float64()
_FIXED: Final[tuple[tuple[str, pa.DataType], ...]] = (
    ("outcome", _TEXT),
    ("reason", _TEXT),
    ("verdict", _TEXT),
    ("verdict_reasons", _TEXT),
    ("verdict_checks", _TEXT),
    *((f"holds_{name}", _TEXT) for name in QUANTITIES),
    ("model_errors", _TEXT),
    ("right", pa.bool_()),
    ("worst_error", _NUMBER),
    ("worst_quantity", _TEXT),
    ("epochs", _WHOLE),
    ("accepted", _WHOLE),
    ("rejected", _WHOLE),
    ("nis", _NUMBER),
    ("dof", _WHOLE),
    ("nees", _NUMBER),
    ("nees_last", _NUMBER),
    *((f"nees_{block}", _NUMBER) for block in BLOCKS),
    *((f"error_{name}", _NUMBER) for name in ERRORS),
    *((f"last_{name}", _NUMBER) for name in ERRORS),
    *((f"error_{name}", _NUMBER) for name in BODY_ERRORS),
    *((f"std_{name}", _NUMBER) for name in BODY_ERRORS[:4]),
    *((f"bound_{name}", _NUMBER) for name in (*ERRORS, *BODY_ERRORS)),
    ("nees_time_s", pa.list_(pa.float32())),
    ("nees_over_time", pa.list_(pa.float32())),
    ("version", _TEXT),
    ("packages", _TEXT),
    *((f"time_{name}_s", _NUMBER) for name in TIMES),
    ("time_total_s", _NUMBER),
    ("finished", _TEXT),
    ("host", _TEXT),
)


def noise_levels() -> tuple[str, ...]:
    """Noise levels of the rows: every option of a sensor that data sets state, and the densities of the disturbances."""
    return (*(each.name for each in noise_options().values() if each.in_dataset), *DISTURBANCES)


def schema(factors: list[str]) -> pa.Schema:
    """Schema of the rows of a study with these factors.

    ``run``, ``cell``, ``seed``; a column of text per factor; then what came out. NEES are per degree of freedom, means over the
    estimator's own epochs; errors are lengths; ``bound_`` stands in the place of ``error_``. A noise level has three columns: true,
    as identified (absent where it is stated), and the standard deviation of the logarithm of its variance.
    """
    asked = [("run", _WHOLE), ("cell", _WHOLE), ("seed", _WHOLE), *((name, _TEXT) for name in factors)]
    noise = [(f"{what}_{name}", _NUMBER) for what in ("true", "found", "log_std") for name in noise_levels()]
    return pa.schema([*asked, *_FIXED, *noise])


def is_volatile(column: str) -> bool:
    """Whether a column differs when a run is repeated."""
    return column.startswith(VOLATILE)


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
    return found | _error_metrics(evaluation) | nees_metrics(evaluation, truth) | _rightness(evaluation)


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
        if each.name in noise_levels():
            found |= {f"found_{each.name}": each.value, f"log_std_{each.name}": each.log_std}
    return found


def _rightness(evaluation: Evaluation) -> dict[str, Any]:
    failed = evaluation.history.status.verdict is Verdict.FAILED
    sizes = stated_errors(evaluation)
    if not sizes:
        return {}
    quantity, worst = max(sizes.items(), key=lambda each: each[1])
    right = worst <= LARGEST_STATED_ERROR and not (failed and not np.isfinite(worst))
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
    """NEES of rate and mass distribution, which need no frame i: for a gyro, whose axes are those of g."""
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
