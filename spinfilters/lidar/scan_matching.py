"""Poses of a body of any shape, by registration.

Every scan is registered to the map of those before it, then all are adjusted together.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from spinfilters.errors import InputError
from spinfilters.lidar.pose_prediction import predicted_pose
from spinfilters.lidar.registration import (
    Cloud,
    PointToPlane,
    Registration,
    RegistrationEngine,
    cloud_of,
    coarse_pose,
    registered,
)
from spinfilters.lidar.scan_adjustment import MAP_SCANS, AdjustedScans, adjusted_scans
from spinfilters.lidar.scan_pose import ScanPose, pose_covariance, skew

MOST_POINTS: Final = 3000
"""Points of a scan that are registered."""
WIDEST_TURN: Final = 1.8
"""Largest rotation between the first scans that is searched, rad."""
SMALLEST: Final = 1e-9
"""Size of a body that can be registered, in distances, at least."""
SURE_OVERLAP: Final = 0.5
_REACH = 0.25  # of the body's size: how far a prediction may be wrong


def match_scans(
    times: Sequence[float],
    scans: Sequence[Float[np.ndarray, "n 3"]],
    middle: Float[np.ndarray, "3"],
    engine: RegistrationEngine | None = None,
    viewpoint: Float[np.ndarray, "3"] | None = None,
) -> AdjustedScans:
    """Poses of scans in frame g.

    It has the lidar's axes at the first scan and its origin at ``middle`` (m, in L).

    Parameters
    ----------
    scans: points in L, m.   engine: `PointToPlane` where None.   viewpoint: of the lidar in L, its origin where None.

    Raises
    ------
    InputError: points that all lie in one place.
    """
    engine, eye = engine or PointToPlane(), np.zeros(3) if viewpoint is None else viewpoint
    clouds = [cloud_of(points, eye, MOST_POINTS) for points in scans]
    size = max(cloud.size for cloud in clouds)
    if not size > SMALLEST * float(np.linalg.norm(middle - eye)):
        raise InputError("the points of every scan lie in one place; give scans that resolve the body")
    poses = [ScanPose(times[0], np.eye(3), middle, np.zeros((6, 6)), matched=len(clouds[0].points))]
    for k in range(1, len(clouds)):
        poses.append(_next(clouds, poses, times[k], size, engine))
    return adjusted_scans(clouds, poses, size, 0.3 * _REACH * size)


def _next(
    clouds: list[Cloud], poses: list[ScanPose], time: float, size: float, engine: RegistrationEngine
) -> ScanPose:
    """The pose of the next scan.

    From the prediction, or searched where that leads to little overlap.
    """
    number = len(poses)
    R, t = predicted_pose(poses, time, size)
    target = _map(clouds, poses, R, list(range(number)))
    found = registered(clouds[number], target, R.T, -R.T @ t, _REACH * size, engine)
    if found.overlap < SURE_OVERLAP or number == 1:
        start = coarse_pose(clouds[number], target, WIDEST_TURN)
        other = registered(clouds[number], target, *start, _REACH * size, engine)
        found = max(found, other, key=lambda each: each.overlap / max(each.residual_std, 1e-12) ** 0.5)
    return _told(found, time, size)


def _map(clouds: list[Cloud], poses: list[ScanPose], R: Float[np.ndarray, "3 3"], among: list[int]) -> Cloud:
    """Points in g of the scans seen from the directions most like that of a pose."""
    turn = [Rotation.from_matrix(poses[k].rotation @ R.T).magnitude() for k in among]
    chosen = [among[k] for k in np.argsort(turn, kind="stable")[:MAP_SCANS]]
    points = [(clouds[k].points - poses[k].translation) @ poses[k].rotation for k in chosen]
    normals = [clouds[k].normals @ poses[k].rotation for k in chosen]
    return Cloud.of(np.concatenate(points), np.concatenate(normals))


def _told(found: Registration, time: float, size: float) -> ScanPose:
    """The pose of g in L from that of the cloud in g.

    p_g = R p_L + t.
    An error of the registration in map axes, rotation d and shift e, is a rotation a = -R' d of g in L, and a shift s of its origin
    with -R' e = s + t x a: the registration rotates about the lidar.
    """
    R = found.rotation.T
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = -R
    information = turn @ found.information @ turn.T
    translation = -R @ found.translation
    K = np.eye(6)
    K[3:, :3] = skew(translation)
    information = K.T @ information @ K
    covariance, lacking = pose_covariance(information, R, size)
    return ScanPose(time, R, translation, covariance, lacking, found.matched)
