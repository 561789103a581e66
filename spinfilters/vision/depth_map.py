"""Disparity of rectified pairs by semi-global matching (Hirschmueller 2008), checked from both sides, and the depth maps of it.

Semi-global matching gives the disparity to a pixel; least squares on the grey values of a window refine it
(Lucas and Kanade 1981, along the row, mean removed):

    delta = -sum(g e) / sum(g^2),    var(delta) = var(e) / sum(g^2),    z = f b / d,    std(z) = z^2 / (f b) std(d)

with e = left - right(u - d), g the mean gradient of both images along the row, sums over the window.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from spinfilters.io.camera import StereoRig

BLOCK: Final = 3
SPECKLE_PX: Final = 100
LARGEST_DIFFERENCE_PX: Final = 2.0
"""Between the disparity from the left and from the right."""


def disparity_map(
    left: UInt8[np.ndarray, "h w"], right: UInt8[np.ndarray, "h w"], largest: int, smallest: int = 0
) -> Float[np.ndarray, "h w"]:
    """Disparity u_left - u_right of each pixel of the left image, px; NaN where none is found.

    Parameters
    ----------
    smallest, largest : int
        Disparities that are looked for, px; the range is widened to a multiple of 16.
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
    return _match_disparities(matcher, left, right, count, smallest)


def _match_disparities(
    matcher: cv2.StereoMatcher,
    left: UInt8[np.ndarray, "h w"],
    right: UInt8[np.ndarray, "h w"],
    count: int,
    smallest: int,
) -> Float[np.ndarray, "h w"]:
    """Disparities of a matcher that looks for so many, px; columns left of the images let it look for large ones at the rim."""
    padded = [cv2.copyMakeBorder(image, 0, 0, count, 0, cv2.BORDER_REPLICATE) for image in (left, right)]
    found = matcher.compute(*padded)[:, count:].astype(float) / 16
    found[found < smallest] = np.nan
    return found


LOCAL_BLOCK: Final = 15
"""Side of a block of local matching, px."""


