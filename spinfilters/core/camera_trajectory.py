"""Known trajectory of a camera in frame i: interpolated poses, changes of frame, and small displacements of the poses."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import (
    continuous_quaternions,
    inverse,
    matrix_from_quaternion,
    multiply,
    quaternion_from_rotation_vector,
    rotate,
    rotation_between,
)
from spinfilters.core.errors import InputError, ShapeError

FEWEST_DIFFERENCES: Final = 8
"""Second differences of poses with fewer of which noise cannot be distinguished from bends."""


class TimedPoses(Protocol):
    """Poses with their times, as a stream of measurements holds them."""

    @property
    def time(self) -> Float[np.ndarray, " n"]:
        """(n,) s."""
        ...

    @property
    def values(self) -> Float[np.ndarray, "n 7"]:
        """(n, 7) t_ic m and unit q_ic."""
        ...


@dataclass(frozen=True, eq=False)
class CameraTrajectory:
    """Poses (n, 7), t_ic m and unit q_ic, at strictly ascending ``time`` (n,) s.

    Raises
    ------
    ShapeError
        Arrays of other shapes.
    InputError
        Times that do not ascend, or what is not finite.
    """

    time: Float[np.ndarray, " n"]
    poses: Float[np.ndarray, "n 7"]

    def __post_init__(self) -> None:
        if self.poses.shape != (len(self.time), 7) or not len(self.time):
            raise ShapeError(
                f"{len(self.time)} times of camera poses of shape {self.poses.shape}; give (n, 7)"
            )
        if not (
            np.isfinite(self.poses).all() and np.isfinite(self.time).all() and (np.diff(self.time) > 0).all()
        ):
            raise InputError(
                "a camera's trajectory has finite poses at ascending times; leave out those that repeat"
            )

    @classmethod
    def of(cls, inspector: TimedPoses | None) -> "CameraTrajectory | None":
        """Trajectory of a data set's poses of cam0; None without any."""
        return None if inspector is None else cls(inspector.time, inspector.values)

    def at(self, time: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k 7"]:
        """Interpolated poses at other times.

        Positions are interpolated linearly, attitudes along the shorter rotation (slerp). At a listed time the listed
        pose is returned.

        Raises
        ------
        InputError
            A time before the first pose or after the last.
        """
        self.require_cover(time)
        if len(self.time) == 1:
            return np.tile(self.poses[0], (len(time), 1))
        # many rows share a stamp: interpolate once a stamp, between the listed pose before it and the next
        stamps, which = np.unique(time, return_inverse=True)
        before = np.clip(np.searchsorted(self.time, stamps, side="right") - 1, 0, len(self.time) - 2)
        start, end = self.poses[before], self.poses[before + 1]
        share = ((stamps - self.time[before]) / (self.time[before + 1] - self.time[before]))[:, None]
        # slerp: q = q_start exp(share log(q_start^-1 q_end))
        rotation = rotation_between(start[:, 3:], end[:, 3:])
        q = multiply(start[:, 3:], quaternion_from_rotation_vector(share * rotation))
        found = np.concatenate([start[:, :3] + share * (end[:, :3] - start[:, :3]), q], axis=1)
        found = np.where(share == 0, start, np.where(share == 1, end, found))
        return found[which.reshape(-1)]

    def interpolation_errors(
        self, time: Float[np.ndarray, " k"]
    ) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """Estimated errors of interpolated poses where the path bends between stamps: (k,) m and (k,) rad.

        At a share s between two poses h apart the error is s (1 - s) h^2 / 2 times the second derivative, the mean of
        the divided differences at both poses. It is zero at the stamps of the poses, and for fewer than three poses.
        The part of the differences that is noise of the poses is not a bend and is left out (`_share_of_bends`).

        Raises
        ------
        InputError
            A time before the first pose or after the last.
        """
        self.require_cover(time)
        if len(self.time) < 3:
            return np.zeros(len(time)), np.zeros(len(time))
        h = np.diff(self.time)
        q = self.poses[:, 3:]
        rates = np.concatenate(
            [
                np.diff(self.poses[:, :3], axis=0) / h[:, None],
                rotation_between(q[:-1], q[1:]) / h[:, None],
            ],
            axis=1,
        )
        inner = np.diff(rates, axis=0) * (2 / (h[:-1] + h[1:]))[:, None]
        inner[:, :3] *= np.sqrt(_share_of_bends(inner[:, :3]))
        inner[:, 3:] *= np.sqrt(_share_of_bends(inner[:, 3:]))
        bends = np.concatenate([inner[:1], inner, inner[-1:]])  # at every pose, of the ends that of the next
        before = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(h) - 1)
        share = (time - self.time[before]) / h[before]
        off = (share * (1 - share) * h[before] ** 2 / 2)[:, None] * (bends[before] + bends[before + 1]) / 2
        return np.linalg.norm(off[:, :3], axis=1), np.linalg.norm(off[:, 3:], axis=1)

    def require_cover(self, time: Float[np.ndarray, " k"]) -> None:
        """InputError: a time before the first pose or after the last."""
        first, last = float(np.min(time)), float(np.max(time))
        if first < self.time[0] or last > self.time[-1]:
            raise InputError(
                f"camera poses are known from {self.time[0]:.6f} s to {self.time[-1]:.6f} s and asked for from {first:.6f} s to "
                f"{last:.6f} s; give poses that cover the observations"
            )


