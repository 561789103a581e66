"""Calibration of one camera from views of a board (Zhang 2000)."""

from dataclasses import dataclass
from typing import Final, NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.vision.calibration_images import Board, BoardView

PARAMETERS: Final[tuple[str, ...]] = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
ITERATIONS: Final = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-9)


@dataclass(frozen=True)
class CameraCalibration:
    """Calibration of one camera.

    Attributes
    ----------
    K, distortion: found.   std: standard deviation of `PARAMETERS`, NaN before the covariance of the pair is known.   rms: px.
    view_errors: (v,) rms of each view, px.   poses: of the board in the camera, rotation vector and place, (v, 6).
    """

    K: Float[np.ndarray, "3 3"]
    distortion: Float[np.ndarray, " 5"]
    std: dict[str, float]
    rms: float
    view_errors: Float[np.ndarray, " v"]
    poses: Float[np.ndarray, "v 6"]

    @property
    def focal_std(self) -> float:
        """Standard deviation of the focal length relative to it, the larger of both axes."""
        return max(self.std["fx"] / float(self.K[0, 0]), self.std["fy"] / float(self.K[1, 1]))


class CameraPair(NamedTuple):
    """Calibrations of both cameras, each by itself."""

    left: CameraCalibration
    right: CameraCalibration


class RelativePose(NamedTuple):
    """Pose of the left camera in the right one: rotation vector, and place, m."""

    turn: Float[np.ndarray, " 3"]
    place: Float[np.ndarray, " 3"]


def calibrated_camera(
    views: list[BoardView], board: Board, size: tuple[int, int], right: bool
) -> CameraCalibration:
    """Intrinsics of one camera of the pair; deviations come from `calibration_covariance`.

    Those of OpenCV count every corner as independent and drop directions that the views leave free.

    Raises
    ------
    InputError: no camera explains the views.
    """
    points = [board.points[view.seen].astype(np.float32) for view in views]
    pixels = [(view.right if right else view.left)[view.seen].astype(np.float32) for view in views]
    try:
        rms, K, distortion, turns, places, _, _, errors = cv2.calibrateCameraExtended(
            points, pixels, size, np.eye(3), np.zeros(5), criteria=ITERATIONS
        )
    except cv2.error:
        raise InputError(
            "the views do not determine the focal length: no camera explains them; move the board and tilt it by 20 to 45 degrees "
            "between the images, and check --corners"
        ) from None
    poses = np.column_stack([np.reshape(turns, (-1, 3)), np.reshape(places, (-1, 3))])
    return CameraCalibration(
        np.asarray(K),
        np.asarray(distortion).ravel()[:5],
        dict.fromkeys(PARAMETERS, float("nan")),
        float(rms),
        np.asarray(errors).ravel(),
        poses,
    )
