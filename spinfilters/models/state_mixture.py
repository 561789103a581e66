"""Beliefs of one epoch's state that need not be Gaussian: a sampled posterior, and errors with several possible covariances."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.models.state_layout import StateLayout

BISECTIONS = 60
"""Halvings of the interval of a quantile, which leave rounding."""
REACH = 10.0
"""Standard deviations beyond the outermost components within which a quantile lies."""


@dataclass(frozen=True)
class StateMixture:
    """Weighted Gaussians over a layout, with what made them.

    Attributes
    ----------
    layout : StateLayout
        Of the state.
    means : ndarray of float, shape (n, m)
        Of the components.
    factors : ndarray of float, shape (n, e, e)
        Square roots of their covariances.
    weights : ndarray of float, shape (n,)
        Their sum is one.
    shape : float
        Pareto k of the importance weights that proposed them (`spinfilters.core.posterior_sampling`).
    method : str
        "importance" or "mcmc".
    mass_points, mass_weights : ndarray of float, shapes (p, 5) and (p,), or None
        More mass distributions of the same posterior than there are components, for quantities of the body alone, and their
        weights; None where those of the components serve.
    """

    layout: StateLayout
    means: Float[np.ndarray, "n m"]
    factors: Float[np.ndarray, "n e e"]
    weights: Float[np.ndarray, " n"]
    shape: float
    method: str
    mass_points: Float[np.ndarray, "p 5"] | None = None
    mass_weights: Float[np.ndarray, " p"] | None = None


@dataclass(frozen=True)
class ErrorMixture:
    """Error of one estimate where its covariance is one of several: weighted Gaussians, all about zero.

    Attributes
    ----------
    weights : ndarray of float, shape (c,)
        Their sum is one.
    factors : ndarray of float, shape (c, e, e)
        Square roots of their covariances.
    """

    weights: Float[np.ndarray, " c"]
    factors: Float[np.ndarray, "c e e"]


def central_half_widths(
    levels: Float[np.ndarray, " p"], std: Float[np.ndarray, "c q"], weights: Float[np.ndarray, " c"]
) -> Float[np.ndarray, "p q"]:
    """Half widths h of central intervals of scalar mixtures of Gaussians about zero: P(|x| < h) is the level.

    Parameters
    ----------
    levels : ndarray of float, shape (p,)
        Probabilities.
    std : ndarray of float, shape (c, q)
        Deviations of the components of each of q mixtures.
    weights : ndarray of float, shape (c,)
        The same for all.
    """
    nothing, upper = np.zeros(len(weights)), 0.5 * (1 + levels)
    return np.array([mixture_quantiles(upper, nothing, column, weights) for column in std.T]).T


def mixture_probability(
    at: Float[np.ndarray, " q"],
    values: Float[np.ndarray, " n"],
    std: Float[np.ndarray, " n"],
    weights: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " q"]:
    """Probability that a scalar mixture of Gaussians lies below some numbers; components of no width are points."""
    from scipy.special import ndtr  # here alone: a smoother loads this module and needs none of it

    away = at[:, np.newaxis] - values
    below = np.where(std > 0, ndtr(away / np.where(std > 0, std, 1.0)), 0.5 * (1 + np.sign(away)))
    return below @ weights


def mixture_quantiles(
    levels: Float[np.ndarray, " q"],
    values: Float[np.ndarray, " n"],
    std: Float[np.ndarray, " n"],
    weights: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " q"]:
    """Quantiles of a scalar mixture of Gaussians, by bisection of its probability."""
    low = np.full(len(levels), (values - REACH * std).min())
    high = np.full(len(levels), (values + REACH * std).max())
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        below = mixture_probability(middle, values, std, weights) < levels
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)
