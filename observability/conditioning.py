"""Condition numbers of process noise and of estimators' own covariances, by time step and units, and their report."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize_scalar

from spinfilters.core.errors import InputError, ShapeError
from spinfilters.core.linear_algebra import correlation_root
from spinfilters.core.mass_distribution import from_inertia
from spinfilters.models.process import THESIS_NOISE, ProcessNoise, TorqueFreeProcess
from spinfilters.models.rotation_integrator import IntegrationError
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout

BEST_CONDITION: Final = 7 + 4 * np.sqrt(3)
"""Least condition number of a double integrator's noise over all scalings of its velocity."""
WORTH_CHANGING: Final = 0.99
"""Part of a condition number that other units must bring it below, to be worth their while."""
FARTHEST_UNIT: Final = 5.0
"""Logarithm of how far from the ratio of the deviations, and from SI, the best unit of rate is sought."""
NOISY_BLOCKS: Final = ("t", "a", "v", "w")
"""Blocks that process noise reaches; the others are constants."""
TYPICAL_MOMENTS: Final = (1.0322, 1.0, 0.8596)
"""Of the body that `suggest_scaling` assumes: the thesis' (Tweddle 2013, section 6.5.2). Others change the result by little."""


def double_integrator_covariance(dt: float, alpha: float = 1.0) -> Float[np.ndarray, "2 2"]:
    """Covariance of (r, v / alpha) after unit white acceleration over dt s (Tweddle 2013, Eq. 4.118).

    Raises
    ------
    InputError
        Unless dt and alpha are positive and finite.
    """
    _check_positive(dt=dt, alpha=alpha)
    return np.array([[dt**3 / 3, dt**2 / (2 * alpha)], [dt**2 / (2 * alpha), dt / alpha**2]])


def best_time_step(alpha: float) -> float:
    """Best-conditioned time step sqrt(3) / alpha, s (Section 4.9, corrected)."""
    _check_positive(alpha=alpha)
    return float(np.sqrt(3) / alpha)


def best_velocity_unit(dt: float) -> float:
    """Best unit of velocity sqrt(3) / dt, 1/s times that of position."""
    _check_positive(dt=dt)
    return float(np.sqrt(3) / dt)


def noise_covariance(
    dt: float, rate: Float[np.ndarray, " 3"], noise: ProcessNoise | None = None
) -> Float[np.ndarray, "12 12"]:
    """Process covariance of (t, a, v, w) after dt s at this rate, rad/s."""
    process = _process(noise or THESIS_NOISE)
    layout = process.layout
    x = layout.origin()
    x[layout.mean_slice("w")] = rate
    x[layout.mean_slice("s")] = from_inertia(np.diag(TYPICAL_MOMENTS))
    whole = process.noise_covariance(x, dt)
    every = np.arange(layout.error_dim)
    noisy = np.concatenate([every[layout.slice(block)] for block in NOISY_BLOCKS])
    return whole[np.ix_(noisy, noisy)]


