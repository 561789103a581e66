"""Intervals of moments and log ratios within four standard deviations of a mass distribution.

A standard deviation tells how wide a Gaussian is. Where the mass distribution has one, moments have none: the ratio of two nearly
equal moments is a root of a sum of squares, with the tails of a chi-square, and an error of three deviations of the mass
distribution was one of five of the ratio. So the ends of

    { y(s [+] F u): |u| <= R },   y = ln (J_min / J_max), ln (J_mid / J_max), ln (J_min / J_mid),

are sought, the profile likelihood's interval of y at R deviations. At an end u is parallel to the gradient of y by u: u is moved
along it on the sphere as long as y goes on. With D the error of S and w_k = V' L' a_k for an eigenvector a_k of S = L exp(D) L',
D = V diag(l) V', the second moments p_k have

    d p_k / dD = V (Phi o w_k w_k') V',   Phi_ij = (exp l_i - exp l_j) / (l_i - l_j).
"""

from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.dynamics.mass_distribution import DIMENSION

REACH: Final[float] = 4.0
"""Standard deviations of the mass distribution at which the interval ends: those that ``ok`` speaks of."""
STEPS: Final[int] = 4
"""Of a search along the gradient."""
FRACTIONS: Final = np.array([0.25, 0.5, 0.75])
"""Of a direction that are looked at, too: a ratio that is bounded by one is nearest to it inside."""
PAIRS: Final = np.array([[0, 2], [1, 2], [0, 1]])
"""Moments (ascending) of the log ratios y: numerator and denominator."""
SIGNS, SOUGHT = np.repeat([1.0, -1.0], 3), np.tile(np.arange(3), 2)
"""Of the six searches: largest (1) or smallest (-1), and of which y."""
LARGEST_LOG: Final = 30.0
"""Of the numbers of a mass distribution, beyond which second moments differ by more than numbers resolve."""
DIRECTIONS: Final = np.concatenate([np.eye(DIMENSION), -np.eye(DIMENSION)])
"""That searches begin from, of the one that lies farthest out."""


