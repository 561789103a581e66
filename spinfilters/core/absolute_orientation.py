"""Absolute orientation: the rigid motion between two sets of matched points."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.errors import InputError
from spinfilters.core.linear_algebra import SINGULAR, STRETCH


def absolute_orientation(
    points_a: Float[np.ndarray, "n 3"],
    points_b: Float[np.ndarray, "n 3"],
    weights: Float[np.ndarray, " n"] | None = None,
) -> tuple[Float[np.ndarray, " 4"], Float[np.ndarray, " 3"]]:
    """Least-squares rigid motion (q_ab, t_ab) between two weighted sets of matched points.

    Minimises the weighted sum of |p_a - R_ab p_b - t_ab|^2 with scale one; `absolute_orientations` solves many sets at once.

    Raises
    ------
    InputError
        With fewer than three points, or points on one line, which leave a rotation undetermined.
    """
    if len(points_a) < 3:
        raise InputError(f"absolute orientation needs at least 3 matched points, got {len(points_a)}")
    w = np.ones(len(points_a)) if weights is None else weights
    q, t, determined = absolute_orientations(points_a[None], points_b[None], w[None])
    if not determined[0]:
        raise InputError("absolute orientation is undetermined: the matched points lie on one line")
    return q[0], t[0]


class AbsoluteOrientations(NamedTuple):
    """Rigid motions of h sets of points.

    Attributes
    ----------
    q : Float[np.ndarray, 'h 4']
        (h, 4) q_ab.
    t : Float[np.ndarray, 'h 3']
        (h, 3) t_ab, m.
    determined : Bool[np.ndarray, ' h']
        (h,) whether the points determine them: those not on one line do.
    """

    q: Float[np.ndarray, "h 4"]
    t: Float[np.ndarray, "h 3"]
    determined: Bool[np.ndarray, " h"]


def absolute_orientations(
    points_a: Float[np.ndarray, "h n 3"],
    points_b: Float[np.ndarray, "h n 3"],
    weights: Float[np.ndarray, "h n"],
) -> AbsoluteOrientations:
    """Rigid motions between h sets of matched points at once.

    Horn's closed form: the quaternion is the eigenvector of the largest eigenvalue of N (Tweddle 2013, Eqs 2.104-2.108, with the
    means of 2.104-2.105 corrected; Horn 1987). A point of weight zero has no say; the weights of a set must not all be zero.
    """
    w = (weights / weights.sum(axis=1, keepdims=True))[:, None]
    mean_a, mean_b = w @ points_a, w @ points_b
    M = np.swapaxes(points_b - mean_b, 1, 2) @ (np.swapaxes(w, 1, 2) * (points_a - mean_a))
    values, vectors = np.linalg.eigh(_horn_matrices(M))
    largest = np.maximum(np.abs(values[:, 3]), np.finfo(float).tiny)
    q = vectors[:, [1, 2, 3, 0], 3] * np.where(vectors[:, :1, 3] >= 0, 1.0, -1.0)
    t = mean_a - mean_b @ np.swapaxes(matrix_from_quaternion(q), 1, 2)
    return AbsoluteOrientations(q, t[:, 0], values[:, 3] - values[:, 2] > SINGULAR * largest)


def rigid_motions(
    points_a: Float[np.ndarray, "h n 3"], points_b: Float[np.ndarray, "h n 3"]
) -> tuple[Float[np.ndarray, "h 3 3"], Float[np.ndarray, "h 3"]]:
    """Rigid motions (R_ab, t_ab) between h sets of matched points, all weights equal.

    R_ab is the rotation nearest to sum p_a p_b' (Kabsch 1976).
    """
    mean_a, mean_b = points_a.mean(axis=1), points_b.mean(axis=1)
    M = np.swapaxes(points_a - mean_a[:, None], 1, 2) @ (points_b - mean_b[:, None])
    R = nearest_rotation(M)
    return R, mean_a - (R @ mean_b[..., None])[..., 0]


def nearest_rotation(M: Float[np.ndarray, "*h 3 3"]) -> Float[np.ndarray, "*h 3 3"]:
    """The rotation nearest to a matrix, of one or of many: U V' of M = U S V', with determinant one (Wahba's problem)."""
    U, _, Vt = np.linalg.svd(M)
    U[..., 2] *= np.sign(np.linalg.det(U @ Vt))[
        ..., None
    ]  # the direction of the least singular value, if any, is reversed
    return U @ Vt


def mean_quaternion(
    q: Float[np.ndarray, "n 4"], weights: Float[np.ndarray, " n"] | None = None
) -> Float[np.ndarray, " 4"]:
    """Rotation nearest to n weighted ones, with a scalar part that is not negative; the quaternions' signs do not matter.

    The main eigenvector of the weighted sum of their outer products (Markley et al., J. Guidance, Control, and Dynamics 30(4),
    2007), which is the rotation nearest to the sum of the matrices.
    """
    products = np.zeros((4, 4))
    for start in range(0, len(q), STRETCH):
        part = q[start : start + STRETCH]
        products += (part if weights is None else part * weights[start : start + STRETCH, None]).T @ part
    mean = np.linalg.eigh(products)[1][:, -1]
    return mean * (-1.0 if mean[3] < 0 else 1.0)


def _horn_matrices(S: Float[np.ndarray, "h 3 3"]) -> Float[np.ndarray, "h 4 4"]:
    """N of Horn's method, scalar first, for S = sum p_b p_a'."""
    trace = np.trace(S, axis1=1, axis2=2)
    N = np.empty((len(S), 4, 4))
    N[:, 0, 0] = trace
    delta = (S[:, 1, 2] - S[:, 2, 1], S[:, 2, 0] - S[:, 0, 2], S[:, 0, 1] - S[:, 1, 0])
    N[:, 0, 1:] = N[:, 1:, 0] = np.stack(delta, axis=1)
    N[:, 1:, 1:] = S + np.swapaxes(S, 1, 2) - trace[:, None, None] * np.eye(3)
    return N
