"""Matches of an epoch with a map, and the pose on which most of them agree."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.absolute_orientation import absolute_orientations
from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.cameras import stereo_pair
from spinfilters.models.camera_landmarks import camera_parameters
from spinfilters.models.sensor_noise import NoiseLevel


@dataclass(frozen=True)
class Matches:
    """Matches of one epoch.

    Attributes
    ----------
    points : Float[np.ndarray, 'k 3']
        (k, 3) m, frame g.
    pixels : Float[np.ndarray, 'k 3']
        (k, 3) rectified.
    noise : NoiseLevel
        Standard deviation (px) of each pixel coordinate, or (k, 3, 3) covariances of the matches (px^2).
    covariance : Float[np.ndarray, 'k 3 3'] | None
        (k, 3, 3) of the points, m^2, frame g; None for a map that is known exactly. A triangulated depth is so
        uncertain that a fit without it would turn the body to please the depths.
    """

    points: Float[np.ndarray, "k 3"]
    pixels: Float[np.ndarray, "k 3"]
    noise: NoiseLevel
    covariance: Float[np.ndarray, "k 3 3"] | None = None


@dataclass(frozen=True)
class MatchTable:
    """Matches of f epochs in rows of equal length, padded with the last match.

    Attributes
    ----------
    given : Bool[np.ndarray, 'f k']
        (f, k) where there is a match that is no copy.
    parameters : Float[np.ndarray, 'f k p']
        (f, k, p) of the sensor: point, calibration, noise.
    covariance : Float[np.ndarray, 'f k 3 3'] | None
        Of the points, or None.
    pixel_std : Float[np.ndarray, 'f k']
        (f, k) of a pixel coordinate, px.
    """

    given: Bool[np.ndarray, "f k"]
    points: Float[np.ndarray, "f k 3"]
    pixels: Float[np.ndarray, "f k 3"]
    parameters: Float[np.ndarray, "f k p"]
    covariance: Float[np.ndarray, "f k 3 3"] | None
    pixel_std: Float[np.ndarray, "f k"]

    @classmethod
    def of(cls, epochs: Sequence[Matches], calibration: Float[np.ndarray, " c"]) -> "MatchTable":
        """Table of one or more epochs with one parametrisation of noise."""
        counts = np.array([len(epoch.points) for epoch in epochs])
        column = np.arange(counts.max())
        row = (np.cumsum(counts) - counts)[:, None] + np.minimum(column, counts[:, None] - 1)
        covariances = [epoch.covariance for epoch in epochs if epoch.covariance is not None]
        parameters = [camera_parameters(epoch.points, calibration, epoch.noise) for epoch in epochs]
        return cls(
            column < counts[:, None],
            np.concatenate([epoch.points for epoch in epochs])[row],
            np.concatenate([epoch.pixels for epoch in epochs])[row],
            np.concatenate(parameters)[row],
            np.concatenate(covariances)[row] if covariances else None,
            np.concatenate([_pixel_std(epoch) for epoch in epochs])[row],
        )

    @property
    def counts(self) -> Int[np.ndarray, " f"]:
        """Matches of each epoch."""
        return np.count_nonzero(self.given, axis=1)

    def part(self, epochs: Bool[np.ndarray, " f"]) -> "MatchTable":
        """Some of the epochs."""
        if epochs.all():
            return self
        covariance = None if self.covariance is None else self.covariance[epochs]
        return MatchTable(
            self.given[epochs],
            self.points[epochs],
            self.pixels[epochs],
            self.parameters[epochs],
            covariance,
            self.pixel_std[epochs],
        )


def _pixel_std(epoch: Matches) -> Float[np.ndarray, " k"]:
    if not np.ndim(epoch.noise):
        return np.full(len(epoch.points), epoch.noise)
    return np.sqrt(np.trace(epoch.noise, axis1=1, axis2=2) / 3)


AGREEMENT_PX = 20.0
"""Within which a match agrees with a rough pose: three triangulated points turn a body by some 0.1 rad, 10 px on its rim."""
AGREEMENT = 6.0
"""The same in standard deviations of a pixel, for images with more noise than that."""
MAP_AGREEMENT = 4.0
"""Standard deviations of a map's point that come to it: along the line of sight it was seen on, it may be off by its own size."""
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
TRIMS = 2
REFITS = 3
SEED = 0
"""Of the triples, so that the same matches give the same pose."""


