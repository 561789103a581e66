"""Right-hand sides of errors of a camera's known trajectory about a smoothed motion.

A camera that stands displaced sees the body displaced the other way: with the camera's pose (t_ic, R_ic), displaced by d (axes i)
and turned by phi (its own axes), a point of the body at p_i is seen where one displaced by -d - R_ic phi x (p_i - t_ic) would be,
which is a displacement of the body's pose. So the rows' own derivatives by the pose tell those by the camera's.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.attitude.conversions import matrix_from_quaternion
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import MeasuredRows, SmoothedMotion
from spinfilters.geometry.camera_displacements import Displacement
from spinfilters.state.blocks.rigid_body import ATTITUDE, POSITION


@dataclass(frozen=True)
class KnownCamera:
    """Known poses of the camera at the epochs in which it sees landmarks.

    Attributes
    ----------
    seen : (k,)
        Whether it has measurements in an epoch.
    poses : (k, 7)
        t_ic m and q_ic, the identity of a camera at rest and where it sees nothing.
    moves : bool
        Whether a trajectory is given (`inspector.tum`).
    """

    seen: Bool[np.ndarray, " k"]
    poses: Float[np.ndarray, "k 7"]
    moves: bool

    @classmethod
    def of(cls, motion: SmoothedMotion) -> "KnownCamera | None":
        """The camera of a motion; None where none sees it in two epochs, or nothing tells the place."""
        rows = [each for each in motion.measured if _is_of_camera(each)]
        if not rows or not motion.translates:
            return None
        seen, poses = np.zeros(len(motion.time), dtype=bool), np.zeros((len(motion.time), 7))
        poses[:, 6] = 1.0
        moves = False
        for each in rows:
            seen[each.epoch] = True
            if each.model.known_pose is not None:
                moves = True
                poses[each.epoch] = each.parameters[:, each.model.known_pose]
        return cls(seen, poses, moves) if np.count_nonzero(seen) > 1 else None


def displaced_camera(motion: SmoothedMotion, by: Displacement, camera: KnownCamera) -> Columns:
    """Right-hand sides of a camera that stands displaced from its known poses, per unit of m errors."""
    layout, ordering = motion.rows.problem.layout, motion.rows.problem.ordering
    own = by(motion.time[camera.seen], camera.poses[camera.seen])
    moved = np.zeros((len(motion.time), 6, own.shape[2]))
    moved[camera.seen] = own
    R_ic = matrix_from_quaternion(camera.poses[:, 3:])
    R_ig = matrix_from_quaternion(motion.block(ATTITUDE.name))
    away = motion.block(POSITION.name) - camera.poses[:, :3]
    turned = R_ic @ moved[:, 3:]  # axes i
    states = np.zeros((len(motion.time), layout.error_dim, own.shape[2]))
    states[:, layout.slice(POSITION.name)] = -moved[:, :3] - np.cross(turned, away[:, :, None], axis=1)
    states[:, layout.slice(ATTITUDE.name)] = -np.swapaxes(R_ig, 1, 2) @ turned
    found = motion.rows.seen(states[:, ordering.order])
    for each in motion.measured:  # what stands beside the camera is not displaced with it
        if each.sensor is not None and not _is_of_camera(each):
            found.sensors[each.sensor][:] = 0.0
    return replace(found, is_measured=True)


def _is_of_camera(each: MeasuredRows) -> bool:
    return each.model.images > 0
