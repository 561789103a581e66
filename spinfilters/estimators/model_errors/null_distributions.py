"""Probabilities of what score tests find where the model is right.

A variance of m errors is tested by Q = sum w_i z_i^2, with z_i standard normal and weights w_i of unlike size, relative to a noise
level that n degrees of freedom of the same residuals tell: P(Q > q chi2_n / n). Its tail is that of an indefinite form in normal
numbers, by the saddlepoint of its cumulant function (Lugannani and Rice 1980; Kuonen 1999).

The gain of m constant errors, the fall of -2 ln of a likelihood profiled over noise levels of n degrees of freedom, is
n ln(1 + m F / (n - m)) with F of Fisher's distribution, and chi-squared for levels that are known.
"""

from collections.abc import Callable
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from spinfilters.linear_algebra.chi_square import chi_square_tail, fisher_tail

NEAR_MEAN: Final = 1e-4
"""Signed root of the likelihood ratio below which the saddlepoint is at the mean, where its own formula is 0 / 0."""
FEWEST: Final = 2.0
"""Degrees of freedom left for a noise level, at least."""


def weighted_chi_square_tail(weights: Float[np.ndarray, " n"], value: float, dof: float) -> float:
    """P(sum of weights z^2 > value chi2_dof / dof).

    Weights positive, ``dof`` infinite for a known noise level.
    """
    w = weights[weights > 0]
    if not w.size or not value > 0:
        return 1.0
    if not np.isfinite(dof):
        return _tail(w, np.ones(len(w)), value)
    return _tail(np.append(w, -value / dof), np.append(np.ones(len(w)), dof), 0.0)


def _tail(w: Float[np.ndarray, " n"], count: Float[np.ndarray, " n"], value: float) -> float:
    """P(sum of w chi2_count > value)."""

    def slope(t: float) -> float:
        """Slope of the exponent at t."""
        return float((count * w / (1 - 2 * t * w)).sum()) - value

    low, high = -0.5 / abs(w.min()) if w.min() < 0 else -_far(slope, w), 0.5 / w.max()
    margin = 1e-12
    from scipy.optimize import brentq  # here alone: half a tenth of a second of every command's start

    t = float(brentq(slope, low * (1 - margin), high * (1 - margin)))  # pyright: ignore[reportArgumentType]
    cumulant = -0.5 * float((count * np.log1p(-2 * t * w)).sum())
    curvature = 2 * float((count * (w / (1 - 2 * t * w)) ** 2).sum())
    r = float(np.sign(t) * np.sqrt(max(2 * (t * value - cumulant), 0.0)))
    if abs(r) < NEAR_MEAN:  # of Edgeworth's expansion
        third = 8 * float((count * w**3).sum())
        return 0.5 - third / (6 * np.sqrt(2 * np.pi) * curvature**1.5)
    v = t * np.sqrt(curvature)
    return float(np.clip(ndtr(-(r + np.log(v / r) / r)), 0.0, 1.0))


def _far(slope: Callable[[float], float], w: Float[np.ndarray, " n"]) -> float:
    """A t so far below zero that the slope is negative there."""
    t = 1 / w.max()
    while slope(-t) > 0:
        t *= 4
    return t


def gain_tail(gain: float, count: float, dof: float) -> float:
    """Probability of a greater gain by ``count`` constant errors.

    Noise levels are known to ``dof`` degrees of freedom.
    """
    if not np.isfinite(dof):
        return float(chi_square_tail(gain, count))
    left = max(dof - count, FEWEST)
    return fisher_tail(float(np.expm1(min(gain / dof, 500.0))) * left / count, count, left)
