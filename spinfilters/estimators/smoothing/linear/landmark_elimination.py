"""Landmark elimination by Schur complement, and back-substitution.

A landmark's information V = L L' is its own 3 x 3 block, whatever other landmarks there are, so it is eliminated in closed form:
with W its coupling to the poses and Y = L^-1 W', the poses keep H - Y'Y, and p = L^-T (y - Y e) + L^-T n follows their error e.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.estimators.smoothing.factors.landmark_observations import (
    OBSERVATIONS_NEEDED,
    LandmarkObservations,
    LinearObservations,
)
from spinfilters.estimators.smoothing.kernels.compiled_kernels import kernels
from spinfilters.estimators.smoothing.linear.buffer_pool import pooled_array, pooled_zeros
from spinfilters.symbolic.compiled import address

POSE = 6
"""Errors of a pose."""
WIDE = 8
"""Row of a pose's block in memory: one vector of the machine."""
FLATTEST = 1e-12
"""Determinant of a landmark's scaled information below which its depth is not told."""


@dataclass(frozen=True)
class Eliminated:
    """Eliminated well-constrained landmarks, and their Schur complement on the poses.

    Attributes
    ----------
    weight: (N,) of each observation.   is_constrained: (L,) which of the observations' landmarks.   used: (N,) observations
        that count: those of a
    told landmark with a weight.
    information_sqrt: (L, 3, 3) lower triangular L.   gradient: (L, 3) y.   coupling: (N, 3, 6) Y of each observation; that of
        the first of a
    landmark's observations in an epoch holds them all.
    information: (r + 1, r) what is left to the poses, in the lower triangle, and an empty row.   pose_gradient: (r,).
    """

    observations: LandmarkObservations
    weight: Float[np.ndarray, " N"]
    is_constrained: Bool[np.ndarray, " L"]
    used: Bool[np.ndarray, " N"]
    information_sqrt: Float[np.ndarray, "L 3 3"]
    gradient: Float[np.ndarray, "L 3"]
    coupling: Float[np.ndarray, "N 3 6"]
    information: Float[np.ndarray, "w r"]
    pose_gradient: Float[np.ndarray, " r"]

    def points_step(self, poses: Float[np.ndarray, "k 6"]) -> Float[np.ndarray, "L 3"]:
        """Landmark steps by back-substitution of a pose step; zero where not well constrained."""
        s, library = self.observations, kernels()
        if library is None:
            return self._points_step(poses)
        step, poses = np.empty((s.landmarks, 3)), np.ascontiguousarray(poses)
        library.follow_poses(
            s.landmarks,
            *map(
                address,
                (
                    s.start,
                    s.epoch,
                    self.is_constrained,
                    self.information_sqrt,
                    self.gradient,
                    self.coupling,
                    poses,
                    step,
                ),
            ),
        )
        return step

    def _points_step(self, poses: Float[np.ndarray, "k 6"]) -> Float[np.ndarray, "L 3"]:
        rest = self.gradient.copy()
        np.subtract.at(
            rest,
            self.observations.landmark,
            np.einsum("nab,nb->na", self.coupling, poses[self.observations.epoch]),
        )
        step = np.zeros_like(rest)
        step[self.is_constrained] = _solved(
            np.swapaxes(self.information_sqrt[self.is_constrained], 1, 2), rest[self.is_constrained]
        )
        return step


