"""Landmarks taken out of a least-squares problem, and put back behind its solution.

A landmark's information V = L L' is its own 3 x 3 block, whatever other landmarks there are, so it is eliminated in closed form:
with W its coupling to the poses and Y = L^-1 W', the poses keep H - Y'Y, and p = L^-T (y - Y e) + L^-T n follows their error e.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.estimators.smoothing.memory import lent, lent_zeros
from spinfilters.estimators.smoothing.native import kernels
from spinfilters.estimators.smoothing.sightings import SIGHTINGS_NEEDED, LinearSightings, Sightings
from spinfilters.symbolic.compiled import address

POSE = 6
"""Errors of a pose."""
WIDE = 8
"""Row of a pose's block in memory: one vector of the machine."""
FLATTEST = 1e-12
"""Determinant of a landmark's scaled information below which its depth is not told."""


@dataclass(frozen=True)
class Eliminated:
    """Landmarks that are told by what is believed, and what they leave to the poses.

    Attributes
    ----------
    weight: (N,) of each sighting.   told: (L,) which of the sightings' landmarks.   used: (N,) sightings that count: those of a
    told landmark with a weight.
    root: (L, 3, 3) lower triangular L.   gradient: (L, 3) y.   coupling: (N, 3, 6) Y of each sighting; that of the first of a
    landmark's sightings in a frame holds them all.
    information: (r + 1, r) what is left to the poses, in the lower triangle, and an empty row.   pose_gradient: (r,).
    """

    sightings: Sightings
    weight: Float[np.ndarray, " N"]
    told: Bool[np.ndarray, " L"]
    used: Bool[np.ndarray, " N"]
    root: Float[np.ndarray, "L 3 3"]
    gradient: Float[np.ndarray, "L 3"]
    coupling: Float[np.ndarray, "N 3 6"]
    information: Float[np.ndarray, "w r"]
    pose_gradient: Float[np.ndarray, " r"]

    def points_step(self, poses: Float[np.ndarray, "k 6"]) -> Float[np.ndarray, "L 3"]:
        """How the landmarks follow a step of the poses; zero for one that is not told."""
        s, library = self.sightings, kernels()
        if library is None:
            return self._points_step(poses)
        step, poses = np.empty((s.landmarks, 3)), np.ascontiguousarray(poses)
        library.follow_poses(
            s.landmarks,
            *map(
                address, (s.start, s.frame, self.told, self.root, self.gradient, self.coupling, poses, step)
            ),
        )
        return step

    def _points_step(self, poses: Float[np.ndarray, "k 6"]) -> Float[np.ndarray, "L 3"]:
        rest = self.gradient.copy()
        np.subtract.at(
            rest,
            self.sightings.landmark,
            np.einsum("nab,nb->na", self.coupling, poses[self.sightings.frame]),
        )
        step = np.zeros_like(rest)
        step[self.told] = _solved(np.swapaxes(self.root[self.told], 1, 2), rest[self.told])
        return step


