"""Condition numbers of process noise and covariances, by time step and units."""

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
