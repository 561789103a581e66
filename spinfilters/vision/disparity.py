"""Dense disparity of a rectified pair by semi-global matching (Hirschmueller 2008), checked from both sides."""

from typing import Final

import cv2
import numpy as np
from jaxtyping import Float, UInt8

BLOCK: Final = 3
SPECKLE_PX: Final = 100
LARGEST_DIFFERENCE_PX: Final = 2.0
"""Between the disparity from the left and from the right."""


def disparity_map(
    left: UInt8[np.ndarray, "h w"], right: UInt8[np.ndarray, "h w"], largest: int, smallest: int = 0
) -> Float[np.ndarray, "h w"]:
    """Disparity u_left - u_right of each pixel of the left image, px.

    NaN where none is found.

    Parameters
    ----------
    smallest, largest: disparities that are looked for, px; the range is widened to a multiple of 16.
    """
    count = -(-(largest - smallest + 1) // 16) * 16
    area = BLOCK * BLOCK
    matcher = cv2.StereoSGBM.create(
        minDisparity=smallest,
        numDisparities=count,
        blockSize=BLOCK,
        P1=8 * area,
        P2=32 * area,
        disp12MaxDiff=int(LARGEST_DIFFERENCE_PX),
        uniquenessRatio=0,
        speckleWindowSize=SPECKLE_PX,
        speckleRange=2,
        mode=cv2.STEREO_SGBM_MODE_HH,
    )
    # columns left of the image let the matcher look for large disparities at its rim
    padded = [cv2.copyMakeBorder(image, 0, 0, count, 0, cv2.BORDER_REPLICATE) for image in (left, right)]
    found = matcher.compute(*padded)[:, count:].astype(float) / 16
    found[found < smallest] = np.nan
    return found
