"""Planes assigned to a wrong face.

They would put the body where its drift does not lead it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Final

import numpy as np

from spinfilters.lidar.face_adjustment import Drift, uniform_drift
from spinfilters.lidar.face_map import Face, TrackedFaces
from spinfilters.lidar.planes import FittedPlane
from spinfilters.lidar.scan_pose import ScanPose

CONTRADICTION: Final = 8.0
"""Standard deviations between a plane and its face, with the body where it drifts, beyond which they do not belong together."""
MOST_CONTRADICTED: Final = 0.2
"""Share of the scans, at most: where more contradict the drift, it is the drift that is not uniform."""


@dataclass(frozen=True, eq=False)
class ConsistentFaces:
    """Tracked faces with the consistent planes of every scan.

    ``contradicted``: number of scans that lost a plane.
    """

    tracked: TrackedFaces
    planes: tuple[tuple[FittedPlane, ...], ...]
    contradicted: int


def consistent_faces(
    tracked: TrackedFaces, planes: Sequence[Sequence[FittedPlane]], size: float
) -> ConsistentFaces:
    """Tracked faces without planes that contradict the uniform drift.

    Scans that lose one begin again where the drift leads.
    A plane that no other of its scan confirms moves the pose as far as its face is wrong, by a whole body, with a small covariance.

    Parameters
    ----------
    planes: of every scan, in the order of ``tracked.matches``.   size: of the body, m.
    """
    drift, unchanged = uniform_drift(tracked, size), tuple(map(tuple, planes))
    if not np.isfinite(drift.scatter):
        return ConsistentFaces(tracked, unchanged, 0)
    kept = [
        [
            _is_near(plane, tracked.faces[face], tracked.poses[k], drift, k, size)
            for plane, face in zip(seen, tracked.matches[k], strict=True)
        ]
        for k, seen in enumerate(planes)
    ]
    wrong = [k for k, each in enumerate(kept) if not all(each)]
    if not wrong or len(wrong) > MOST_CONTRADICTED * len(kept):
        return ConsistentFaces(tracked, unchanged, len(wrong))
    poses = list(tracked.poses)
    for k in wrong:
        poses[k] = replace(poses[k], translation=drift.place(k))
    matches = tuple(tuple(compress(match, each)) for match, each in zip(tracked.matches, kept, strict=True))
    left = tuple(tuple(compress(seen, each)) for seen, each in zip(planes, kept, strict=True))
    return ConsistentFaces(replace(tracked, poses=tuple(poses), matches=matches), left, len(wrong))


def _is_near(plane: FittedPlane, face: Face, pose: ScanPose, drift: Drift, number: int, size: float) -> bool:
    """Whether a plane lies where its face is, within what plane, attitude and drift leave open."""
    off = pose.rotation @ face.normal @ (plane.centroid - drift.place(number)) - face.offset
    tilt = size**2 * float(np.linalg.eigvalsh(pose.covariance[3:, 3:])[-1])
    return abs(off) < CONTRADICTION * np.sqrt(plane.covariance[2, 2] + tilt + drift.scatter**2)
