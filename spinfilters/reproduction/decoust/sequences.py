"""The thesis' sequences of snapshots, processed whole: corners, boundary corners, transitions compared with the truth."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.lidar.mesh import box
from spinfilters.lidar.scan import LidarNoise
from spinfilters.reproduction.decoust.corners import SnapshotFeatures, snapshot_features
from spinfilters.reproduction.decoust.reference_frames import (
    reference_frame,
    tracked_boundary_corners,
    transition_errors,
)
from spinfilters.reproduction.decoust.scan_features import Parameters
from spinfilters.simulation.lidar_scanner import LidarSettings, Scanner, Still, thesis_rotation

PLACE: Final = np.array([500.0, 0.0, 0.0])
"""Centre of the cube, m."""
SEQUENCES: Final = (
    tuple((6.0 + 3 * k, 10.0 + 5 * k, 0.0) for k in range(14)),
    tuple((111.0 + 3 * k, 185.0 + 5 * k, 0.0) for k in range(16)),
)
"""Euler angles z, y, x, deg, of the snapshots (Figures 4.12 and 4.15)."""


@dataclass(frozen=True, eq=False)
class ProcessedSequence:
    """Snapshots of the cube with what was found and what is true.

    Attributes
    ----------
    snapshots: None where the processing found no corner.   vertices: (n, 8, 3) m.
    boundary_corners: (n, 3, 3), tracked, NaN where there is none.
    """

    snapshots: tuple[SnapshotFeatures | None, ...]
    vertices: Float[np.ndarray, "n 8 3"]
    boundary_corners: Float[np.ndarray, "n 3 3"]

    @property
    def corners(self) -> Float[np.ndarray, "n 3"]:
        """Measured corners, NaN where there is none."""
        return np.array([np.full(3, np.nan) if each is None else each.corner for each in self.snapshots])

    def nearest_vertices(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """The true vertex next to a point of every snapshot; NaN for NaN."""
        distance = np.linalg.norm(self.vertices - points[:, None], axis=2)
        chosen = self.vertices[np.arange(len(points)), np.argmin(np.nan_to_num(distance), axis=1)]
        return np.where(np.isnan(points), np.nan, chosen)

    def errors(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """True minus measured (Eq. 4.6), m."""
        return self.nearest_vertices(points) - points

    def transition_errors(self, boundary: int) -> Float[np.ndarray, "m 3"]:
        """Angles, deg, of axes between frames of one boundary corner; NaN without it."""
        found = self.corners, self.boundary_corners[:, boundary]
        epochs = [
            np.array([reference_frame(PLACE, *pair) for pair in zip(*points, strict=True)])
            for points in (found, tuple(map(self.nearest_vertices, found)))
        ]
        return transition_errors(epochs[0], epochs[1])


def processed_sequence(
    angles: Sequence[tuple[float, float, float]],
    parameters: Parameters | None = None,
    noise: LidarNoise | None = None,
    seed: int = 0,
) -> ProcessedSequence:
    """The cube at 500 m in every pose, scanned with the rays of Table 3.2 and processed."""
    scanner = Scanner.of(box(), LidarSettings(noise=noise or LidarNoise()))
    generator, snapshots, vertices = np.random.default_rng(seed), [], []
    for pose in angles:
        rotation = thesis_rotation(*pose)
        scan = scanner.scan(Still(rotation, PLACE), 0.0, generator)
        snapshots.append(snapshot_features(scan.points, parameters or Parameters()))
        vertices.append(box().vertices @ rotation.T + PLACE)
    return ProcessedSequence(tuple(snapshots), np.array(vertices), tracked_boundary_corners(snapshots))