def eliminate(
    observations: LandmarkObservations,
    linear: LinearObservations,
    weight: Float[np.ndarray, " N"],
    kept: int,
    epochs: int,
) -> Eliminated:
    """Eliminate the landmarks from weighted observations.

    Observations of landmarks that are then not well-constrained do not count.

    Parameters
    ----------
    kept: number of unknowns that remain, poses first.
    """
    library = kernels()
    if library is None:
        return eliminate_in_numpy(observations, linear, weight, kept, epochs)
    L, N = observations.landmarks, len(observations)
    is_constrained, gradient = np.empty(L, dtype=bool), np.empty((L, 3))
    information_sqrt = np.empty((L, 3, 3))
    coupling, slope = pooled_array(N, 3, POSE), np.zeros(kept)
    blocks, information = pooled_array(epochs * (epochs + 1) // 2 * POSE * WIDE), pooled_zeros(kept + 1, kept)
    weight, rows = np.ascontiguousarray(weight), np.ascontiguousarray(linear.rows)
    failed = library.eliminate_landmarks(
        L,
        epochs,
        *map(address, (observations.start, observations.epoch, rows, weight)),
        FLATTEST,
        *map(address, (is_constrained, information_sqrt, gradient, coupling, blocks, slope)),
    )
    if failed:
        raise MemoryError("no memory to eliminate the landmarks")
    library.spread_blocks(epochs, kept, address(blocks), address(information))
    used = (weight > 0) & is_constrained[observations.landmark]
    return Eliminated(
        observations, weight, is_constrained, used, information_sqrt, gradient, coupling, information, slope
    )


def eliminate_in_numpy(
    observations: LandmarkObservations,
    linear: LinearObservations,
    weight: Float[np.ndarray, " N"],
    kept: int,
    epochs: int,
) -> Eliminated:
    """`eliminate` for machines without a compiler."""
    landmark, epoch, L = observations.landmark, observations.epoch, observations.landmarks
    is_constrained, used, information_sqrt = _constrained(observations, linear, weight)
    root, each_used = np.sqrt(np.where(used, weight, 0.0))[:, None, None], used[:, None, None]
    scaled = root * np.where(each_used, linear.rows, 0.0)
    by_pose, by_point, y = scaled[:, :, :POSE], scaled[:, :, POSE:-1], scaled[:, :, -1:]
    gradient, whole = np.zeros((L, 3)), np.zeros((L, 3, epochs, POSE))
    turned = by_point.swapaxes(1, 2)
    np.add.at(gradient, landmark, (turned @ y)[..., 0])
    gradient = _solved(information_sqrt, gradient)
    each = np.linalg.solve(information_sqrt[landmark], turned @ by_pose)
    np.add.at(whole, (landmark, slice(None), epoch), each)  # pyright: ignore[reportArgumentType]
    blocks, jacobian = np.zeros((epochs, POSE, POSE)), np.zeros((epochs, POSE))
    np.add.at(blocks, epoch, by_pose.swapaxes(1, 2) @ by_pose)
    np.add.at(jacobian, epoch, (by_pose.swapaxes(1, 2) @ y)[..., 0])
    Y, size = whole.reshape(3 * L, epochs * POSE), epochs * POSE
    information, slope = np.zeros((kept + 1, kept)), np.zeros(kept)
    information[:size, :size] = _added_on_diagonal(-np.tril(Y.T @ Y), blocks)
    slope[:size] = jacobian.reshape(-1) - Y.T @ gradient.reshape(-1)
    coupling = whole.swapaxes(1, 2)[landmark, epoch] * _firsts(observations, used)[:, None, None]
    lower = np.tril(information)
    return Eliminated(
        observations, weight, is_constrained, used, information_sqrt, gradient, coupling, lower, slope
    )


def _added_on_diagonal(
    information: Float[np.ndarray, "s s"], blocks: Float[np.ndarray, "k p p"]
) -> Float[np.ndarray, "s s"]:
    """A matrix with a block added for every pose on its diagonal; in place."""
    for k, block in enumerate(blocks):
        at = slice(k * POSE, (k + 1) * POSE)
        information[at, at] += block
    return information


def _constrained(
    observations: LandmarkObservations, linear: LinearObservations, weight: Float[np.ndarray, " N"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Well-constrained landmarks, observations that count, and square-root information.

    The latter is I where a landmark is not well-constrained.
    """
    L, landmark = observations.landmarks, observations.landmark
    by_point = np.where((weight > 0)[:, None, None], linear.rows[:, :, POSE:-1], 0.0)
    information = np.zeros((L, 3, 3))
    np.add.at(information, landmark, weight[:, None, None] * by_point.swapaxes(1, 2) @ by_point)
    hits = np.bincount(landmark[weight > 0], minlength=L)
    diagonal = np.einsum("kii->ki", information)
    with np.errstate(invalid="ignore", divide="ignore"):
        shape = np.linalg.det(information) / diagonal.prod(axis=1)
    is_constrained = (hits >= OBSERVATIONS_NEEDED) & (shape > FLATTEST)
    information_sqrt = np.tile(np.eye(3), (L, 1, 1))
    information_sqrt[is_constrained] = np.linalg.cholesky(information[is_constrained])
    return is_constrained, (weight > 0) & is_constrained[landmark], information_sqrt


def _firsts(observations: LandmarkObservations, used: Bool[np.ndarray, " N"]) -> Bool[np.ndarray, " N"]:
    """The first used observation of each landmark in each epoch."""
    rows = np.flatnonzero(used)
    place = (
        observations.landmark[rows] * (int(observations.epoch.max(initial=0)) + 1) + observations.epoch[rows]
    )
    result = np.zeros(len(used), dtype=bool)
    result[rows[np.flatnonzero(np.diff(place, prepend=-1))]] = True
    return result


def _solved(
    information_sqrt: Float[np.ndarray, "k 3 3"], right: Float[np.ndarray, "k 3"]
) -> Float[np.ndarray, "k 3"]:
    return np.linalg.solve(information_sqrt, right[..., None])[..., 0]
