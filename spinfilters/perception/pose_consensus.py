"""A first pose from matches of which many may be wrong: the rigid motion that most of them agree on.

A least-squares fit that is trimmed twice is tried first. Where too few matches agree with it, motions of random triples are
tried (RANSAC, Fischler and Bolles 1981, with the cost of Torr and Zisserman 2000: squared pixels up to a bound), and the best is
fitted again to all that agree with it.
"""

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.attitude.conversions import matrix_from_quaternion, quaternion_from_matrix
from spinfilters.errors import InputError
from spinfilters.geometry.absolute_orientation import absolute_orientation, rigid_motions
from spinfilters.geometry.triangulation import triangulate

AGREEMENT_PX = 20.0
"""Within which a match agrees with a rough pose: three triangulated points turn a body by some 0.1 rad, 10 px on its rim."""
SMALLEST_SHARE = 0.2
"""Of the matches that must agree with a pose: one in twenty does by chance."""
CLEAR_SHARE = 0.6
"""Of the matches: where so many agree with the trimmed fit, no other motion can have as many."""
TRIPLES = 200
"""Where half of the matches are right, one triple in eight is; of 200 some are spread well besides."""
REFITS = 3
SEED = 0
"""Of the triples, so that the same matches give the same pose."""


def consensus_pose(
    points: Float[np.ndarray, "k 3"], pixels: Float[np.ndarray, "k 3"], calibration: Float[np.ndarray, " 5"]
) -> Float[np.ndarray, " 7"] | None:
    """Rough pose (t, q_ig) of map points (frame g, m) seen at rectified pixels; None where too few ever agree."""
    seen = triangulate(pixels, calibration)
    usable = np.isfinite(seen).all(axis=1) & (seen[:, 2] > 0)
    points, pixels, seen = points[usable], pixels[usable], seen[usable]
    pose = _trimmed(points, seen)
    if pose is None:
        return None
    if _agreeing(pose, points, pixels, calibration).mean() < CLEAR_SHARE:
        pose = _best_of_triples(points, seen, pixels, calibration)
    fitted = np.zeros(len(points), dtype=bool)
    for _ in range(REFITS):
        agreeing = _agreeing(pose, points, pixels, calibration)
        if agreeing.mean() < SMALLEST_SHARE:
            return None
        if np.array_equal(agreeing, fitted):
            break
        fitted = agreeing
        again = _fitted(points[agreeing], seen[agreeing])
        if again is None:
            return None
        pose = again
    return pose


def _trimmed(points: Float[np.ndarray, "k 3"], seen: Float[np.ndarray, "k 3"]) -> np.ndarray | None:
    """Absolute orientation, repeated twice without what disagrees grossly."""
    keep, pose = np.ones(len(points), dtype=bool), None
    for _ in range(3):
        pose = _fitted(points[keep], seen[keep])
        if pose is None:
            return None
        error = np.linalg.norm(seen - points @ matrix_from_quaternion(pose[3:]).T - pose[:3], axis=1)
        closer = keep & (error <= 4 * np.median(error[keep]) + 1e-12)
        if np.array_equal(closer, keep):
            break
        keep = closer
    return pose


def _fitted(points: Float[np.ndarray, "k 3"], seen: Float[np.ndarray, "k 3"]) -> np.ndarray | None:
    """Absolute orientation with weights that fall with depth, as its uncertainty grows; None for fewer than four points."""
    if len(points) < 4:
        return None
    try:
        q, t = absolute_orientation(seen, points, seen[:, 2] ** -4)
    except InputError:
        return None
    return np.concatenate([t, q])


def _agreeing(
    pose: Float[np.ndarray, " 7"], points: np.ndarray, pixels: np.ndarray, calibration: np.ndarray
) -> Bool[np.ndarray, " k"]:
    R = matrix_from_quaternion(pose[3:])[None]
    return _squared_pixels(R, pose[None, :3], points, pixels, calibration)[0] < AGREEMENT_PX**2


def _best_of_triples(
    points: np.ndarray, seen: np.ndarray, pixels: np.ndarray, calibration: np.ndarray
) -> Float[np.ndarray, " 7"]:
    generator = np.random.default_rng(SEED)
    chosen = generator.random((TRIPLES, len(points))).argpartition(2, axis=1)[:, :3]
    rotations, shifts = rigid_motions(seen[chosen], points[chosen])
    cost = np.minimum(_squared_pixels(rotations, shifts, points, pixels, calibration), AGREEMENT_PX**2).sum(
        axis=1
    )
    best = int(np.argmin(cost))
    return np.concatenate([shifts[best], quaternion_from_matrix(rotations[best])])


def _squared_pixels(
    rotations: Float[np.ndarray, "h 3 3"],
    shifts: Float[np.ndarray, "h 3"],
    points: Float[np.ndarray, "k 3"],
    pixels: Float[np.ndarray, "k 3"],
    calibration: Float[np.ndarray, " 5"],
) -> Float[np.ndarray, "h k"]:
    """Squared distance (u_left, v_left, u_right) of each match under each motion, infinite behind the camera."""
    fx, fy, cx, cy, baseline = calibration
    at = points @ np.swapaxes(rotations, 1, 2) + shifts[:, None]
    x, y, z = at[..., 0], at[..., 1], at[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = fx * x / z + cx - pixels[:, 0], fy * y / z + cy - pixels[:, 1]
        right = u + pixels[:, 0] - fx * baseline / z - pixels[:, 2]
        return np.where(z > 0, u**2 + v**2 + right**2, np.inf)
