"""A first pose from matches of which many may be wrong: the rigid motion that most of them agree on.

A least-squares fit that is trimmed twice is tried first. Where too few matches agree with it, motions of random triples are
tried (RANSAC, Fischler and Bolles 1981, with the cost of Torr and Zisserman 2000: squared pixels up to a bound). A triple of
right matches lies so close together, and its depths are so poor, that it hardly ever shows which others are right; so the
cheapest of every batch are fitted to all that agree with them before they are compared (Chum, Matas and Kittler 2003).
"""

from dataclasses import dataclass

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
"""In a batch."""
RIGHT_TRIPLES = 20
"""Expected among all that are tried: only some of them are spread well besides."""
LARGEST_SEARCH = 10
"""Batches: enough for `RIGHT_TRIPLES` where 22 % of the matches are right."""
REFINED = 4
"""Motions of a batch that are fitted to what agrees with them."""
REFITS = 3
SEED = 0
"""Of the triples, so that the same matches give the same pose."""


@dataclass(frozen=True)
class Consensus:
    """Rough pose (t, q_ig), and which of the matches agree with it."""

    pose: Float[np.ndarray, " 7"]
    agreeing: Bool[np.ndarray, " k"]


@dataclass(frozen=True)
class _Matches:
    """Points of a map (frame g, m), the pixels they are taken to be seen at, and where these were triangulated (frame i, m)."""

    points: Float[np.ndarray, "k 3"]
    pixels: Float[np.ndarray, "k 3"]
    seen: Float[np.ndarray, "k 3"]
    calibration: Float[np.ndarray, " 5"]

    def agreeing(self, pose: Float[np.ndarray, " 7"]) -> Bool[np.ndarray, " k"]:
        """Which lie near their pixels under a pose."""
        return (
            self._squared_pixels(matrix_from_quaternion(pose[3:])[None], pose[None, :3])[0] < AGREEMENT_PX**2
        )

    def cost(
        self, rotations: Float[np.ndarray, "h 3 3"], shifts: Float[np.ndarray, "h 3"]
    ) -> Float[np.ndarray, " h"]:
        """Sum of squared pixels up to a bound, under each motion."""
        return np.minimum(self._squared_pixels(rotations, shifts), AGREEMENT_PX**2).sum(axis=1)

    def fitted(self, which: Bool[np.ndarray, " k"]) -> Float[np.ndarray, " 7"] | None:
        """Absolute orientation with weights that fall with depth, as its uncertainty grows; None for fewer than four points."""
        if np.count_nonzero(which) < 4:
            return None
        seen = self.seen[which]
        try:
            q, t = absolute_orientation(seen, self.points[which], seen[:, 2] ** -4)
        except InputError:
            return None
        return np.concatenate([t, q])

    def refined(self, pose: Float[np.ndarray, " 7"]) -> Float[np.ndarray, " 7"]:
        """A pose fitted again and again to what agrees with it."""
        fitted = np.zeros(len(self.points), dtype=bool)
        for _ in range(REFITS):
            agreeing = self.agreeing(pose)
            again = None if np.array_equal(agreeing, fitted) else self.fitted(agreeing)
            if again is None:
                break
            pose, fitted = again, agreeing
        return pose

    def _squared_pixels(
        self, rotations: Float[np.ndarray, "h 3 3"], shifts: Float[np.ndarray, "h 3"]
    ) -> Float[np.ndarray, "h k"]:
        """Squared distance (u_left, v_left, u_right) of each match under each motion, infinite behind the camera."""
        (fx, fy, cx, cy, baseline), pixels = self.calibration, self.pixels
        at = self.points @ np.swapaxes(rotations, 1, 2) + shifts[:, None]
        x, y, z = at[..., 0], at[..., 1], at[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v = fx * x / z + cx - pixels[:, 0], fy * y / z + cy - pixels[:, 1]
            right = u + pixels[:, 0] - fx * baseline / z - pixels[:, 2]
            return np.where(z > 0, u**2 + v**2 + right**2, np.inf)


def consensus_pose(
    points: Float[np.ndarray, "k 3"], pixels: Float[np.ndarray, "k 3"], calibration: Float[np.ndarray, " 5"]
) -> Consensus | None:
    """Rough pose of map points (frame g, m) seen at rectified pixels; None where too few ever agree."""
    seen = triangulate(pixels, calibration)
    usable = np.isfinite(seen).all(axis=1) & (seen[:, 2] > 0)
    matches = _Matches(points[usable], pixels[usable], seen[usable], calibration)
    pose = _trimmed(matches)
    if pose is None:
        return None
    if matches.agreeing(pose).mean() < CLEAR_SHARE:
        pose = _best_of_triples(matches)
    pose = matches.refined(pose)
    agreeing = np.zeros(len(points), dtype=bool)
    agreeing[usable] = matches.agreeing(pose)
    if np.count_nonzero(agreeing) < SMALLEST_SHARE * len(matches.points):
        return None
    return Consensus(pose, agreeing)


def _trimmed(matches: _Matches) -> Float[np.ndarray, " 7"] | None:
    """Absolute orientation, repeated twice without what disagrees grossly."""
    keep, pose = np.ones(len(matches.points), dtype=bool), None
    for _ in range(3):
        pose = matches.fitted(keep)
        if pose is None:
            return None
        there = matches.points @ matrix_from_quaternion(pose[3:]).T + pose[:3]
        error = np.linalg.norm(matches.seen - there, axis=1)
        closer = keep & (error <= 4 * np.median(error[keep]) + 1e-12)
        if np.array_equal(closer, keep):
            break
        keep = closer
    return pose


def _best_of_triples(matches: _Matches) -> Float[np.ndarray, " 7"]:
    """The cheapest pose, from as many triples as promise `RIGHT_TRIPLES` right ones at the share that agrees with it."""
    generator = np.random.default_rng(SEED)
    best, least = np.zeros(7), np.inf
    for batch in range(1, LARGEST_SEARCH + 1):
        poses = np.array([matches.refined(pose) for pose in _promising(matches, generator)])
        costs = matches.cost(matrix_from_quaternion(poses[:, 3:]), poses[:, :3])
        cheapest = int(np.argmin(costs))
        if costs[cheapest] < least:
            best, least = poses[cheapest], float(costs[cheapest])
        if batch * TRIPLES * matches.agreeing(best).mean() ** 3 >= RIGHT_TRIPLES:
            break
    return best


def _promising(matches: _Matches, generator: np.random.Generator) -> Float[np.ndarray, "r 7"]:
    """The cheapest motions of a batch of triples."""
    chosen = generator.random((TRIPLES, len(matches.points))).argpartition(2, axis=1)[:, :3]
    rotations, shifts = rigid_motions(matches.seen[chosen], matches.points[chosen])
    cheapest = np.argsort(matches.cost(rotations, shifts))[:REFINED]
    return np.concatenate([shifts[cheapest], quaternion_from_matrix(rotations[cheapest])], axis=1)
