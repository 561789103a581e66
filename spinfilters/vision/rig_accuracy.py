"""How well a stereo rig can triangulate, before it is built (Tweddle 2013, section 5.3)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.data.camera import StereoRig
from spinfilters.geometry.cameras import stereo_pair
from spinfilters.vision.stereo_geometry import pixels_by_point, pixels_of


@dataclass(frozen=True)
class RigAccuracy:
    """Accuracy of a point half-way between the cameras' axes.

    Attributes
    ----------
    by_column, by_row: (3,) how far one pixel in the left column, or in both rows, moves the triangulated point, m.
    std: (3,) of its coordinates with white noise on (u_left, v_left, u_right), m.
    nearest: distance at which both cameras begin to see it, m (Eq. 5.2).   farthest: where its disparity is one pixel, m.
    """

    by_column: Float[np.ndarray, " 3"]
    by_row: Float[np.ndarray, " 3"]
    std: Float[np.ndarray, " 3"]
    nearest: float
    farthest: float


def rig_accuracy(rig: StereoRig, distance: float, pixel_std: float) -> RigAccuracy:
    """Accuracy at a distance, m, with so much noise of each pixel coordinate."""
    point = np.array([[rig.baseline_m / 2, 0.0, distance]])
    pixels = pixels_of(point, rig)
    moved = [
        stereo_pair(rig.calibration).points_of(pixels + step, rig.calibration)[0] - point[0]
        for step in ([1.0, 0, 0], [0, 1.0, 0])
    ]
    inverse = np.linalg.inv(pixels_by_point(point, rig)[0])
    std = pixel_std * np.sqrt(np.diag(inverse @ inverse.T))
    half_angle = np.arctan(rig.left.width / 2 / rig.left.fx)
    return RigAccuracy(
        moved[0],
        moved[1],
        std,
        float(rig.baseline_m / 2 / np.tan(half_angle)),
        float(rig.baseline_m * rig.left.fx),
    )
