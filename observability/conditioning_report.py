"""Report of conditioning: of the process noise over a time step, and of estimators' own covariances."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from observability.conditioning import (
    BEST_CONDITION,
    CovarianceConditioning,
    best_time_step,
    best_velocity_unit,
    condition_number,
    conditions_over,
    double_integrator_covariance,
    improves,
    jacobi_scaling,
    noise_covariance,
    scaled,
    suggest_scaling,
)

TIME_STEPS: Final = np.geomspace(1e-2, 1e2, 161)
"""Of the curves over the time step, s."""


@dataclass(frozen=True)
class ConditioningReport:
    """What is written and printed of condition numbers.

    Attributes
    ----------
    document : dict[str, Any]
        For JSON; ``text`` holds its sentences.
    lines : list[str]
        Of a CSV file, its heading first.
    headings : tuple[str, ...]
        Of the printed table.
    rows : list[tuple[str, ...]]
        Of the printed table.
    """

    document: dict[str, Any]
    lines: list[str]
    headings: tuple[str, ...]
    rows: list[tuple[str, ...]]

    @property
    def sentences(self) -> list[str]:
        """What the numbers say."""
        return self.document["text"]


def noise_report(dt: float, alpha: float, rate: Float[np.ndarray, " 3"]) -> ConditioningReport:
    """Condition numbers of the process noise that gathers over a time step, in several units.

    Parameters
    ----------
    dt : float
        Time step, s.
    alpha : float
        Unit of velocity over that of position, 1/s (Tweddle 2013, Eq. 4.117).
    rate : ndarray of shape (3,)
        Body rate about the principal axes, rad/s.

    Raises
    ------
    IntegrationError
        A rate that is too fast for the time step.
    """
    rows = _noise_rows(dt, alpha, rate)
    document = {
        "time_step_s": dt,
        "alpha_per_s": alpha,
        "rate_rad_s": rate.tolist(),
        "best_time_step_s": best_time_step(alpha),
        "best_alpha_per_s": best_velocity_unit(dt),
        "best_condition_number": float(BEST_CONDITION),
        "condition_numbers": {f"{noise}, {units}": value for noise, units, value in rows},
        "text": _noise_sentences(dt, alpha, rate),
    }
    return ConditioningReport(
        document,
        _lines_over_time_steps(alpha, rate),
        ("process noise over the time step", "units", "condition number"),
        [(noise, units, f"{value:.4g}") for noise, units, value in rows],
    )


def _noise_rows(dt: float, alpha: float, rate: Float[np.ndarray, " 3"]) -> list[tuple[str, str, float]]:
    """(what, units, condition number)."""
    line, turn, whole = "position and velocity", "attitude and rate", "pose and its velocities"
    suggestion, covariance = suggest_scaling(dt, rate), noise_covariance(dt, rate)
    return [
        (line, "SI", condition_number(double_integrator_covariance(dt))),
        (line, f"velocity in {alpha:.4g} m/s", condition_number(double_integrator_covariance(dt, alpha))),
        (turn, "SI", suggestion.before),
        (turn, f"rate in {suggestion.rate:.4g} rad/s", suggestion.after),
        (whole, "SI", condition_number(covariance)),
        (whole, "own deviations (Jacobi)", condition_number(scaled(covariance, jacobi_scaling(covariance)))),
    ]


def _noise_sentences(dt: float, alpha: float, rate: Float[np.ndarray, " 3"]) -> list[str]:
    best, value = best_time_step(alpha), condition_number(double_integrator_covariance(dt, alpha))
    return [
        f"With alpha = {alpha:.4g} 1/s the best time step is sqrt(3)/alpha = {best:.4g} s, with a condition number of "
        f"{BEST_CONDITION:.2f}; at {dt:g} s it is {value:.4g}.",
        f"For a time step of {dt:g} s the best alpha is sqrt(3)/dt = {best_velocity_unit(dt):.4g} 1/s.",
        f"At a body rate of {float(np.linalg.norm(rate)):.3g} rad/s: {suggest_scaling(dt, rate)}.",
    ]


def _lines_over_time_steps(alpha: float, rate: Float[np.ndarray, " 3"]) -> list[str]:
    """Lines of the CSV: condition numbers over `TIME_STEPS`."""
    lines = ["time_step_s,position_velocity_si,position_velocity_alpha,whole_si,whole_jacobi"]
    for dt, *whole in zip(TIME_STEPS.tolist(), *conditions_over(TIME_STEPS, rate), strict=True):
        line = [condition_number(double_integrator_covariance(dt, unit)) for unit in (1.0, alpha)]
        lines.append(",".join(_cell(value) for value in (dt, *line, *whole)))
    return lines


def _cell(value: float) -> str:
    """Cell of a CSV file; empty for what is not finite."""
    return f"{value:.9g}" if np.isfinite(value) else ""


def covariance_report(run: str, found: Sequence[CovarianceConditioning]) -> ConditioningReport:
    """Condition numbers of every estimator's covariance over its epochs, and the units that improve them.

    Parameters
    ----------
    run : str
        Name of the run.
    found : Sequence[CovarianceConditioning]
        Of each estimator.
    """
    lines, rows = ["estimator,time_s,si,one_unit_per_block,own_deviations"], []
    for each in found:
        for row in zip(each.time, each.plain, each.fixed, each.jacobi, strict=True):
            lines.append(",".join([each.name, *map(_cell, row)]))
        for units, values in _kinds(each):
            rows.append((each.name, str(len(values)), units, *map(_number_text, _summary(values))))
    document = {
        "run": run,
        "estimators": {each.name: _document(each) for each in found},
        "text": [_improvement(each) for each in found],
    }
    headings = ("covariance of", "epochs", "units", "condition number: median", "largest")
    return ConditioningReport(document, lines, headings, rows)


def _kinds(each: CovarianceConditioning) -> Sequence[tuple[str, Float[np.ndarray, " n"]]]:
    return (
        ("SI", each.plain),
        ("one unit per block", each.fixed),
        ("every component's own deviation", each.jacobi),
    )


def _summary(values: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """Median and largest of the epochs that have a number; NaN where none has."""
    finite = values[np.isfinite(values)]
    return (float(np.median(finite)), float(finite.max())) if finite.size else (np.nan, np.nan)


def _number_text(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "-"


def _document(each: CovarianceConditioning) -> dict[str, Any]:
    found: dict[str, Any] = {"units_of_blocks": each.units, "epochs": len(each.time)}
    found["epochs_without_a_number"] = int(np.sum(~np.isfinite(each.plain)))
    for units, values in _kinds(each):
        median, largest = _summary(values)
        found[units] = {"median": median, "largest": largest}
    return found


def _improvement(each: CovarianceConditioning) -> str:
    before, after = _summary(each.plain)[0], _summary(each.fixed)[0]
    if not np.isfinite(before):
        return f"{each.name}: no epoch has a finite covariance of positive variances."
    units = ", ".join(f"{block} {unit:.2g}" for block, unit in each.units.items())
    if not improves(before, after):
        return f"{each.name}: no units of whole blocks improve on SI ({before:.3g} in the median; {after:.3g} with {units})."
    return f"{each.name}: blocks in units of {units} (SI) take the median condition number from {before:.3g} to {after:.3g}."