def widest_departures(
    s: Float[np.ndarray, "n 5"], steps: Float[np.ndarray, "n 5 5"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 2"]]:
    """Largest departures within `REACH` deviations over `REACH`, of moments (largest = 1) and log ratios k1, k2.

    Parameters
    ----------
    s: mass distributions.   steps: F of their errors, principal directions by column, of moderate length.

    Returns
    -------
    Not a number where s is beyond `LARGEST_LOG`, a body only to rounding.
    """
    absurd = ~(np.abs(s).max(axis=1) < LARGEST_LOG)
    L = _lower_factors(np.where(absurd[:, np.newaxis], 0.0, s))
    lowest, highest = _intervals(L, steps)
    y = _log_ratios(L, steps, np.zeros((len(s), 1, DIMENSION)))[0][:, 0]
    y[absurd] = np.nan
    ratios = np.maximum(highest - y, y - lowest)
    moments = np.maximum(np.exp(highest) - np.exp(y), np.exp(y) - np.exp(lowest))
    moments[:, 2] = 0.0
    return moments / REACH, ratios[:, 1:] / REACH


def _intervals(
    L: Float[np.ndarray, "n 3 3"], steps: Float[np.ndarray, "n 5 5"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """The smallest and the largest of each log ratio y within `REACH` deviations."""
    points = np.broadcast_to(REACH * DIRECTIONS, (len(L), *DIRECTIONS.shape))
    y, _ = _log_ratios(L, steps, points)
    u = DIRECTIONS[np.concatenate([y.argmax(axis=1), y.argmin(axis=1)], axis=1)]
    u = _farthest(L, steps, REACH * u)
    inside = (FRACTIONS[:, np.newaxis, np.newaxis] * u[:, np.newaxis]).reshape(len(L), -1, DIMENSION)
    found = _log_ratios(L, steps, np.concatenate([u, inside], axis=1))[0]
    return found.min(axis=1), found.max(axis=1)


def _farthest(
    L: Float[np.ndarray, "n 3 3"], steps: Float[np.ndarray, "n 5 5"], u: Float[np.ndarray, "n 6 5"]
) -> Float[np.ndarray, "n 6 5"]:
    """Points on the sphere where each search ends."""
    (value, slope), share = _along(L, steps, u), np.ones((len(L), 6, 1))
    for _ in range(STEPS):
        moved = u + share * REACH * slope
        moved *= REACH / np.maximum(np.linalg.norm(moved, axis=2, keepdims=True), np.finfo(float).tiny)
        reached, steeper = _along(L, steps, moved)
        better = (reached > value)[..., np.newaxis]
        u, slope = np.where(better, moved, u), np.where(better, steeper, slope)
        value, share = np.maximum(value, reached), np.where(better, share, share / 3)
    return u


def _along(
    L: Float[np.ndarray, "n 3 3"], steps: Float[np.ndarray, "n 5 5"], u: Float[np.ndarray, "n 6 5"]
) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 5"]]:
    """What each search wants large, and the direction in which it grows."""
    y, slope = _log_ratios(L, steps, u)
    own = np.arange(6)
    slope = SIGNS[:, np.newaxis] * slope[:, own, SOUGHT]
    length = np.linalg.norm(slope, axis=2, keepdims=True)
    return SIGNS * y[:, own, SOUGHT], slope / np.where(length > 0, length, 1.0)


def _log_ratios(
    L: Float[np.ndarray, "n 3 3"], steps: Float[np.ndarray, "n 5 5"], u: Float[np.ndarray, "n p 5"]
) -> tuple[Float[np.ndarray, "n p 3"], Float[np.ndarray, "n p 3 5"]]:
    """y and its gradient by u."""
    values, V = np.linalg.eigh(_symmetric(u @ np.swapaxes(steps, 1, 2)))
    B = L[:, np.newaxis] @ V
    A = B * np.exp(values / 2)[..., np.newaxis, :]
    p, vectors = np.linalg.eigh(A @ np.swapaxes(A, -1, -2))
    p = np.maximum(p, np.finfo(float).eps * p[..., 2:])
    w = np.swapaxes(vectors, -1, -2) @ B
    half = (values[..., :, np.newaxis] - values[..., np.newaxis, :]) / 2
    quotient = np.where(half == 0, 1.0, np.sinh(half) / np.where(half == 0, 1.0, half))
    phi = (quotient * np.exp(half + values[..., np.newaxis, :]))[..., np.newaxis, :, :]
    V = V[..., np.newaxis, :, :]
    G = V @ (phi * w[..., :, np.newaxis] * w[..., np.newaxis, :]) @ np.swapaxes(V, -1, -2)
    slopes = _by_components(G) @ steps[:, np.newaxis]
    moments = (p.sum(axis=-1, keepdims=True) - p)[..., ::-1]
    relative = (slopes.sum(axis=-2, keepdims=True) - slopes)[..., ::-1, :] / moments[..., np.newaxis]
    logs, upper, lower = np.log(moments), PAIRS[:, 0], PAIRS[:, 1]
    return logs[..., upper] - logs[..., lower], relative[..., upper, :] - relative[..., lower, :]


def _lower_factors(s: Float[np.ndarray, "n 5"]) -> Float[np.ndarray, "n 3 3"]:
    """L(s) (`spinfilters.dynamics.mass_distribution`)."""
    L = np.zeros((len(s), 3, 3))
    L[:, [0, 1, 2], [0, 1, 2]] = np.exp(np.stack([s[:, 0], s[:, 1], -s[:, 0] - s[:, 1]], axis=1))
    L[:, [1, 2, 2], [0, 0, 1]] = s[:, 2:]
    return L


def _symmetric(d: Float[np.ndarray, "n p 5"]) -> Float[np.ndarray, "n p 3 3"]:
    """D of its components."""
    D = np.stack([d[..., [0, 2, 3]], d[..., [2, 1, 4]], d[..., [3, 4, 0]]], axis=-2)
    D[..., 2, 2] = -d[..., 0] - d[..., 1]
    return D


def _by_components(G: Float[np.ndarray, "*n 3 3"]) -> Float[np.ndarray, "*n 5"]:
    """The derivative by the components of D of what has the derivative G by D."""
    first, second = G[..., 0, 0] - G[..., 2, 2], G[..., 1, 1] - G[..., 2, 2]
    return np.stack([first, second, 2 * G[..., 1, 0], 2 * G[..., 2, 0], 2 * G[..., 2, 1]], axis=-1)
