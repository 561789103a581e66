"""Faces adjusted to all ranges within the outline, for narrow faces.

Beams that jitter mix the faces at every edge. Planes fitted to the points that are clearly theirs are tilted by what their gates
let in, alike in all scans: angles between faces are wrong by more than their covariance. Ranges of the convex body have no gates.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.geometry.ray_angles import angles_of
from spinfilters.lidar.convex_ranges import expected_ranges
from spinfilters.lidar.edge_model import FITTING, inner_rays, with_edges
from spinfilters.lidar.face_adjustment import adjusted_faces, with_map_errors
from spinfilters.lidar.face_map import FaceInformation, TrackedFaces
from spinfilters.lidar.point_noise import PointNoise

_LARGE = 4.0  # standard deviations beyond which a range counts less (Huber)
MOST_RAYS: Final = 2000
"""Of a scan within the outline: planes of more points are better than the ranges of so many of them."""


@dataclass(frozen=True, eq=False)
class RangeEvidence:
    """Ranges, m, of the beams of every scan; a `FaceEvidence`.

    Beams by azimuth and elevation, rad; ``size``: of the body, m.
    """

    angles: Sequence[Float[np.ndarray, "n 2"]]
    ranges: Sequence[Float[np.ndarray, " n"]]
    noise: PointNoise
    size: float

    def of(self, tracked: TrackedFaces, number: int, robust: bool) -> FaceInformation:
        """See `FaceEvidence`; the information is smaller where residuals are larger than the noise."""
        J, residual = self._linearised(tracked, number)
        weight = np.minimum(1.0, _LARGE / np.maximum(np.abs(residual), 1e-12)) if robust else 1.0
        scale = max(1.0, _reduced(residual))
        weighted = (J.T * weight) / scale
        H, b = weighted @ J, weighted @ residual
        return FaceInformation(H[:6, :6], H[:6, 6:], H[6:, 6:], b[:6], b[6:])

    def reduced_chi_square(self, tracked: TrackedFaces) -> float:
        """Reduced chi-square of the scan that fits worst."""
        return max(_reduced(self._linearised(tracked, k)[1]) for k in range(len(self.ranges)))

    def _linearised(
        self, tracked: TrackedFaces, number: int
    ) -> tuple[Float[np.ndarray, "n m"], Float[np.ndarray, " n"]]:
        """Whitened residuals of ranges and their derivatives by pose and faces.

        Rays without a face are left out.
        """
        pose = tracked.poses[number]
        expected = expected_ranges(
            self.angles[number], tracked.faces, pose.rotation, pose.translation, self.noise
        )
        J = np.hstack([expected.by_pose, expected.by_faces]) / expected.std[:, None]
        residual = (self.ranges[number] - expected.mean) / expected.std
        good = np.isfinite(residual) & np.isfinite(J).all(axis=1)
        return J[good], residual[good]


def edge_adjusted(
    tracked: TrackedFaces, clouds: Sequence[Float[np.ndarray, "n 3"]], noise: PointNoise, size: float
) -> TrackedFaces:
    """Faces and poses of all ranges, or the given ones with edges.

    Given: beams that do not jitter, many rays or scans, a body that is not convex.

    Parameters
    ----------
    clouds: points of every scan, frame L, m.   size: of the body, m.
    """
    rays = [inner_rays(points, noise, MOST_RAYS + 1) for points in clouds]
    if not tracked.faces or any(each is None or len(each) > MOST_RAYS for each in rays):
        return _posed_with_edges(tracked, clouds, noise, size)
    chosen = [points[rows] for points, rows in zip(clouds, rays, strict=True) if rows is not None]
    angles = [np.stack(angles_of(points), axis=1) for points in chosen]
    evidence = RangeEvidence(angles, [np.linalg.norm(points, axis=1) for points in chosen], noise, size)
    found = adjusted_faces(tracked, evidence, size)
    sound = all(np.isfinite(pose.translation).all() for pose in found.poses)
    if not sound or evidence.reduced_chi_square(found) > FITTING:
        return _posed_with_edges(tracked, clouds, noise, size)
    bare = tuple(
        replace(new, covariance=old.covariance - more)
        for new, old, more in zip(found.poses, tracked.poses, tracked.common, strict=True)
    )
    none = tuple(np.zeros((6, 6)) for _ in bare)
    posed = _posed_with_edges(replace(found, poses=bare, common=none), clouds, noise, size)
    return replace(with_map_errors(posed, evidence, size), contradicted=tracked.contradicted)


def _posed_with_edges(
    tracked: TrackedFaces, clouds: Sequence[Float[np.ndarray, "n 3"]], noise: PointNoise, size: float
) -> TrackedFaces:
    poses = (
        with_edges(pose, points, tracked.faces, noise, size, common)
        for pose, points, common in zip(tracked.poses, clouds, tracked.common, strict=True)
    )
    return replace(tracked, poses=tuple(poses))


def _reduced(residual: Float[np.ndarray, " n"]) -> float:
    return float(np.mean(np.minimum(residual**2, _LARGE**2))) if len(residual) else np.inf
