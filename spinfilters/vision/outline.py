"""Points whose patches hold the outline of the body.

What an outline hides from one camera the other sees: 9 cm beside it at 0.6 m, both see another edge of a round body. A patch
that holds the outline is aligned with neither surface, and its disparity is too small: by 0.06 px within 3 px of it, by 0.3 px in
images with a blur 5 px wide (rendered spheres). Errors of that sign at all outlines are those of another focal length.
"""

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

MARGIN_PX: Final = 7.0
"""From the background: a patch's half width, and what a moderate blur spreads over."""
SPREADS: Final = 4.0
LEAST_DIFFERENCE, LARGEST_SPREAD = 3.0, 6.0
"""Grey values: by which the body differs from the background at least, and what an even background spreads at most."""
LARGEST_SHARE: Final = 0.5
"""Of the points: more near what is even, and that is the body itself, or it is too small for a margin."""

Image = UInt8[np.ndarray, "h w"]


def clear_of_outline(
    images: Sequence[Image], values: Float[np.ndarray, "n 3"], margin: float = MARGIN_PX
) -> Bool[np.ndarray, " n"]:
    """Whether points (u_left, v_left, u_right) keep a margin, px, from the background in both images."""
    clear = np.ones(len(values), dtype=bool)
    for image, columns in zip(images, ([0, 1], [2, 1]), strict=True):
        column, row = np.clip(np.rint(values[:, columns]).astype(int), 0, np.array(image.shape[::-1]) - 1).T
        clear &= background_distance(image)[row, column] >= margin
    return clear if np.count_nonzero(~clear) <= LARGEST_SHARE * len(clear) else np.ones_like(clear)


def background_distance(image: Image) -> Float[np.ndarray, "h w"]:
    """Distance of each pixel to the even background that reaches the border, px; infinite without one."""
    border = np.zeros(image.shape, dtype=bool)
    border[[0, -1]], border[:, [0, -1]] = True, True
    level = float(np.median(image[border]))
    spread = 1.4826 * float(np.median(np.abs(image[border] - level)))
    if spread > LARGEST_SPREAD:
        return np.full(image.shape, np.inf)
    difference = np.abs(cv2.medianBlur(image, 3) - level)
    even = (difference <= max(LEAST_DIFFERENCE, SPREADS * spread)).astype(np.uint8)
    count, labelled = cv2.connectedComponents(even)
    labels, reached = np.asarray(labelled, dtype=np.int64), np.zeros(count, dtype=bool)
    reached[labels[border]] = True
    reached[0] = False  # what is not even
    if not reached.any():
        return np.full(image.shape, np.inf)
    return cv2.distanceTransform((~reached[labels]).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
