"""Rectified stereo triangulation."""

import numpy as np
from jaxtyping import Float


def triangulate(
    pixels: Float[np.ndarray, "*batch 3"], calibration: Float[np.ndarray, " 5"]
) -> Float[np.ndarray, "*batch 3"]:
    """Points in the left camera frame, m, of rectified pixels (u_left, v_left, u_right).

    z = fx b / (u_left - u_right), x = (u_left - cx) z / fx, y = (v_left - cy) z / fy (Tweddle 2013, Eq. 2.92 with c_y corrected).

    Parameters
    ----------
    pixels: rectified pixels; a disparity of zero or less gives a point at infinity or behind the camera (not finite, or z < 0).
    calibration: (fx, fy, cx, cy, baseline), px and m.
    """
    fx, fy, cx, cy, baseline = calibration
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = fx * baseline / (pixels[..., 0] - pixels[..., 2])
        return np.stack(
            [(pixels[..., 0] - cx) * depth / fx, (pixels[..., 1] - cy) * depth / fy, depth],
            axis=-1,
        )
