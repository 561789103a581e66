"""Numbers that describe an evaluation, and the epochs over which estimators are compared."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Int

from spinfilters.evaluation.estimator_evaluation import ErrorBound, Evaluation, constant_numbers
from spinfilters.evaluation.trajectory_errors import BodyErrors, RmsErrors
from spinfilters.filters.history import EstimateHistory
from spinfilters.models.status import LABELS, TRANSLATION, Holds, Verdict

ALWAYS: Final = -np.inf
"""Begin of a span that leaves nothing out, s."""
IDENTICAL = "Estimators on identical measurements"
NOT_IDENTICAL = "Estimators on the same recording, each on the observations that it used"


@dataclass(frozen=True)
class SpanErrors:
    """Errors of a span of epochs.

    Attributes
    ----------
    epochs : int
        How many have a truth.
    rms : RmsErrors
        Root mean squares of the errors.
    bound : RmsErrors or None
        Root mean squares of the bound, None where there is none.
    nees, nees_blocks : float or None, Mapping[str, float]
        Mean NEES per degree of freedom, of the whole state and by block; None and empty without any.
    """

    epochs: int
    rms: RmsErrors
    bound: RmsErrors | None
    nees: float | None
    nees_blocks: Mapping[str, float]


def span_errors(evaluation: Evaluation, begin: float, end: float = np.inf) -> SpanErrors | None:
    """Errors from begin to end (s), both within; None without a truth there."""
    errors = None if evaluation.errors is None else evaluation.errors.within(begin, end)
    if errors is None:
        return None
    nees = None if evaluation.nees is None else evaluation.nees.within(begin, end)
    return SpanErrors(
        len(errors.time),
        errors.rms,
        None if evaluation.bound is None else evaluation.bound.over(errors.rows),
        None if nees is None else nees.mean,
        {} if nees is None else nees.block_means,
    )


def shared_begin(evaluations: Sequence[Evaluation]) -> float:
    """Time of the first own epoch common to all estimators that have any, s; `ALWAYS` where none has."""
    begins = [evaluation.own_begin for evaluation in evaluations]
    return max((begin for begin in begins if begin is not None), default=ALWAYS)


def initialisation_end(evaluations: Sequence[Evaluation]) -> float | None:
    """Time of the last epoch of the filters' initialisation, s; None where no estimator has one."""
    ends = [evaluation.history.initialisation_end for evaluation in evaluations]
    return max((end for end in ends if end is not None), default=None)


def middle(evaluation: Evaluation) -> float:
    """Middle of the recording, s: behind it nothing of the beginning shows."""
    time = evaluation.history.time
    return float(time[0] + time[-1]) / 2


@dataclass(frozen=True)
class ObservationUse:
    """Numbers of used and unused observations of some epochs.

    Attributes
    ----------
    accepted, rejected : (n,) int array
        Numbers of observations used, and refused.
    available : (n,) int array or None
        All of them, None where not told.
    """

    accepted: Int[np.ndarray, " n"]
    rejected: Int[np.ndarray, " n"]
    available: Int[np.ndarray, " n"] | None

    @property
    def used_per_epoch(self) -> float:
        """Mean number of used observations per epoch."""
        return float(self.accepted.mean())

    @property
    def available_per_epoch(self) -> float | None:
        """Mean number of available observations per epoch; None if unknown."""
        return None if self.available is None else float(self.available.mean())

    @property
    def share(self) -> float | None:
        """Used share of the available observations, 0 to 1; None if unknown."""
        return None if self.available is None else float(self.accepted.sum() / max(self.available.sum(), 1))

    @property
    def uses_all(self) -> bool:
        """Whether every observation is known to have been used."""
        return self.available is not None and np.array_equal(self.accepted, self.available)


def observation_use(history: EstimateHistory, begin: float) -> ObservationUse | None:
    """Use of observations in the estimator's epochs from begin (s); None without any."""
    rows = np.flatnonzero(history.time >= begin)
    rows = rows[rows >= history.initialisation]
    if not rows.size:
        return None
    available = None if history.observations is None else history.observations[rows]
    return ObservationUse(history.accepted[rows], history.rejected[rows], available)


def on_identical_measurements(evaluations: Sequence[Evaluation]) -> bool:
    """Whether every estimator used every observation of the epochs that all of them have."""
    begin = shared_begin(evaluations)
    uses = [observation_use(evaluation.history, begin) for evaluation in evaluations]
    epochs = {len(use.accepted) for use in uses if use is not None}
    return len(epochs) == 1 and all(use is not None and use.uses_all for use in uses)


def title_sentences(evaluations: Sequence[Evaluation]) -> list[str]:
    """Title sentences of a comparison; empty for a single estimator."""
    if len(evaluations) == 1:
        return []
    return [IDENTICAL if on_identical_measurements(evaluations) else NOT_IDENTICAL]


def numbers(evaluation: Evaluation, shared: float = ALWAYS) -> dict[str, Any]:
    """The figures of a run by name with unit, None if absent.

    Errors, NEES and counts are over the estimator's own epochs, which a filter has behind its initialisation; ``ape`` is over
    all, as evo has it of the files.

    Parameters
    ----------
    shared : float
        Time (s) from which on all estimators of a run have epochs of their own; ``shared_epochs`` are over these.
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
    """Numbers of used observations over the estimator's own epochs, and over those that all estimators have."""
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
    """Mean NEES per degree of freedom of the whole state, and of each block as nees_per_dof_<block>."""
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


def held_text(evaluation: Evaluation) -> str:
    """Name the quantities that hold, as "all but moments, axes" or "only position, rate", whichever is shorter.

    Quantities that its sensors cannot see are left out; empty of an estimate that has not been judged.
    """
    status, layout = evaluation.history.status, evaluation.history.layout
    names = [name for name in status.holds if layout.translates or name not in TRANSLATION]
    good = [LABELS[name] for name in names if status.holds[name] is Holds.OK]
    other = [LABELS[name] for name in names if status.holds[name] is not Holds.OK]
    if not names:
        return ""
    if not good or status.verdict is Verdict.FAILED:
        return "nothing"
    if not other:
        return "all"
    return f"all but {', '.join(other)}" if len(other) <= len(good) else f"only {', '.join(good)}"