def local_disparity_map(
    left: UInt8[np.ndarray, "h w"], right: UInt8[np.ndarray, "h w"], largest: int
) -> Float[np.ndarray, "h w"]:
    """Disparity by local matching of blocks (sums of absolute differences), px; NaN where none is found.

    Parameters
    ----------
    left, right : ndarray of uint8, shape (h, w)
        Rectified pair.
    largest : int
        Disparity up to which is looked, px; widened to a multiple of 16.
    """
    count = -(-(largest + 1) // 16) * 16
    matcher = cv2.StereoBM.create(numDisparities=count, blockSize=LOCAL_BLOCK)
    return _match_disparities(matcher, left, right, count, 0)


LEAST_CONTRAST: Final = 4.0
"""Standard deviation of the grey values around a pixel from which it has texture; below are noise and what is evenly lit."""


def textured_pixels(image: UInt8[np.ndarray, "h w"], window: int = LOCAL_BLOCK) -> Bool[np.ndarray, "h w"]:
    """Pixels around which grey values differ by more than `LEAST_CONTRAST`: elsewhere a disparity is a guess.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w)
        Grey values.
    window : int
        Side of the window, px.
    """
    grey = image.astype(float)
    mean, square = (cv2.blur(each, (window, window)) for each in (grey, grey * grey))
    return np.asarray(square - mean * mean > LEAST_CONTRAST**2)


WINDOW: Final = 7
"""Rows and columns of the window, px."""
ITERATIONS: Final = 3
LARGEST_STEP_PX: Final = 0.5
LARGEST_CHANGE_PX: Final = 1.5
"""Of a disparity by the refinement, beyond which it has left the match."""
LEAST_CORRELATION: Final = 0.8
"""Of both windows; background, which is noise, has less."""
LEAST_STD_PX: Final = 0.1
"""Of a disparity: interpolation, rectification and poses leave as much."""
NEIGHBOURS: Final = 2.0
"""Factor on the standard deviation: neighbours are refined too, which makes residuals smaller and errors larger (measured on a
textured wall with noise of 3 and 6 grey values: 2.05)."""
RIM_PX: Final = WINDOW // 2
"""Around pixels without depth that is left out: so far beyond an outline, windows still correlate by the surface within it."""

Grey = Float[np.ndarray, "h w"]
Sphere = tuple[Float[np.ndarray, " 3"], float]
"""Centre in the camera frame and radius, m."""


@dataclass(frozen=True)
class DepthMap:
    """Depth of the pixels of a part of the left image.

    Attributes
    ----------
    corner : tuple[int, int]
        Column and row of its first pixel.
    depth, std : Grey
        (h, w) m, NaN where there is none.
    grey : ndarray of shape (h, w)
        Of the image, 0..255.
    """

    corner: tuple[int, int]
    depth: Grey
    std: Grey
    grey: UInt8[np.ndarray, "h w"]

    @property
    def count(self) -> int:
        """Pixels with depth."""
        return int(np.count_nonzero(np.isfinite(self.depth)))


def depth_map(
    left: UInt8[np.ndarray, "h w"], right: UInt8[np.ndarray, "h w"], rig: StereoRig, within: Sphere
) -> DepthMap | None:
    """Depth of what lies within a sphere; None where that is not before both cameras."""
    centre, radius = within
    nearest, farthest = centre[2] - radius, centre[2] + radius
    box = _image_box(rig, centre, radius)
    if nearest < radius / 10 or box is None:
        return None
    first, last, top, bottom = box
    strength = rig.left.fx * rig.baseline_m
    smallest, largest = int(strength / farthest), int(np.ceil(strength / nearest))
    begin = max(first - largest, 0)
    left, right = (np.ascontiguousarray(image[top:bottom, begin:last]) for image in (left, right))
    matched = disparity_map(left, right, largest, smallest)
    refined, std = refined_disparity(left.astype(np.float32), right.astype(np.float32), matched)
    part = slice(None), slice(first - begin, None)
    refined, std, grey = refined[part], std[part], left[part]
    depth = strength / refined
    depth[(depth < nearest) | (depth > farthest)] = np.nan
    return DepthMap((first, top), depth, depth**2 / strength * std, grey)


def refined_disparity(
    left: Float[np.ndarray, "h w"], right: Float[np.ndarray, "h w"], disparity: Grey
) -> tuple[Grey, Grey]:
    """Subpixel disparity and its standard deviation, px; NaN where the windows do not correspond."""
    found = np.isfinite(disparity)
    start = np.where(found, disparity, 0.0).astype(np.float32)
    columns, rows = np.meshgrid(
        np.arange(left.shape[1], dtype=np.float32), np.arange(left.shape[0], dtype=np.float32)
    )
    gradients, current = [_gradient(image) for image in (left, right)], start.copy()
    for _ in range(ITERATIONS):
        window = _Window(left, gradients, right, columns - current, rows)
        current += np.clip(window.step, -LARGEST_STEP_PX, LARGEST_STEP_PX)
    window = _Window(left, gradients, right, columns - current, rows)
    good = found & (np.abs(current - start) <= LARGEST_CHANGE_PX) & (window.correlation >= LEAST_CORRELATION)
    good &= _erode_rim(good)
    std = np.maximum(window.std, LEAST_STD_PX)
    return np.where(good, current, np.nan).astype(float), np.where(good, std, np.nan).astype(float)


def _erode_rim(good: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels farther than a rim from what has no depth; single pixels without are no outline."""
    square = np.ones((2 * RIM_PX + 1,) * 2, np.uint8)
    return cv2.erode(cv2.morphologyEx(good.astype(np.uint8), cv2.MORPH_CLOSE, square), square) > 0


class _Window:
    """Sums over each pixel's window, with the right image sampled at the given columns and rows.

    Attributes
    ----------
    step
        Of the disparity towards the least squares, px.
    std
        Of the disparity, px.
    correlation
        Of both windows.
    """

    def __init__(
        self,
        left: np.ndarray,
        gradients: list[np.ndarray],
        right: np.ndarray,
        columns: np.ndarray,
        rows: np.ndarray,
    ) -> None:
        warped = cv2.remap(right, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        slope = (gradients[0] + cv2.remap(gradients[1], columns, rows, cv2.INTER_LINEAR)) / 2
        error = left - warped
        squares = np.maximum(_covariance(slope, slope), 1e-6)
        self.step = -_covariance(slope, error) / squares
        spread = np.maximum(_covariance(left, left) * _covariance(warped, warped), 1e-6)
        self.correlation = _covariance(left, warped) / np.sqrt(spread)
        self.std = np.sqrt(np.maximum(_covariance(error, error), 1.0) / squares) * NEIGHBOURS / WINDOW


def _covariance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Mean over the window of the product of two images less their means."""
    size = (WINDOW, WINDOW)
    return cv2.blur(a * b, size) - cv2.blur(a, size) * cv2.blur(b, size)


def _gradient(image: np.ndarray) -> np.ndarray:
    """Derivative along the row, per px."""
    return cv2.filter2D(image, cv2.CV_32F, np.array([[-0.5, 0.0, 0.5]], dtype=np.float32))


def _image_box(
    rig: StereoRig, centre: Float[np.ndarray, " 3"], radius: float
) -> tuple[int, int, int, int] | None:
    """Bounding box of a sphere in the left image, in pixels.

    First and last column and row (the last ones excluded); None where it is not in it.
    """
    near = max(centre[2] - radius, 1e-6)
    focal, middle, size = (
        np.array([rig.left.fx, rig.left.fy]),
        np.array([rig.left.cx, rig.left.cy]),
        np.array([rig.left.width, rig.left.height]),
    )
    across = middle + focal * centre[:2] / max(centre[2], near)
    reach = focal * radius / near + 2
    low = np.clip(np.floor(across - reach), 0, size).astype(int)
    high = np.clip(np.ceil(across + reach), 0, size).astype(int)
    if ((high - low) < WINDOW).any():
        return None
    return int(low[0]), int(high[0]), int(low[1]), int(high[1])
