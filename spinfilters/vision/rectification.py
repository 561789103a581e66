"""Rectified images of a raw rig (Tweddle 2013, section 2.8).

Lens distortion removed, both cameras turned until rows correspond.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from spinfilters.attitude.conversions import inverse, multiply, quaternion_from_matrix
from spinfilters.data.camera import PinholeCamera, StereoRig
from spinfilters.data.truth import Truth
from spinfilters.errors import InputError
from spinfilters.vision.raw_rig import RawRig

MODE = cv2.INTER_LINEAR
"""Of the interpolation: exact for a ramp of grey values. OpenCV's cubic one is not, and shifts features by up to 0.06 px."""


@dataclass(frozen=True, eq=False)
class Rectification:
    """Rectified pair of a raw rig by Bouguet's method.

    Each camera is turned by half the rotation between them.
    """

    rig: RawRig

    @cached_property
    def _solution(self) -> tuple[np.ndarray, ...]:
        left, right = self.rig.left, self.rig.right
        return cv2.stereoRectify(
            left.camera_matrix,
            left.distortion,
            right.camera_matrix,
            right.distortion,
            self.rig.size,
            self.rig.relative_rotation,
            self.rig.relative_position.reshape(3, 1),
            flags=cv2.CALIB_ZERO_DISPARITY,
            alpha=-1,
        )[:4]

    @property
    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """Raw left camera to rectified left camera."""
        return np.asarray(self._solution[0], dtype=float)

    @cached_property
    def stereo(self) -> StereoRig:
        """The rectified pair. InputError: cameras that are not side by side along x, left before right."""
        first, second = np.asarray(self._solution[2]), np.asarray(self._solution[3])
        baseline = -second[0, 3] / second[0, 0]
        if not baseline > 0 or second[1, 3]:
            raise InputError(
                "the cameras are not side by side with cam0 on the left; exchange them, or turn the images"
            )
        (fx, fy), (cx, cy), (width, height) = (
            np.diag(first)[:2].tolist(),
            first[:2, 2].tolist(),
            self.rig.size,
        )
        return StereoRig(PinholeCamera(fx, fy, cx, cy, width, height), float(baseline))

    @cached_property
    def _maps(self) -> list[tuple[np.ndarray, np.ndarray]]:
        cameras = (self.rig.left, self.rig.right)
        return [
            cv2.initUndistortRectifyMap(
                camera.camera_matrix, camera.distortion, turn, projection[:, :3], self.rig.size, cv2.CV_32FC1
            )
            for camera, turn, projection in zip(cameras, self._solution[:2], self._solution[2:], strict=True)
        ]

    def images(
        self, left: UInt8[np.ndarray, "h w"], right: UInt8[np.ndarray, "h w"]
    ) -> tuple[UInt8[np.ndarray, "h w"], UInt8[np.ndarray, "h w"]]:
        """Rectified images."""
        (map_left, map_right), mode = self._maps, MODE
        return cv2.remap(left, *map_left, mode), cv2.remap(right, *map_right, mode)

    def grey_at(
        self,
        camera: int,
        raw: Float[np.ndarray, "h w"],
        x: Float[np.ndarray, "..."],
        y: Float[np.ndarray, "..."],
    ) -> Float[np.ndarray, "..."]:
        """Grey values of a raw image at rectified columns and rows.

        Camera 0 is the left one; single precision.
        """
        across, down = (np.ascontiguousarray(each, dtype=np.float32).reshape(len(x), -1) for each in (x, y))
        column, row = (
            cv2.remap(each, across, down, MODE, borderMode=cv2.BORDER_REPLICATE)
            for each in self._maps[camera]
        )
        found = cv2.remap(raw, column, row, MODE, borderMode=cv2.BORDER_REPLICATE)
        return found.reshape(x.shape)

    def points(
        self, left: Float[np.ndarray, "n 2"], right: Float[np.ndarray, "n 2"]
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
        """Rectified pixels of raw ones."""
        cameras = (self.rig.left, self.rig.right)
        found = [
            cv2.undistortPoints(
                raw.reshape(-1, 1, 2), each.camera_matrix, each.distortion, R=turn, P=projection
            )
            for raw, each, turn, projection in zip(
                (left, right), cameras, self._solution[:2], self._solution[2:], strict=True
            )
        ]
        return found[0].reshape(-1, 2), found[1].reshape(-1, 2)

    def truth(self, truth: Truth) -> Truth:
        """The truth with the rectified left camera as frame i, not the raw one."""
        R = self.rotation
        return replace(
            truth,
            center_of_mass=truth.center_of_mass @ R.T,
            q_ig=multiply(quaternion_from_matrix(R), truth.q_ig),
            velocity=truth.velocity @ R.T,
            rate_i=truth.rate_i @ R.T,
        )

    def left_poses(self, poses: Float[np.ndarray, "n 7"]) -> Float[np.ndarray, "n 7"]:
        """Poses of the rectified left camera from those of the raw one.

        t (m), q.
        """
        turn = inverse(quaternion_from_matrix(self.rotation))
        q = multiply(poses[:, 3:], np.broadcast_to(turn, (len(poses), 4)))
        return np.concatenate([poses[:, :3], q], axis=1)
