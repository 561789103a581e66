"""Columns of a campaign's rows: factors, results and cost, and how an evaluation fills them."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import pyarrow as pa

from spinfilters.evaluation.epoch_spans import EpochSpan, own_span, shared_span
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.metrics import Metric, metrics, values_by_column
from spinfilters.filters.noise_levels import VarianceComponent
from spinfilters.io.disturbances import DENSITIES
from spinfilters.io.sensor_format import noise_options
from spinfilters.models.status import QUANTITIES

TIMES: Final[tuple[str, ...]] = ("simulate", "initialise", "estimate", "evaluate")
"""Seconds of processor time of one run's parts."""
OUTCOMES: Final = ("done", "refused", "raised", "timeout", "killed")
"""How a run ended: "refused" by a message to the user, "raised" by an unexpected error, "timeout" by its own time limit,
"killed" by a signal, as from the system's memory killer."""
MOST_EPOCHS: Final = 60
"""Epochs of which NEES is kept, at most; of longer runs some."""
VOLATILE: Final = ("time_", "host", "finished")
"""How columns begin that depend on when and where a run was made."""

_TEXT, _NUMBER = pa.string(), pa.float64()
_TYPES: Final = {float: _NUMBER, int: pa.int64(), str: _TEXT, bool: pa.bool_(), list: pa.list_(_NUMBER)}
"""Arrow's types of the kinds of metrics."""


def noise_levels() -> tuple[str, ...]:
    """Noise levels of the rows: every option of a sensor that data sets state, and the densities of the disturbances."""
    return (*(each.name for each in noise_options().values() if each.in_dataset), *DENSITIES)


def schema(factors: list[str]) -> pa.Schema:
    """Schema of the rows of a study with these factors.

    ``run``, ``cell``, ``seed``; a column of text per factor; then what came out, by the columns of `metrics`: NEES per degree
    of freedom and root mean squares of errors over the estimator's own epochs, constants after the last one; ``bound_`` stands
    in the place of ``error_``. A noise level has three columns: true, as identified (absent where it is stated), and the standard
    deviation of the logarithm of its variance.
    """
    return pa.schema(
        [
            *((name, pa.int64()) for name in ("run", "cell", "seed")),
            *((name, _TEXT) for name in factors),
            *((name, _TEXT) for name in ("outcome", "reason", "verdict_reasons", "verdict_checks")),
            *((f"holds_{name}", _TEXT) for name in QUANTITIES),
            ("model_errors", _TEXT),
            *((metric.column_name, _TYPES[metric.kind]) for metric in metrics() if metric.column_name),
            *((metric.bound_column, _TYPES[metric.kind]) for metric in metrics() if metric.bound_column),
            *((name, pa.list_(pa.float32())) for name in ("nees_time_s", "nees_over_time")),
            *((name, _TEXT) for name in ("version", "packages")),
            *((f"time_{name}_s", _NUMBER) for name in (*TIMES, "total")),
            *((name, _TEXT) for name in ("finished", "host")),
            *(
                (f"{what}_{name}", _NUMBER)
                for what in ("true", "found", "log_std")
                for name in noise_levels()
            ),
        ]
    )


def is_volatile(column: str) -> bool:
    """Whether a column differs when a run is repeated."""
    return column.startswith(VOLATILE)


def span_of_rows(evaluation: Evaluation, shared: float | None) -> EpochSpan:
    """The epochs of a row's errors: the estimator's own, from the time ``shared`` (s) on where there is one."""
    return own_span(evaluation) if shared is None else shared_span(evaluation, shared)


def result_columns(
    evaluation: Evaluation, shared: float | None = None, chosen: Sequence[Metric] | None = None
) -> dict[str, Any]:
    """Columns of a run that ended, over the epochs of `span_of_rows`; those of errors are None without a truth.

    ``chosen`` are `metrics`, where the caller has looked them up for many runs.
    """
    status, own = evaluation.history.status, span_of_rows(evaluation, shared)
    chosen = metrics() if chosen is None else chosen
    found: dict[str, Any] = {
        "verdict_reasons": "; ".join(status.reasons),
        "verdict_checks": " ".join(each.check for each in status.findings),
        **{f"holds_{name}": str(state) for name, state in status.holds.items()},
        **values_by_column(chosen, own),
    }
    if own.nees is not None:
        every = -(-len(own.nees.time) // MOST_EPOCHS)
        kept = slice((len(own.nees.time) - 1) % every, None, every)  # the last epoch is among them
        found["nees_time_s"] = own.nees.time[kept].tolist()
        found["nees_over_time"] = (own.nees.total[kept] / own.nees.dof).tolist()
    return found


def bound_columns(evaluation: Evaluation, shared: float | None = None) -> dict[str, Any]:
    """Columns of the Cramer-Rao bound over the epochs of `span_of_rows`; empty without one."""
    if evaluation.bound is None:
        return {}
    own = span_of_rows(evaluation, shared)
    return {metric.bound_column: metric.bound_of(own) for metric in metrics() if metric.bound_column}


def noise_columns(identified: Sequence[VarianceComponent], true: Mapping[str, float]) -> dict[str, Any]:
    """Columns of identified noise levels and the true ones."""
    found: dict[str, Any] = {f"true_{name}": level for name, level in true.items()}
    for each in identified:
        if each.name in noise_levels():
            found |= {f"found_{each.name}": each.value, f"log_std_{each.name}": each.log_std}
    return found
