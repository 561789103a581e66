"""Covariance of moments and axes to second order, for bodies that are known too vaguely for derivatives.

Moments relative to the largest end at those of a plate or a rod, log ratios and axes are bent where moments come near each
other: there the first order can be too small by a factor of ten. With y what is asked, at mean [+] (+-h sigma_i u_i) along the five
principal directions of the mass distribution's covariance, and h^2 = 3 as for a Gaussian (Norgaard, Poulsen, Ravn, Automatica 36,
2000),

    cov = sum_i a_i a_i' + b_i b_i' + m m',   a_i = (y_i+ - y_i-) / 2h,   b_i = (h^2 - 1)^(1/2) (y_i+ + y_i- - 2y) / 2h^2,
    m = sum_i (y_i+ + y_i- - 2y) / 2h^2,

about the published y rather than about the mean of the distribution, which is why m counts. Without curvature it is the first
order.
"""

from functools import cache
from itertools import product
from typing import Final

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import quaternion_from_matrix, rotation_vector_from_quaternion
from spinfilters.dynamics.mass_distribution import DIMENSION, inertia, retract_mass
from spinfilters.symbolic import Compiled

SQUARED_STEP: Final[float] = 3.0
"""h^2: the fourth moment of a Gaussian."""
WIDEST: Final[float] = 4.0
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
    directions, deviations, _ = np.linalg.svd(factor, full_matrices=False)
    steps = np.sqrt(SQUARED_STEP) * directions * np.minimum(deviations, WIDEST)[:, np.newaxis]
    offsets = np.concatenate(
        [np.zeros((len(s), 1, DIMENSION)), *(x * np.swapaxes(steps, 1, 2) for x in (1, -1))], 1
    )
    J = _moved_inertia()(np.repeat(s[:, np.newaxis], offsets.shape[1], 1), offsets)[0].reshape(
        len(s), -1, 3, 3
    )
    bodies = np.asarray(np.isfinite(J).all(axis=(1, 2, 3)))
    moments, vectors = np.linalg.eigh(np.where(bodies[:, np.newaxis, np.newaxis, np.newaxis], J, np.eye(3)))
    bodies &= (moments > 0).all(axis=(1, 2))
    moments[~bodies] = np.nan
    scaled = moments / moments[..., 2:]
    ratios = np.log(moments[..., [2, 1]] / moments[..., [1, 0]])
    return _covariance(scaled), _covariance(ratios), _covariance(_turns(axes, vectors))


def _covariance(y: Float[np.ndarray, "n p k"]) -> Float[np.ndarray, "n k k"]:
    """From y at the mean, at the points ahead and at those behind."""
    count = y.shape[1] // 2
    ahead, behind = y[:, 1 : 1 + count], y[:, 1 + count :]
    bent = (ahead + behind - 2 * y[:, :1]) / (2 * SQUARED_STEP)
    root = np.concatenate(
        [
            (ahead - behind) / (2 * np.sqrt(SQUARED_STEP)),
            np.sqrt(SQUARED_STEP - 1) * bent,
            bent.sum(axis=1, keepdims=True),
        ],
        axis=1,
    )
    return np.swapaxes(root, 1, 2) @ root


def _turns(
    axes: Float[np.ndarray, "n 3 3"], vectors: Float[np.ndarray, "n p 3 3"]
) -> Float[np.ndarray, "n p 3"]:
    """The shortest rotation vectors, in axes b, from the axes to eigenvectors of whatever signs."""
    vectors = vectors * np.sign(np.linalg.det(vectors))[..., np.newaxis, np.newaxis]
    turned = np.swapaxes(axes, 1, 2)[:, np.newaxis] @ vectors
    traces = np.einsum("npkk,jk->npj", turned, TURNS)
    chosen = TURNS[np.argmax(traces, axis=2)]
    return rotation_vector_from_quaternion(quaternion_from_matrix(turned * chosen[:, :, np.newaxis]))


@cache
def _moved_inertia() -> Compiled:
    """J (9 x 1) at s [+] d; interpreted, for it is called a few times in a run."""
    s, d = ca.SX.sym("s", DIMENSION), ca.SX.sym("d", DIMENSION)
    moved = ca.vec(inertia(retract_mass(s, d)))
    return Compiled.interpreted(ca.Function("moved_inertia", [s, d], [moved], ["s", "d"], ["J"]))
