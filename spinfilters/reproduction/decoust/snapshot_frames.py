"""Centre of rotation, reference frames and transition matrices of sequences of snapshots (Decoust 2008, sections 4.2 to 4.4).

The thesis' sequences are processed whole: corners, boundary corners, transitions compared with the truth.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.lidar.mesh import box
from spinfilters.lidar.scan import LidarNoise
from spinfilters.reproduction.decoust.cloud_features import Parameters, SnapshotFeatures, snapshot_features
from spinfilters.simulation.lidar_scanner import LidarSettings, Scanner, Still, thesis_rotation


@dataclass(frozen=True, eq=False)
class Sphere:
    """Sphere with the error of its centre.

    Centre, m, radius, m, and how much larger the error of the centre is than that of the points (both RMS, 3D).
    """

    centre: Float[np.ndarray, "3"]
    radius: float
    amplification: float


def best_fitting_sphere(points: Float[np.ndarray, "n 3"]) -> Sphere:
    """Sphere of least squares of Eq. 4.15, corrected: about the mean of the points.

    The normal equations as printed, in mm from the lidar, are so ill-conditioned that 1.5 m of the centre are lost.

    Raises
    ------
    InputError: fewer than four points, or points in one plane, which leave the centre undetermined.
    """
    mean = points.mean(axis=0)
    q = points - mean
    scale = np.sqrt(np.mean(q**2)) or 1.0
    A = np.column_stack([2 * q / scale, np.ones(len(q))])
    if len(points) < 4 or np.linalg.matrix_rank(A, tol=1e-9 * len(q)) < 4:
        raise InputError(
            f"{len(points)} points in a plane or fewer than four determine no sphere; give other poses"
        )
    x = np.linalg.lstsq(A, np.sum(q**2, axis=1) / scale, rcond=None)[0]
    centre = x[:3]
    radius = float(np.sqrt(x[3] * scale + centre @ centre))
    # an error e of a point changes its equation by 2 (q - centre).e, that is by 2 r times its radial part
    gain = np.linalg.pinv(A)[:3] * (2 * radius / scale)
    return Sphere(centre + mean, radius, float(np.linalg.norm(gain) / np.sqrt(3)))


def reference_frame(
    centre: Float[np.ndarray, "3"], corner: Float[np.ndarray, "3"], boundary_corner: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3 3"]:
    """Direction cosine matrix of centre A, corner B and boundary corner C: columns x = AB, y, and z normal to ABC (Figure 4.10)."""
    x = (corner - centre) / np.linalg.norm(corner - centre)
    z = np.cross(corner - centre, boundary_corner - centre)
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z], axis=1)


def transition_errors(
    measured: Float[np.ndarray, "n 3 3"], true: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, "m 3"]:
    """Angles, deg, between rows of measured and true transition matrices M = DCM(t + 1) DCM(t)' (section 4.4)."""
    ours, theirs = (epochs[1:] @ np.swapaxes(epochs[:-1], 1, 2) for epochs in (measured, true))
    sines = np.linalg.norm(np.cross(ours, theirs), axis=2)
    return np.rad2deg(np.arctan2(sines, np.einsum("nij,nij->ni", ours, theirs)))


def tracked_boundary_corners(snapshots: Sequence[SnapshotFeatures | None]) -> Float[np.ndarray, "n 3 3"]:
    """Boundary corners of every snapshot in the order of the first.

    The first is that with three; each corner is the nearest to its predecessor.
    NaN where a snapshot failed, or shows none within half the distance between corners.
    """
    tracked = np.full((len(snapshots), 3, 3), np.nan)
    last: np.ndarray | None = None
    for row, snapshot in enumerate(snapshots):
        if snapshot is None or (last is None and len(snapshot.boundary_corners) < 3):
            continue
        found = snapshot.boundary_corners
        if last is None:
            last = found.copy()
        reach = 0.5 * np.linalg.norm(last[:, None] - last[None], axis=2)[np.triu_indices(3, 1)].min()
        for k in range(3):
            distance = np.linalg.norm(found - last[k], axis=1)
            if len(found) and distance.min() < reach:
                tracked[row, k] = last[k] = found[np.argmin(distance)]
    return tracked


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