@dataclass(frozen=True)
class _UsableMatches:
    """Matches whose pixels determine a point in front of the camera.

    Attributes
    ----------
    usable : Bool[np.ndarray, 'f k']
        (f, k) which do; elsewhere all else is finite and means nothing.
    camera : Float[np.ndarray, 'f k 3']
        (f, k, 3) triangulated points, m.
    """

    usable: Bool[np.ndarray, "f k"]
    points: Float[np.ndarray, "f k 3"]
    pixels: Float[np.ndarray, "f k 3"]
    camera: Float[np.ndarray, "f k 3"]
    tolerance: Float[np.ndarray, "f k"]
    spread: Float[np.ndarray, "f k 3 3"] | None
    calibration: Float[np.ndarray, " c"]

    @classmethod
    def of(cls, table: MatchTable, calibration: Float[np.ndarray, " c"]) -> "_UsableMatches":
        """Usable matches of a table as rays and points of the camera's frame."""
        camera = stereo_pair(calibration).points_of(table.pixels, calibration)
        usable = table.given & np.isfinite(camera).all(axis=2) & (camera[..., 2] > 0)
        pixels, camera = (np.where(usable[..., None], array, 1.0) for array in (table.pixels, camera))
        tolerance = np.maximum(AGREEMENT_PX, AGREEMENT * table.pixel_std)
        return cls(usable, table.points, pixels, camera, tolerance, table.covariance, calibration)

    @cached_property
    def weights(self) -> Float[np.ndarray, "f k"]:
        """They fall with depth, as its uncertainty grows."""
        return self.camera[..., 2] ** -4

    def epoch(self, number: int) -> "_UsableMatches":
        """The usable matches of one epoch."""
        usable = self.usable[number]
        names = ("points", "pixels", "camera", "tolerance", "spread")
        given = {name: getattr(self, name) for name in names}
        own = {name: None if a is None else a[number][usable][None] for name, a in given.items()}
        return replace(self, usable=np.ones((1, np.count_nonzero(usable)), dtype=bool), **own)

    def share(self, chosen: Bool[np.ndarray, "f k"]) -> Float[np.ndarray, " f"]:
        """Share of the usable matches."""
        return np.count_nonzero(chosen, axis=1) / np.maximum(np.count_nonzero(self.usable, axis=1), 1)

    def agreeing(self, poses: Float[np.ndarray, "h 7"]) -> Bool[np.ndarray, "h k"]:
        """Inliers: matches near the predicted pixels of a pose, for a pose per epoch or h poses of one epoch."""
        return self.usable & (self.squared_distances(poses) < 1.0)

    def cost(self, poses: Float[np.ndarray, "h 7"]) -> Float[np.ndarray, " h"]:
        """Sum of squared distances up to a bound, under each of the poses."""
        return np.minimum(self.squared_distances(poses), 1.0).sum(axis=1)

    def fitted(
        self, chosen: Bool[np.ndarray, "h k"]
    ) -> tuple[Float[np.ndarray, "h 7"], Bool[np.ndarray, " h"]]:
        """Absolute orientations of the chosen matches, and which they determine: four of them at least."""
        enough = np.count_nonzero(chosen, axis=1) >= 4
        weights = np.where(chosen | ~enough[:, None], self.weights, 0.0)
        shape = (*chosen.shape, 3)
        camera, points = np.broadcast_to(self.camera, shape), np.broadcast_to(self.points, shape)
        found = absolute_orientations(camera, points, weights)
        return found.poses, enough & found.determined

    def squared_distances(self, poses: Float[np.ndarray, "h 7"]) -> Float[np.ndarray, "h k"]:
        """Squared distances, in tolerances, of (u_left, v_left, u_right) from each pose's; infinite behind the camera."""
        camera, rotations = stereo_pair(self.calibration), matrix_from_quaternion(poses[:, 3:])
        at = self.points @ np.swapaxes(rotations, 1, 2) + poses[:, None, :3]
        away = camera.pixels_of(at, self.calibration) - self.pixels
        with np.errstate(divide="ignore", invalid="ignore"):
            if self.spread is None:
                squares = np.einsum("hki,hki->hk", away, away) / self.tolerance**2
            else:
                by_point = camera.pixels_by_point(at, self.calibration) @ rotations[:, None]
                squares = self._squares_in_spread(away, by_point)
            return np.where(at[..., 2] > 0, squares, np.inf)

    def _squares_in_spread(
        self, away: Float[np.ndarray, "h k 3"], by_point: Float[np.ndarray, "h k 3 3"]
    ) -> Float[np.ndarray, "h k"]:
        """Squared distances that account for the map points' own errors.

        These are large along the line of sight from which the points were triangulated, and small across it.
        """
        assert self.spread is not None
        spread = MAP_AGREEMENT**2 * by_point @ self.spread @ np.swapaxes(by_point, 2, 3)
        spread += self.tolerance[..., None, None] ** 2 * np.eye(3)
        return (away * np.linalg.solve(spread, away[..., None])[..., 0]).sum(axis=2)


