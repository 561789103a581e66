"""First poses from matches of which many may be wrong: the rigid motion that most matches of a frame agree on.

A least-squares fit that is trimmed twice is tried first, for all frames at once. Where too few matches agree with it, motions of
random triples are tried (RANSAC, Fischler and Bolles 1981, with the cost of Torr and Zisserman 2000: squared pixels up to a bound),
and the best is fitted again to all that agree with it.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.attitude.conversions import matrix_from_quaternion, quaternion_from_matrix
from spinfilters.geometry.absolute_orientation import absolute_orientations, rigid_motions
from spinfilters.geometry.triangulation import triangulate
from spinfilters.perception.matches import MatchTable

AGREEMENT_PX = 20.0
"""Within which a match agrees with a rough pose: three triangulated points turn a body by some 0.1 rad, 10 px on its rim."""
SMALLEST_SHARE = 0.2
"""Of the matches that must agree with a pose: one in twenty does by chance."""
CLEAR_SHARE = 0.6
"""Of the matches: where so many agree with the trimmed fit, no other motion can have as many."""
TRIPLES = 200
"""Where half of the matches are right, one triple in eight is; of 200 some are spread well besides."""
TRIMS = 2
REFITS = 3
SEED = 0
"""Of the triples, so that the same matches give the same pose."""


@dataclass(frozen=True)
class _Seen:
    """Matches whose pixels tell a point before the camera.

    Attributes
    ----------
    usable: (f, k) which do; elsewhere all else is finite and means nothing.   camera: (f, k, 3) triangulated points, m.
    """

    usable: Bool[np.ndarray, "f k"]
    points: Float[np.ndarray, "f k 3"]
    pixels: Float[np.ndarray, "f k 3"]
    camera: Float[np.ndarray, "f k 3"]
    calibration: Float[np.ndarray, " 5"]

    @classmethod
    def of(cls, table: MatchTable, calibration: Float[np.ndarray, " 5"]) -> "_Seen":
        camera = triangulate(table.pixels, calibration)
        usable = table.given & np.isfinite(camera).all(axis=2) & (camera[..., 2] > 0)
        pixels, camera = (np.where(usable[..., None], array, 1.0) for array in (table.pixels, camera))
        return cls(usable, table.points, pixels, camera, calibration)

    @cached_property
    def weights(self) -> Float[np.ndarray, "f k"]:
        """They fall with depth, as its uncertainty grows."""
        return self.camera[..., 2] ** -4

    def share(self, chosen: Bool[np.ndarray, "f k"]) -> Float[np.ndarray, " f"]:
        """Of the usable matches."""
        return np.count_nonzero(chosen, axis=1) / np.maximum(np.count_nonzero(self.usable, axis=1), 1)

    def agreeing(self, poses: Float[np.ndarray, "f 7"]) -> Bool[np.ndarray, "f k"]:
        """Matches near the pixels that a pose tells."""
        R = matrix_from_quaternion(poses[:, 3:])
        squares = _squared_pixels(R, poses[:, :3], self.points, self.pixels, self.calibration)
        return self.usable & (squares < AGREEMENT_PX**2)

    def fitted(
        self, chosen: Bool[np.ndarray, "f k"]
    ) -> tuple[Float[np.ndarray, "f 7"], Bool[np.ndarray, " f"]]:
        """Absolute orientations of the chosen matches, and which they determine: four of them at least."""
        enough = np.count_nonzero(chosen, axis=1) >= 4
        weights = np.where(chosen | ~enough[:, None], self.weights, 0.0)
        q, t, determined = absolute_orientations(self.camera, self.points, weights)
        return np.concatenate([t, q], axis=1), enough & determined


def consensus_poses(
    table: MatchTable, calibration: Float[np.ndarray, " 5"]
) -> tuple[Float[np.ndarray, "f 7"], Bool[np.ndarray, " f"]]:
    """Rough poses (t, q_ig) of f frames, and where there is one: where matches enough agree at every turn."""
    seen = _Seen.of(table, calibration)
    poses, found = _trimmed(seen)
    unclear = found & (seen.share(seen.agreeing(poses)) < CLEAR_SHARE)
    for frame in np.flatnonzero(unclear).tolist():
        poses[frame] = _best_of_triples(seen, frame)
    fitted = np.zeros_like(seen.usable)
    for _ in range(REFITS):
        agreeing = seen.agreeing(poses) & found[:, None]
        found &= seen.share(agreeing) >= SMALLEST_SHARE
        if np.array_equal(agreeing, fitted):
            break
        fitted = agreeing
        poses, determined = seen.fitted(agreeing)
        found &= determined
    return poses, found


def _trimmed(seen: _Seen) -> tuple[Float[np.ndarray, "f 7"], Bool[np.ndarray, " f"]]:
    """Absolute orientations, repeated without what disagrees grossly."""
    keep = seen.usable
    poses, found = seen.fitted(keep)
    for _ in range(TRIMS):
        there = seen.points @ np.swapaxes(matrix_from_quaternion(poses[:, 3:]), 1, 2) + poses[:, None, :3]
        error = np.linalg.norm(seen.camera - there, axis=2)
        closer = keep & (error <= 4 * _medians(error, keep)[:, None] + 1e-12)
        if np.array_equal(closer, keep):
            break
        keep = closer
        poses, determined = seen.fitted(keep)
        found = found & determined
    return poses, found


def _medians(values: Float[np.ndarray, "f k"], chosen: Bool[np.ndarray, "f k"]) -> Float[np.ndarray, " f"]:
    """Of the chosen values of each row; infinite where none is."""
    ordered, counts = np.sort(np.where(chosen, values, np.inf), axis=1), np.count_nonzero(chosen, axis=1)
    middle = np.stack([np.maximum(counts - 1, 0) // 2, np.minimum(counts // 2, values.shape[1] - 1)], axis=1)
    return np.take_along_axis(ordered, middle, axis=1).mean(axis=1)


def _best_of_triples(seen: _Seen, frame: int) -> Float[np.ndarray, " 7"]:
    usable = seen.usable[frame]
    points, pixels, camera = (array[frame][usable] for array in (seen.points, seen.pixels, seen.camera))
    generator = np.random.default_rng(SEED)
    chosen = generator.random((TRIPLES, len(points))).argpartition(2, axis=1)[:, :3]
    rotations, shifts = rigid_motions(camera[chosen], points[chosen])
    squares = _squared_pixels(rotations, shifts, points, pixels, seen.calibration)
    best = int(np.argmin(np.minimum(squares, AGREEMENT_PX**2).sum(axis=1)))
    return np.concatenate([shifts[best], quaternion_from_matrix(rotations[best])])


def _squared_pixels(
    rotations: Float[np.ndarray, "h 3 3"],
    shifts: Float[np.ndarray, "h 3"],
    points: Float[np.ndarray, "*h k 3"],
    pixels: Float[np.ndarray, "*h k 3"],
    calibration: Float[np.ndarray, " 5"],
) -> Float[np.ndarray, "h k"]:
    """Squared distance (u_left, v_left, u_right) of each match under each motion, infinite behind the camera."""
    fx, fy, cx, cy, baseline = calibration
    at = points @ np.swapaxes(rotations, 1, 2) + shifts[:, None]
    x, y, z = at[..., 0], at[..., 1], at[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = fx * x / z + cx - pixels[..., 0], fy * y / z + cy - pixels[..., 1]
        right = u + pixels[..., 0] - fx * baseline / z - pixels[..., 2]
        return np.where(z > 0, u**2 + v**2 + right**2, np.inf)