def eliminate(
    sightings: Sightings, linear: LinearSightings, weight: Float[np.ndarray, " N"], kept: int, frames: int
) -> Eliminated:
    """Take the landmarks out of weighted sightings; sightings of landmarks that are then not told do not count.

    Parameters
    ----------
    kept: number of unknowns that remain, poses first.
    """
    library = kernels()
    if library is None:
        return eliminate_in_numpy(sightings, linear, weight, kept, frames)
    L, N = sightings.landmarks, len(sightings)
    told, root, gradient = np.empty(L, dtype=bool), np.empty((L, 3, 3)), np.empty((L, 3))
    coupling, slope = np.empty((N, 3, POSE)), np.zeros(kept)
    blocks, information = lent(frames * (frames + 1) // 2 * POSE * WIDE), lent_zeros(kept + 1, kept)
    weight, rows = np.ascontiguousarray(weight), np.ascontiguousarray(linear.rows)
    failed = library.eliminate_landmarks(
        L,
        frames,
        *map(address, (sightings.start, sightings.frame, rows, weight)),
        FLATTEST,
        *map(address, (told, root, gradient, coupling, blocks, slope)),
    )
    if failed:
        raise MemoryError("no memory to eliminate the landmarks")
    library.spread_blocks(frames, kept, address(blocks), address(information))
    used = (weight > 0) & told[sightings.landmark]
    return Eliminated(sightings, weight, told, used, root, gradient, coupling, information, slope)


def eliminate_in_numpy(
    sightings: Sightings, linear: LinearSightings, weight: Float[np.ndarray, " N"], kept: int, frames: int
) -> Eliminated:
    """`eliminate` for machines without a compiler."""
    landmark, frame, L = sightings.landmark, sightings.frame, sightings.landmarks
    told, used, root = _told(sightings, linear, weight)
    scaled = np.sqrt(np.where(used, weight, 0.0))[:, None, None] * np.where(
        used[:, None, None], linear.rows, 0.0
    )
    by_pose, by_point, y = scaled[:, :, :POSE], scaled[:, :, POSE:-1], scaled[:, :, -1:]
    gradient, whole = np.zeros((L, 3)), np.zeros((L, 3, frames, POSE))
    turned = by_point.swapaxes(1, 2)
    np.add.at(gradient, landmark, (turned @ y)[..., 0])
    gradient = _solved(root, gradient)
    np.add.at(whole, (landmark, slice(None), frame), np.linalg.solve(root[landmark], turned @ by_pose))  # pyright: ignore[reportArgumentType]
    blocks, slopes = np.zeros((frames, POSE, POSE)), np.zeros((frames, POSE))
    np.add.at(blocks, frame, by_pose.swapaxes(1, 2) @ by_pose)
    np.add.at(slopes, frame, (by_pose.swapaxes(1, 2) @ y)[..., 0])
    Y, size = whole.reshape(3 * L, frames * POSE), frames * POSE
    information, slope = np.zeros((kept + 1, kept)), np.zeros(kept)
    information[:size, :size] = -np.tril(Y.T @ Y)
    for k in range(frames):
        at = slice(k * POSE, (k + 1) * POSE)
        information[at, at] += blocks[k]
    slope[:size] = slopes.reshape(-1) - Y.T @ gradient.reshape(-1)
    coupling = whole.swapaxes(1, 2)[landmark, frame] * _firsts(sightings, used)[:, None, None]
    return Eliminated(sightings, weight, told, used, root, gradient, coupling, np.tril(information), slope)


def _told(
    sightings: Sightings, linear: LinearSightings, weight: Float[np.ndarray, " N"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Landmarks that can be eliminated, sightings that count, and the roots of the landmarks' information (I where not told)."""
    L, landmark = sightings.landmarks, sightings.landmark
    by_point = np.where((weight > 0)[:, None, None], linear.rows[:, :, POSE:-1], 0.0)
    information = np.zeros((L, 3, 3))
    np.add.at(information, landmark, weight[:, None, None] * by_point.swapaxes(1, 2) @ by_point)
    hits = np.bincount(landmark[weight > 0], minlength=L)
    diagonal = np.einsum("kii->ki", information)
    with np.errstate(invalid="ignore", divide="ignore"):
        shape = np.linalg.det(information) / diagonal.prod(axis=1)
    told = (hits >= SIGHTINGS_NEEDED) & (shape > FLATTEST)
    root = np.tile(np.eye(3), (L, 1, 1))
    root[told] = np.linalg.cholesky(information[told])
    return told, (weight > 0) & told[landmark], root


def _firsts(sightings: Sightings, used: Bool[np.ndarray, " N"]) -> Bool[np.ndarray, " N"]:
    """The first used sighting of each landmark in each frame."""
    rows = np.flatnonzero(used)
    place = sightings.landmark[rows] * (int(sightings.frame.max(initial=0)) + 1) + sightings.frame[rows]
    result = np.zeros(len(used), dtype=bool)
    result[rows[np.flatnonzero(np.diff(place, prepend=-1))]] = True
    return result


def _solved(root: Float[np.ndarray, "k 3 3"], right: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
    return np.linalg.solve(root, right[..., None])[..., 0]
