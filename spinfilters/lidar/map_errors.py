"""What the common errors of a map of faces add to the covariance of poses that are found against it.

The faces are found from the same scans as the poses. Their errors move every pose that sees them alike, so that a mean over many
poses does not take them out: e_k = own error + A_k (error of the faces). Estimators take poses as independent. A pose is
therefore given the covariance P_k + n_k A_k M A_k', with M of the faces and n_k the number of poses that share its part of the
error: the mean of N such poses then has the covariance that it truly has, and does not shrink below that of the map.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from spinfilters.lidar.face_tracking import (
    FEWEST_FOR_DRIFT,
    TrackedFaces,
    face_jacobian,
    residual_and_jacobian,
)
from spinfilters.lidar.planes import FittedPlane
from spinfilters.lidar.scan_pose import ROTATION_PRIOR, ScanPose, body_side, skew


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Information of one scan over its pose (6: rotation in L, translation) and the faces (3 each).

    Attributes
    ----------
    own: (6, 6) with the prior of a predicted pose.   cross: (6, 3 F).   faces: (3 F, 3 F).
    """

    own: Float[np.ndarray, "6 6"]
    cross: Float[np.ndarray, "6 f"]
    faces: Float[np.ndarray, "f f"]


def poses_with_map_errors(
    tracked: TrackedFaces, planes: Sequence[Sequence[FittedPlane]], size: float
) -> tuple[ScanPose, ...]:
    """The poses with the covariance that they have as measurements of independent errors.

    Parameters
    ----------
    planes: of every scan, in the order of ``tracked.matches``.   size: of the body, m.
    """
    blocks = [_blocks(tracked, k, seen, size) for k, seen in enumerate(planes)]
    M = faces_covariance(tracked, blocks, size)
    arms = [
        body_side(-np.linalg.solve(each.own, each.cross), pose.rotation)
        for each, pose in zip(blocks, tracked.poses, strict=True)
    ]
    whitened = [
        np.linalg.solve(np.linalg.cholesky(p.covariance), A) for p, A in zip(tracked.poses, arms, strict=True)
    ]
    poses = []
    for pose, A, white in zip(tracked.poses, arms, whitened, strict=True):
        shared = [float(np.linalg.norm(white @ M @ other.T)) for other in whitened]
        own = float(np.linalg.norm(white @ M @ white.T))
        count = sum(shared) / own if own > 0 else 0.0
        poses.append(replace(pose, covariance=pose.covariance + count * A @ M @ A.T))
    return tuple(poses)


def faces_covariance(
    tracked: TrackedFaces, blocks: Sequence[_Blocks], size: float
) -> Float[np.ndarray, "f f"]:
    """Covariance of the faces (two tangent components of the normal, offset m; each), the poses left free.

    With `FEWEST_FOR_DRIFT` scans the translations are those of a uniform drift, as the faces were fitted. Directions in which the
    frame g itself is free have none.
    """
    count = 3 * len(tracked.faces)
    drifts = len(blocks) >= FEWEST_FOR_DRIFT
    S = np.zeros((count + 6, count + 6)) if drifts else np.zeros((count, count))
    start, span = tracked.poses[0].time, tracked.poses[-1].time - tracked.poses[0].time
    for each, pose in zip(blocks, tracked.poses, strict=True):
        free = slice(0, 3) if drifts else slice(0, 6)
        rest, cross = each.faces, each.cross[free]
        if drifts:
            along = np.hstack([np.eye(3), np.eye(3) * (pose.time - start) / span])
            both = along.T @ each.cross[3:]
            rest = np.block([[each.faces, both.T], [both, along.T @ each.own[3:, 3:] @ along]])
            cross = np.hstack([cross, each.own[:3, 3:] @ along])
        S += rest - cross.T @ np.linalg.solve(each.own[free, free], cross)
    scale = np.tile([1.0, 1.0, size], len(tracked.faces))
    scale = np.concatenate([scale, np.full(len(S) - count, size)])
    gauge = np.zeros((len(S), 3 if drifts else 6))
    gauge[:count] = _freedom(tracked)[:, : gauge.shape[1]]
    kept = np.linalg.svd(gauge / scale[:, None])[0][:, gauge.shape[1] :] * scale[:, None]
    return (kept @ np.linalg.solve(kept.T @ S @ kept, kept.T))[:count, :count]


def _freedom(tracked: TrackedFaces) -> Float[np.ndarray, "f 6"]:
    """How the faces change when the frame g is rotated, and when it is shifted."""
    return np.concatenate(
        [
            np.block(
                [
                    [face.tangents.T @ -skew(face.normal), np.zeros((2, 3))],
                    [np.zeros((1, 3)), face.normal[None]],
                ]
            )
            for face in tracked.faces
        ]
    )


def _blocks(tracked: TrackedFaces, number: int, seen: Sequence[FittedPlane], size: float) -> _Blocks:
    pose, count = tracked.poses[number], 3 * len(tracked.faces)
    own = np.diag(np.repeat([ROTATION_PRIOR, size], 3) ** -2.0)
    cross, faces = np.zeros((6, count)), np.zeros((count, count))
    for plane, k in zip(seen, tracked.matches[number], strict=True):
        at = slice(3 * k, 3 * k + 3)
        _, J = residual_and_jacobian(plane, tracked.faces[k], pose.rotation, pose.translation)
        F = face_jacobian(plane, tracked.faces[k], pose.rotation, pose.translation)
        W = np.linalg.inv(plane.covariance + 1e-30 * np.eye(3))
        own, faces[at, at] = own + J.T @ W @ J, faces[at, at] + F.T @ W @ F
        cross[:, at] += J.T @ W @ F
    return _Blocks(own, cross, faces)