@dataclass(frozen=True)
class Consensus:
    """Rough poses (t, q_ig) of f epochs with their inliers.

    Attributes
    ----------
    poses : Float[np.ndarray, 'f 7']
        (f, 7).
    found : Bool[np.ndarray, ' f']
        (f,) where matches enough agree.
    agreeing : Bool[np.ndarray, 'f k']
        (f, k).
    """

    poses: Float[np.ndarray, "f 7"]
    found: Bool[np.ndarray, " f"]
    agreeing: Bool[np.ndarray, "f k"]


def consensus_poses(table: MatchTable, calibration: Float[np.ndarray, " c"]) -> Consensus:
    """Rough poses of f epochs, those that most of their matches agree on."""
    seen = _UsableMatches.of(table, calibration)
    poses, found = _trim_matches(seen)
    agreeing = seen.agreeing(poses)
    unclear = found & (seen.share(agreeing) < CLEAR_SHARE)
    for epoch in np.flatnonzero(unclear).tolist():
        poses[epoch] = _best_of_triples(seen.epoch(epoch))
    if unclear.any():
        agreeing = seen.agreeing(poses)
    poses, agreeing = _refine_poses(seen, poses, agreeing & found[:, None], found)
    return Consensus(poses, found & (seen.share(agreeing) >= SMALLEST_SHARE), agreeing)


def _refine_poses(
    seen: _UsableMatches,
    poses: Float[np.ndarray, "h 7"],
    agreeing: Bool[np.ndarray, "h k"],
    found: Bool[np.ndarray, " h"],
) -> tuple[Float[np.ndarray, "h 7"], Bool[np.ndarray, "h k"]]:
    """Poses refitted to their inliers until the inliers stay the same, and the inliers; poses not found or not determined stay."""
    fitted = np.zeros((len(poses), seen.usable.shape[1]), dtype=bool)
    for _ in range(REFITS):
        if np.array_equal(agreeing, fitted):
            break
        again, determined = seen.fitted(agreeing)
        poses, fitted = np.where(determined[:, None], again, poses), agreeing
        agreeing = seen.agreeing(poses) & found[:, None]
    return poses, agreeing


def _trim_matches(seen: _UsableMatches) -> tuple[Float[np.ndarray, "f 7"], Bool[np.ndarray, " f"]]:
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
    """Medians of the chosen values of each row; infinite where none is."""
    # chosen values come first in each row, so that their middle is counted from its beginning
    ordered, counts = np.sort(np.where(chosen, values, np.inf), axis=1), np.count_nonzero(chosen, axis=1)
    middle = np.stack([np.maximum(counts - 1, 0) // 2, np.minimum(counts // 2, values.shape[1] - 1)], axis=1)
    return np.take_along_axis(ordered, middle, axis=1).mean(axis=1)


def _best_of_triples(seen: _UsableMatches) -> Float[np.ndarray, " 7"]:
    """The cheapest pose of one epoch from random triples.

    It draws as many as promise `RIGHT_TRIPLES` right ones at the share that agrees.
    """
    generator = np.random.default_rng(SEED)
    best, least = np.zeros(7), np.inf
    for batch in range(1, LARGEST_SEARCH + 1):
        drawn = _cheapest_motions(seen, generator)
        poses, _ = _refine_poses(seen, drawn, seen.agreeing(drawn), np.ones(len(drawn), dtype=bool))
        costs = seen.cost(poses)
        cheapest = int(np.argmin(costs))
        if costs[cheapest] < least:
            best, least = poses[cheapest], float(costs[cheapest])
        if batch * TRIPLES * float(seen.share(seen.agreeing(best[None]))[0]) ** 3 >= RIGHT_TRIPLES:
            break
    return best


def _cheapest_motions(seen: _UsableMatches, generator: np.random.Generator) -> Float[np.ndarray, "r 7"]:
    """The cheapest motions of a batch of triples."""
    chosen = generator.random((TRIPLES, seen.points.shape[1])).argpartition(2, axis=1)[:, :3]
    poses = absolute_orientations(seen.camera[0][chosen], seen.points[0][chosen]).poses
    return poses[np.argsort(seen.cost(poses))[:REFINED]]
