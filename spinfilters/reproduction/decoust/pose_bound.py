"""Cramer-Rao bound of the pose of a cube of known shape from the ranges of one scan, with the noise of Figure 2.11.

The scans of chapter 4 have no noise, so that the bound of what is printed there is zero. With the noise of the specification it is
the least error that any processing of the same scan could have; a body of unknown shape has a larger one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.reproduction.decoust.snapshot_frames import PLACE
from spinfilters.simulation.lidar_scanner import thesis_rotation
from spinfilters.simulation.lidar_sequence import RANGE_NOISE


@dataclass(frozen=True, eq=False)
class PoseBound:
    """Bound of one scan.

    Attributes
    ----------
    covariance : (6, 6) float array
        Of a small rotation about the axes of the lidar, rad, and of the centre, m.
    """

    covariance: Float[np.ndarray, "6 6"]

    def of_point(self, place: Float[np.ndarray, "3"]) -> float:
        """Deviation of a point of the body at this place from the centre, root of the sum over the axes, m."""
        x, y, z = place
        # rotation (x) place = -[place x] rotation
        moved = np.hstack([np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]), np.eye(3)])
        return float(np.sqrt(np.trace(moved @ self.covariance @ moved.T)))

    @property
    def attitude(self) -> Float[np.ndarray, "3 3"]:
        """Covariance of the rotation, rad^2."""
        return self.covariance[:3, :3]

    @property
    def center(self) -> Float[np.ndarray, "3 3"]:
        """Covariance of the centre, m^2."""
        return self.covariance[3:, 3:]


def pose_bound(points: Float[np.ndarray, "n 3"], pose: tuple[float, float, float]) -> PoseBound:
    """Bound of the pose from the points of a scan of the cube.

    Parameters
    ----------
    points : (n, 3) float array
        On the cube's faces, frame of the lidar, m.
    pose : tuple of float
        Euler angles z, y, x, deg, in which the cube was scanned.
    """
    R = thesis_rotation(*pose)
    body = (points - PLACE) @ R
    face = np.abs(body).argmax(axis=1)
    normals = np.sign(body[np.arange(len(body)), face])[:, np.newaxis] * R.T[face]
    beams = points / np.linalg.norm(points, axis=1, keepdims=True)
    # a range changes by the shift of its face along the normal, over the cosine between normal and beam
    shift = np.hstack([np.cross(points - PLACE, normals), normals])
    slopes = shift / np.sum(normals * beams, axis=1, keepdims=True) / RANGE_NOISE.range_std
    return PoseBound(np.linalg.inv(slopes.T @ slopes))


def center_bound(bounds: Sequence[PoseBound]) -> float:
    """Deviation of a centre that several scans share, root of the sum over the axes, m."""
    information = sum((np.linalg.inv(each.center) for each in bounds), np.zeros((3, 3)))
    return float(np.sqrt(np.trace(np.linalg.inv(information))))


def noise_free(deviation: float, unit: str) -> str:
    """The cell of a scan without noise, with the bound of the same scan with noise.

    Parameters
    ----------
    deviation : float
        In ``unit``.
    unit : str
        Of the row.
    """
    return f"0 without noise; {deviation:.2g} {unit} with that of Figure 2.11"