def conditions_over(
    steps: Float[np.ndarray, " n"], rate: Float[np.ndarray, " 3"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Condition numbers of `noise_covariance` over time steps, s.

    Columns: in SI and after Jacobi scaling; NaN for too fast a turn.
    """
    plain, jacobi = np.full((2, len(steps)), np.nan)
    for index, dt in enumerate(steps.tolist()):
        try:
            covariance = noise_covariance(dt, rate)
        except IntegrationError:
            break  # longer steps turn the body further
        plain[index] = condition_number(covariance)
        jacobi[index] = condition_number(scaled(covariance, jacobi_scaling(covariance)))
    return plain, jacobi


def improves(before: float, after: float) -> bool:
    """Whether a condition number falls by enough to change units for it."""
    return after < WORTH_CHANGING * before


@cache
def _process(noise: ProcessNoise) -> TorqueFreeProcess:
    """Process shared by all time steps: its compiled functions are worth keeping."""
    return TorqueFreeProcess(StateLayout(FULL_BLOCKS), noise)


def condition_number(covariance: Float[np.ndarray, "n n"]) -> float:
    """Condition number, largest over smallest eigenvalue.

    The smallest is found as the largest of the inverse, through Jacobi scaling and Cholesky.
    So it is right, too, where the number exceeds 1/eps because of unequal units (a graded matrix).

    Raises
    ------
    InputError
        When the matrix is not positive definite.
    """
    whitening = whitening_matrix(covariance)
    return float(np.linalg.eigvalsh(covariance)[-1] * np.linalg.norm(whitening, 2) ** 2)


def jacobi_scaling(covariance: Float[np.ndarray, "n n"]) -> Float[np.ndarray, " n"]:
    """Standard deviations: divided by them, every component has variance 1."""
    variances = np.diag(covariance)
    if covariance.ndim != 2 or covariance.shape[0] != covariance.shape[1]:
        raise ShapeError(f"a covariance is square, got {covariance.shape}")
    if not np.all(np.isfinite(variances) & (variances > 0)):
        raise InputError(
            f"variances {variances.tolist()} must be positive and finite; leave out what no noise reaches"
        )
    return np.sqrt(variances)


def scaled(
    covariance: Float[np.ndarray, "n n"], divisors: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n n"]:
    """The covariance of components divided by these numbers."""
    return covariance / divisors[:, np.newaxis] / divisors


def whitening_matrix(covariance: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """W, lower triangular, with W C W' = I.

    The inverse Cholesky factor of the correlation, its columns divided by the deviations.

    Raises
    ------
    InputError
        When the matrix is not positive definite.
    """
    divisors = jacobi_scaling(covariance)
    try:
        factor = correlation_root(covariance)
    except np.linalg.LinAlgError:
        raise InputError(
            "covariance is not positive definite; take a longer time step or leave out constants"
        ) from None
    return np.linalg.solve(factor, np.eye(len(divisors))) / divisors


@dataclass(frozen=True)
class Scaling:
    """Divisors of a state so that its process noise is well conditioned.

    Attributes
    ----------
    dt : float
        Time step, s.
    velocity, rate : float
        Units alpha of v relative to that of t, and of w relative to that of a, 1/s.
    before, after : float
        Condition numbers of the noise of (a, w) in SI and in these units; `BEST_CONDITION` where nothing
        rotates.
    """

    dt: float
    velocity: float
    rate: float
    before: float
    after: float

    def __str__(self) -> str:
        velocities = f"at {self.dt:g} s hold velocities in units of {self.velocity:.3g} m/s"
        if not improves(self.before, self.after):
            return f"{velocities}; no unit of rate improves on SI: condition of the rotation's noise {self.before:.3g}"
        return (
            f"{velocities}, rates in {self.rate:.3g} rad/s: condition of the rotation's noise {self.before:.3g} -> "
            f"{self.after:.3g}"
        )


def suggest_scaling(dt: float, w: Float[np.ndarray, " 3"]) -> Scaling:
    """Units of velocity and rate for a time step (s) and a body rate (rad/s).

    Raises
    ------
    InputError
        Unless dt is positive and all is finite.
    """
    _check_positive(dt=dt)
    if not np.all(np.isfinite(w)):
        raise InputError(f"body rate {w.tolist()} must be finite, in rad/s")
    covariance = noise_covariance(dt, w, ProcessNoise(1.0, 1.0))
    turn = np.r_[3:6, 9:12]
    rotation = covariance[np.ix_(turn, turn)]
    variances = np.diag(rotation)
    alpha = _rate_unit(rotation, float(np.sqrt(variances[3:].mean() / variances[:3].mean())))
    return Scaling(
        dt=dt,
        velocity=best_velocity_unit(dt),
        rate=alpha,
        before=condition_number(rotation),
        after=condition_number(scaled(rotation, np.repeat([1.0, alpha], 3))),
    )


def _rate_unit(rotation: Float[np.ndarray, "6 6"], start: float) -> float:
    """Best-conditioned unit of rate, if better than the deviations' ratio."""

    def badness(logarithm: float) -> float:
        """Logarithm of the condition number."""
        return float(np.log(condition_number(scaled(rotation, np.repeat([1.0, np.exp(logarithm)], 3)))))

    middle = float(np.log(start))
    reach = abs(middle) + FARTHEST_UNIT
    found: Any = minimize_scalar(badness, bounds=(middle - reach, middle + reach), method="bounded")
    if improves(np.exp(badness(middle)), np.exp(found.fun)):
        return float(np.exp(found.x))
    return start


@dataclass(frozen=True)
class CovarianceConditioning:
    """Condition numbers of a covariance, epoch by epoch; infinite where it is singular or not finite.

    Attributes
    ----------
    name : str
        Of the estimator.
    time : ndarray of shape (n,)
        s.
    plain : ndarray of shape (n,)
        In SI units.
    jacobi : ndarray of shape (n,)
        Every component in units of its own deviation at that epoch.
    fixed : ndarray of shape (n,)
        In one unit per block for all epochs.
    units : dict[str, float]
        Of every block, SI: root mean square deviation in the median epoch; empty where no epoch has a number.
    """

    name: str
    time: Float[np.ndarray, " n"]
    plain: Float[np.ndarray, " n"]
    jacobi: Float[np.ndarray, " n"]
    fixed: Float[np.ndarray, " n"]
    units: dict[str, float]


def covariance_conditioning(
    name: str, layout: StateLayout, time: Float[np.ndarray, " n"], factors: Float[np.ndarray, "n e e"]
) -> CovarianceConditioning:
    """Conditioning of P = factor factor' over epochs, and better units of the blocks."""
    deviations = np.sqrt(np.einsum("tij,tij->ti", factors, factors))
    usable = np.all(np.isfinite(deviations) & (deviations > 0), axis=1)
    if not usable.any():
        nowhere = np.full(len(time), np.inf)
        return CovarianceConditioning(name, time, nowhere, nowhere, nowhere, {})
    typical = np.median(deviations[usable], axis=0)
    units = {block: float(np.sqrt(np.mean(typical[layout.slice(block)] ** 2))) for block in layout.blocks}
    divisors = np.concatenate(
        [np.full(layout.slice(b).stop - layout.slice(b).start, units[b]) for b in layout.blocks]
    )
    found = np.full((3, len(time)), np.inf)
    for epoch in np.flatnonzero(usable):
        scales = (np.ones(len(divisors)), deviations[epoch], divisors)
        found[:, epoch] = [_factor_condition(factors[epoch] / scale[:, np.newaxis]) for scale in scales]
    plain, jacobi, fixed = found
    return CovarianceConditioning(name, time, plain, jacobi, fixed, units)


def _factor_condition(factor: Float[np.ndarray, "e e"]) -> float:
    """Condition number of factor factor', by the factor's singular values.

    It is the square of the factor's: these resolve twice the digits.
    """
    values = np.linalg.svd(factor, compute_uv=False)
    return float((values[0] / values[-1]) ** 2) if values[-1] > 0 else np.inf


def _check_positive(**values: float) -> None:
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{name} is {value}; it must be positive and finite")


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