def _share_of_bends(differences: Float[np.ndarray, "k 3"]) -> float:
    """Share of the squared second differences of poses that is due to bends of the path, not to white noise of the poses.

    For white noise the products of neighbouring differences average -2/3 of their squares. For bends that last longer
    than an interval they are positive. In between the share is linear in that ratio r: 1 + 3 r / 2.
    """
    square = float(np.mean(np.sum(differences**2, axis=1)))
    if len(differences) < FEWEST_DIFFERENCES or not square > 0:
        return 1.0
    product = float(np.mean(np.sum(differences[:-1] * differences[1:], axis=1)))
    return float(np.clip(1 + 1.5 * product / square, 0.0, 1.0))


def in_camera(
    poses: Float[np.ndarray, "k 7"], camera_poses: Float[np.ndarray, "k 7"]
) -> Float[np.ndarray, "k 7"]:
    """Poses (t, q) of g in the camera's frame, T_cg = T_ic^-1 T_ig."""
    q_ci = inverse(camera_poses[:, 3:])
    place = rotate(q_ci, poses[:, :3] - camera_poses[:, :3])
    return np.concatenate([place, multiply(q_ci, poses[:, 3:])], axis=1)


def in_inertial(
    poses: Float[np.ndarray, "k 7"], camera_poses: Float[np.ndarray, "k 7"]
) -> Float[np.ndarray, "k 7"]:
    """Poses (t, q) of g in i, T_ig = T_ic T_cg."""
    q_ic = camera_poses[:, 3:]
    place = camera_poses[:, :3] + rotate(q_ic, poses[:, :3])
    return np.concatenate([place, multiply(q_ic, poses[:, 3:])], axis=1)


Displacement = Callable[[Float[np.ndarray, " k"], Float[np.ndarray, "k 7"]], Float[np.ndarray, "k 6 m"]]
"""Displacements of poses at ascending times per unit of m errors: from times (k,) s and poses (k, 7)."""
MINUTE: Final = 60.0
"""In which a drift has its size, s."""


def displaced(poses: Float[np.ndarray, "k 7"], by: Float[np.ndarray, "k 6"]) -> Float[np.ndarray, "k 7"]:
    """Camera poses displaced by ``by``: positions in axes of i (m), then rotation vectors in axes of the camera (rad)."""
    turned = multiply(poses[:, 3:], quaternion_from_rotation_vector(by[:, 3:]))
    return np.concatenate([poses[:, :3] + by[:, :3], turned], axis=1)


def later(time: Float[np.ndarray, " k"], poses: Float[np.ndarray, "k 7"]) -> Float[np.ndarray, "k 6 1"]:
    """Displacement of camera poses per second of clock error: the camera's own velocity; zero for a single pose.

    Velocities are central differences of positions and attitudes; those at the ends are one-sided.
    """
    if len(time) < 2:
        return np.zeros((len(time), 6, 1))
    q = continuous_quaternions(poses[:, 3:])
    place = np.gradient(poses[:, :3], time, axis=0)
    # rotation since the pose before, by the mean of what leads to a pose and what leads from it
    turns = rotation_between(q[:-1], q[1:]) / np.diff(time)[:, None]
    rates = np.concatenate([turns[:1], (turns[:-1] + turns[1:]) / 2, turns[-1:]])
    return np.concatenate([place, rates], axis=1)[:, :, None]


def drifting(time: Float[np.ndarray, " k"], poses: Float[np.ndarray, "k 7"]) -> Float[np.ndarray, "k 6 3"]:
    """Displacement by positions that drift linearly from the first time on, per metre a minute along each axis of i."""
    found = np.zeros((len(time), 6, 3))
    found[:, :3] = _seconds_since_first(time)[:, None, None] * np.eye(3)
    return found


def turning(time: Float[np.ndarray, " k"], poses: Float[np.ndarray, "k 7"]) -> Float[np.ndarray, "k 6 3"]:
    """Displacement by attitudes that drift linearly from the first time on, per radian a minute about each axis of i."""
    found = np.zeros((len(time), 6, 3))
    to_camera = np.swapaxes(
        matrix_from_quaternion(poses[:, 3:]), 1, 2
    )  # a rotation about axes i in those of the camera
    found[:, 3:] = _seconds_since_first(time)[:, None, None] * to_camera
    return found


def levered(time: Float[np.ndarray, " k"], poses: Float[np.ndarray, "k 7"]) -> Float[np.ndarray, "k 6 3"]:
    """Displacement by a constant lever arm, per metre along each axis of the camera."""
    found = np.zeros((len(time), 6, 3))
    found[:, :3] = matrix_from_quaternion(poses[:, 3:])
    return found


def _seconds_since_first(time: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    return (time - time[:1]) / MINUTE  # of no time at all none
