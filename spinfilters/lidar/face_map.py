"""Plane faces of a body in frame g, and scans that see them.

It holds what a fitted plane says of face and pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Float

from spinfilters.lidar.planes import FittedPlane
from spinfilters.lidar.scan_pose import ScanPose, skew


@dataclass(frozen=True, eq=False)
class Face:
    """A face n.p = d in frame g."""

    normal: Float[np.ndarray, "3"]
    offset: float

    @property
    def tangents(self) -> Float[np.ndarray, "3 2"]:
        """Two unit tangents of the face."""
        return np.linalg.svd(self.normal[None])[2][1:].T


@dataclass(frozen=True, eq=False)
class TrackedFaces:
    """Poses of all scans and the map of faces that they share.

    Attributes
    ----------
    matches: for every scan, the face of each of its planes.
    covariance: (3 F, 3 F) of the faces: two tangent components of the normal (`Face.tangents`) and the offset, m; zero before it
        is known.   common: what it adds to the covariance of every pose.
    contradicted: number of scans with a plane that lies where the body's uniform drift leaves no face.
    """

    poses: tuple[ScanPose, ...]
    faces: tuple[Face, ...]
    matches: tuple[tuple[int, ...], ...]
    covariance: Float[np.ndarray, "f f"] = field(default_factory=lambda: np.zeros((0, 0)))
    common: tuple[Float[np.ndarray, "6 6"], ...] = ()
    contradicted: int = 0


@dataclass(frozen=True, eq=False)
class FaceInformation:
    """Normal equations of one scan: pose and faces.

    Pose (6: rotation in L, translation), faces 3 each.

    Attributes
    ----------
    own: (6, 6).   cross: (6, f).   shared: (f, f).   own_side: (6,), shared_side: (f,) right-hand sides.
    """

    own: Float[np.ndarray, "6 6"]
    cross: Float[np.ndarray, "6 f"]
    shared: Float[np.ndarray, "f f"]
    own_side: Float[np.ndarray, "6"]
    shared_side: Float[np.ndarray, " f"]


class MatchedFace(NamedTuple):
    """A plane fitted in a scan, and the face of the body that it is."""

    plane: FittedPlane
    face: Face


class FaceEvidence(Protocol):
    """Measurements of faces: fitted planes, or single ranges."""

    def of(self, tracked: TrackedFaces, number: int, robust: bool) -> FaceInformation:
        """Information of scan ``number``; outliers have less say where it is ``robust``."""
        ...


def normal_equations(
    pairs: Sequence[MatchedFace], R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "6 6"], Float[np.ndarray, "6"]]:
    """Information over (rotation in L, translation) and its right-hand side.

    Residuals of a face in a plane's own terms: tangent components of its normal, distance from the plane's centroid.
    """
    H, b = np.zeros((6, 6)), np.zeros(6)
    for plane, face in pairs:
        residual, J = residual_and_jacobian(plane, face, R, t)
        W = np.linalg.inv(plane.covariance)
        H += J.T @ W @ J
        b -= J.T @ W @ residual
    return H, b


def residual_and_jacobian(
    plane: FittedPlane, face: Face, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 6"]]:
    """Residual of a face in a plane's own terms, derivative by (rotation, translation) in L."""
    n, arm = R @ face.normal, t - plane.centroid
    residual = np.array([*(plane.tangents.T @ n), face.offset + n @ arm])
    J = np.zeros((3, 6))
    J[:2, :3] = -plane.tangents.T @ skew(n)
    J[2, :3], J[2, 3:] = np.cross(n, arm), n
    return residual, J


def face_jacobian(
    plane: FittedPlane, face: Face, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3 3"]:
    """Derivative of that residual by the face: two tangent components of its normal, and its offset."""
    RT = R @ face.tangents
    J = np.zeros((3, 3))
    J[:2, :2], J[2, :2] = plane.tangents.T @ RT, (t - plane.centroid) @ RT
    J[2, 2] = 1.0
    return J
