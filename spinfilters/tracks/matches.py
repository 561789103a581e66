"""Matches of map points with pixels, of one epoch or of many."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.models.sensor_models.camera_landmark import camera_parameters
from spinfilters.models.sensor_noise import NoiseLevel


@dataclass(frozen=True)
class Matches:
    """Matches of one epoch.

    Attributes
    ----------
    points: (k, 3) m, frame g.   pixels: (k, 3) rectified.
    noise: standard deviation (px) of each pixel coordinate, or (k, 3, 3) covariances of the matches (px^2).
    covariance: (k, 3, 3) of the points, m^2, frame g; None for a map that is known exactly. A triangulated depth is so uncertain
        that a fit without it would turn the body to please the depths.
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
    given: (f, k) where there is a match that is no copy.
    parameters: (f, k, p) of the sensor: point, calibration, noise.   covariance: of the points, or None.
    pixel_std: (f, k) of a pixel coordinate, px.
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

    def about(self, points: Float[np.ndarray, "f k 3"]) -> "MatchTable":
        """The table with the sensor's parameters for other points."""
        return replace(self, parameters=np.concatenate([points, self.parameters[..., 3:]], axis=2))


def _pixel_std(epoch: Matches) -> Float[np.ndarray, " k"]:
    if not np.ndim(epoch.noise):
        return np.full(len(epoch.points), epoch.noise)
    return np.sqrt(np.trace(epoch.noise, axis1=1, axis2=2) / 3)
