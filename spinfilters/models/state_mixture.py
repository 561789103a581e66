"""A posterior of one epoch's state that need not be Gaussian: weighted Gaussians."""

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
        Pareto k of the importance weights that proposed them (`spinfilters.core.importance_weights`).
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
