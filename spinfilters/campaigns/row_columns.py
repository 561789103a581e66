"""Columns of a campaign's rows: factors, results and cost, and how an evaluation fills them."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import pyarrow as pa

from spinfilters.evaluation.consistency import NormalisedErrors
from spinfilters.evaluation.epoch_spans import EpochSpan, own_span, shared_span
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.metrics import Metric, metrics, values_by_column, values_of_runs
from spinfilters.filters.noise_levels import VarianceComponent
from spinfilters.io.disturbances import DENSITIES
from spinfilters.io.sensor_format import noise_options
from spinfilters.models.status import QUANTITIES, EstimatorStatus

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
    own = span_of_rows(evaluation, shared)
    found = _verdict_columns(evaluation.history.status)
    found |= values_by_column(metrics() if chosen is None else chosen, own)
    if own.nees is not None:
        found["nees_time_s"], found["nees_over_time"] = _thinned_nees(own.nees)
    return found


def columns_of_runs(
    evaluation: Evaluation, runs: int, shared: float | None, chosen: Sequence[Metric]
) -> list[dict[str, Any]]:
    """`result_columns` of each of many runs that were evaluated together."""
    own = span_of_rows(evaluation, shared)
    same, columns = _verdict_columns(evaluation.history.status), values_of_runs(chosen, own, runs)
    if own.nees is not None:
        same["nees_time_s"], columns["nees_over_time"] = _thinned_nees(own.nees)
    return [same | dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]


def _verdict_columns(status: EstimatorStatus) -> dict[str, Any]:
    return {
        "verdict_reasons": "; ".join(status.reasons),
        "verdict_checks": " ".join(each.check for each in status.findings),
        **{f"holds_{name}": str(state) for name, state in status.holds.items()},
    }


def _thinned_nees(nees: NormalisedErrors) -> tuple[list[float], list[Any]]:
    """Times, s, and NEES per degree of freedom of at most `MOST_EPOCHS` epochs, the last among them."""
    every = -(-len(nees.time) // MOST_EPOCHS)
    kept = slice((len(nees.time) - 1) % every, None, every)
    return nees.time[kept].tolist(), (nees.total[..., kept] / nees.dof).tolist()


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
