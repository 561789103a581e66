"""Covariance of moments, log ratios and axes by cubature.

Over the Gaussian of the mass distribution.
Derivatives are not enough even for bodies known to a few per cent: a motion determines one combination of the moments far better
than the other, and in that thin direction the curvature of the eigenvalues is larger than the first order. With y what is asked,
at mean [+] (the points), M the mean of (y - y0)(y - y0)' about the published y0 is what an error of y0 is compared with: the bias
of the eigenvalues counts in it. The rule (Stroud 1971, E_n^r2 5-3) has positive weights and is exact to the fifth degree, so that
M is exact for what is quadratic in the error:

    2n points at +-r e_i,  r^2 = (n + 2) / 2,  weight 4 / (n + 2)^2;
    2^n points at s (+-1, ..., +-1),  s^2 = (n + 2) / (n - 2),  weight ((n - 2) / (n + 2))^2 / 2^n.
"""

from functools import cache
from itertools import product
from typing import Final

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import quaternion_from_matrix, rotation_vector_from_quaternion
from spinfilters.dynamics.mass_distribution import DIMENSION, inertia, retract_mass
from spinfilters.symbolic.compiled import Compiled
from spinfilters.symbolic.working_time import building

WIDEST: Final[float] = 2.0
"""Of a deviation of the mass distribution (log second moments): beyond it are plates and rods alone, and overflow."""
TURNS: Final = np.array([[x, y, x * y] for x, y in product((1.0, -1.0), repeat=2)])
"""Signs of right-handed axes."""
Spread = tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 2 2"], Float[np.ndarray, "n 3 3"]]
"""Covariances of the moments (largest = 1), of their log ratios k1, k2, and of the rotation of the axes about themselves."""


def body_spread(
    s: Float[np.ndarray, "n 5"], factor: Float[np.ndarray, "n 5 e"], axes: Float[np.ndarray, "n 3 3"]
) -> Spread:
    """The covariances about mass distributions s, whose error has the covariance factor factor'; axes are columns.

    Not a number where a body at such a deviation is none to rounding.
    """
    steps = principal_steps(factor)
    points, weights = _cubature()
    offsets = np.einsum("pe,nke->npk", points, steps)
    J = _moved_inertia()(np.repeat(s[:, np.newaxis], offsets.shape[1], 1), offsets)[0].reshape(
        len(s), -1, 3, 3
    )
    bodies = np.asarray(np.isfinite(J).all(axis=(1, 2, 3)))
    moments, vectors = np.linalg.eigh(np.where(bodies[:, np.newaxis, np.newaxis, np.newaxis], J, np.eye(3)))
    bodies &= (moments > 0).all(axis=(1, 2))
    moments[~bodies] = np.nan
    scaled = moments / moments[..., 2:]
    ratios = np.log(moments[..., [2, 1]] / moments[..., [1, 0]])
    turns = axis_turns(axes, vectors)
    return _covariance(scaled, weights), _covariance(ratios, weights), _covariance(turns, weights)


def principal_steps(
    factor: Float[np.ndarray, "n 5 e"], sphere: Float[np.ndarray, "n 5"] | float = 0.0
) -> Float[np.ndarray, "n 5 5"]:
    """Principal directions of a covariance as columns, of the length of their deviations up to `WIDEST`.

    Parameters
    ----------
    sphere: errors that lead there; lengths are up to half of that, too, so that a needle may be anything else.
    """
    directions, deviations, _ = np.linalg.svd(factor, full_matrices=False)
    widest = np.maximum(np.linalg.norm(np.atleast_2d(sphere), axis=1) / 2, WIDEST)
    return directions * np.minimum(deviations, widest[:, np.newaxis])[:, np.newaxis]


def _covariance(
    y: Float[np.ndarray, "n p k"], weights: Float[np.ndarray, " p"]
) -> Float[np.ndarray, "n k k"]:
    """Second moments about y at the mean, which comes first."""
    root = np.sqrt(weights)[:, np.newaxis] * (y - y[:, :1])
    return np.swapaxes(root, 1, 2) @ root


@cache
def _cubature() -> tuple[Float[np.ndarray, "p 5"], Float[np.ndarray, " p"]]:
    """Points of a standard normal distribution, the mean first, and their weights."""
    n = DIMENSION
    axes, corners = np.sqrt((n + 2) / 2) * np.eye(n), np.array(list(product((1.0, -1.0), repeat=n)))
    points = np.concatenate([np.zeros((1, n)), axes, -axes, np.sqrt((n + 2) / (n - 2)) * corners])
    corner = ((n - 2) / (n + 2)) ** 2 / len(corners)
    return points, np.concatenate([[0.0], np.full(2 * n, 4 / (n + 2) ** 2), np.full(len(corners), corner)])


def axis_turns(
    axes: Float[np.ndarray, "n 3 3"], vectors: Float[np.ndarray, "n p 3 3"]
) -> Float[np.ndarray, "n p 3"]:
    """The shortest rotation vectors, in axes b, from the axes to eigenvectors of whatever signs."""
    vectors = vectors * np.sign(np.linalg.det(vectors))[..., np.newaxis, np.newaxis]
    turned = np.swapaxes(axes, 1, 2)[:, np.newaxis] @ vectors
    traces = np.einsum("npkk,jk->npj", turned, TURNS)
    chosen = TURNS[np.argmax(traces, axis=2)]
    return rotation_vector_from_quaternion(quaternion_from_matrix(turned * chosen[:, :, np.newaxis]))


@cache
@building()
def _moved_inertia() -> Compiled:
    """J (9 x 1) at s [+] d.

    Interpreted, for it is called a few times in a run.
    """
    s, d = ca.SX.sym("s", DIMENSION), ca.SX.sym("d", DIMENSION)
    moved = ca.vec(inertia(retract_mass(s, d)))
    return Compiled.interpreted(ca.Function("moved_inertia", [s, d], [moved], ["s", "d"], ["J"]))
