"""Absolute orientation: the rigid motion between two sets of matched points."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.core.attitude_conversions import quaternion_from_matrix
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
    found = absolute_orientations(points_a[None], points_b[None], None if weights is None else weights[None])
    if not found.determined[0]:
        raise InputError("absolute orientation is undetermined: the matched points lie on one line")
    return quaternion_from_matrix(found.R[0]), found.t[0]


class AbsoluteOrientations(NamedTuple):
    """Rigid motions of h sets of points.

    Attributes
    ----------
    R : Float[np.ndarray, 'h 3 3']
        (h, 3, 3) R_ab.
    t : Float[np.ndarray, 'h 3']
        (h, 3) t_ab, m.
    determined : Bool[np.ndarray, ' h']
        (h,) whether the points determine them: those not on one line do.
    """

    R: Float[np.ndarray, "h 3 3"]
    t: Float[np.ndarray, "h 3"]
    determined: Bool[np.ndarray, " h"]

    @property
    def poses(self) -> Float[np.ndarray, "h 7"]:
        """Poses (t_ab, q_ab)."""
        return np.concatenate([self.t, quaternion_from_matrix(self.R)], axis=1)


def absolute_orientations(
    points_a: Float[np.ndarray, "h n 3"],
    points_b: Float[np.ndarray, "h n 3"],
    weights: Float[np.ndarray, "h n"] | None = None,
) -> AbsoluteOrientations:
    """Rigid motions between h sets of matched points at once.

    R_ab is the rotation nearest to M = sum w p_a p_b' of points about their means (Kabsch 1976). It is as exact near a line as the
    points themselves, where the eigenvectors of Horn's matrix (Tweddle 2013, Eqs 2.104-2.108) lose half of the digits. A point of
    weight zero has no say; the weights of a set must not all be zero.
    """
    w = np.ones(points_a.shape[:2]) if weights is None else weights
    w = (w / w.sum(axis=1, keepdims=True))[:, None]
    mean_a, mean_b = w @ points_a, w @ points_b
    M = (np.swapaxes(points_a - mean_a, 1, 2) * w) @ (points_b - mean_b)
    U, sizes, Vt = np.linalg.svd(M)
    R, sign = _nearest_of(U, Vt)
    # the curvature of the cost about the axis of the longest spread: zero for points on a line
    least = sizes[:, 1] + sign * sizes[:, 2]
    largest = np.maximum(sizes[:, 0], np.finfo(float).tiny)
    t = mean_a - mean_b @ np.swapaxes(R, 1, 2)
    return AbsoluteOrientations(R, t[:, 0], least > SINGULAR * largest)


def nearest_rotation(M: Float[np.ndarray, "*h 3 3"]) -> Float[np.ndarray, "*h 3 3"]:
    """The rotation nearest to a matrix, of one or of many: U V' of M = U S V', with determinant one (Wahba's problem)."""
    U, _, Vt = np.linalg.svd(M)
    return _nearest_of(U, Vt)[0]


def _nearest_of(
    U: Float[np.ndarray, "*h 3 3"], Vt: Float[np.ndarray, "*h 3 3"]
) -> tuple[Float[np.ndarray, "*h 3 3"], Float[np.ndarray, " *h"]]:
    """Rotation U diag(1, 1, sign) V' with the sign that makes its determinant one, and that sign."""
    sign = np.sign(np.linalg.det(U @ Vt))
    U[..., 2] *= sign[..., None]  # the direction of the least singular value, if any, is reversed
    return U @ Vt, sign


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
