"""Disparity of points by least squares on raw image patches (Gruen 1985).

On the grey values of small patches.
A plane's disparity is linear over the image, so a patch of the right image is that of the left one under

    u_right = u_left - d + a (u - u_left) + b (v - v_left),

with d, a and b such that the weighted squares of T - g I - o are least: T and I grey values of left and right, g and o gain and
offset. A shift alone has an error of a tenth of a pixel where the surface is steep: which part of the patch has most texture
decides. Grey values come from the raw images, at the places that rectification tells: interpolating twice, first onto the grid of
rectified pixels, moves texture by a hundredth of a pixel, by the same one wherever the map has the same fraction.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, UInt8

from spinfilters.vision.rectification import Rectification

HALF: Final = 5
"""Half width of a patch, px."""
SPREAD_PX: Final = 2.5
"""Standard deviation of the weights over the patch: what lies beyond an edge of the body is at another depth."""
ITERATIONS: Final = 8
SETTLED_PX: Final = 2e-3
LARGEST_STEP_PX: Final = 1.0
LARGEST_CHANGE_PX: Final = 2.0
"""Of the disparity, beyond which the patch has left its counterpart."""
LARGEST_SLOPE: Final = 0.6
"""Of the disparity by the place; more is foreshortened beyond recognition."""
DAMPING: Final = (1e-3, 2.0, 2.0)
"""Squared grey values per px that are added to the information, so that a patch without texture has a solution."""

Patches = Float[np.ndarray, "n m"]


@dataclass(frozen=True)
class PatchAlignment:
    """Disparities of n points.

    Attributes
    ----------
    disparity: (n,) px.   residual: (n,) of the grey values after alignment over their contrast, 0..1.   found: (n,).
    """

    disparity: Float[np.ndarray, " n"]
    residual: Float[np.ndarray, " n"]
    found: Bool[np.ndarray, " n"]


def aligned_patches(
    rectification: Rectification,
    left: UInt8[np.ndarray, "h w"],
    right: UInt8[np.ndarray, "h w"],
    pixels: Float[np.ndarray, "n 2"],
    start: Float[np.ndarray, " n"],
) -> PatchAlignment:
    """Disparities of rectified pixels of the left raw image, from a start, px."""
    if not len(pixels):
        return PatchAlignment(start, np.zeros(0), np.zeros(0, dtype=bool))
    views = [
        _View(rectification, camera, image.astype(np.float32)) for camera, image in enumerate((left, right))
    ]
    template, slope = views[0].patches(pixels, np.zeros((len(pixels), 3)))
    shape = np.stack([-start, np.zeros(len(pixels)), np.zeros(len(pixels))], axis=1)
    moving = np.arange(len(pixels))
    for _ in range(ITERATIONS):
        fit = _Fit.of(template[moving], slope[moving], *views[1].patches(pixels[moving], shape[moving]))
        step = fit.step
        shape[moving] += step
        moving = moving[np.abs(step[:, 0]) > SETTLED_PX]
        if not len(moving):
            break
    residual = _Fit.of(template, slope, *views[1].patches(pixels, shape)).residual
    change = np.abs(-shape[:, 0] - start)
    found = (change <= LARGEST_CHANGE_PX) & (np.abs(shape[:, 1:]) <= LARGEST_SLOPE).all(axis=1)
    return PatchAlignment(-shape[:, 0], residual, found & np.isfinite(residual))


_ALONG = np.arange(-HALF - 1, HALF + 2, dtype=float)
_X, _Y = (grid[None] for grid in np.meshgrid(_ALONG, _ALONG[1:-1]))
"""Places of a patch about its middle, a column wider on both sides than what is compared, for the derivative."""
_BASIS = np.stack([np.ones_like(_X), _X, _Y], axis=3)[0, :, 1:-1].reshape(-1, 3).astype(np.float32)
_WEIGHT = np.exp(-(_BASIS[:, 1] ** 2 + _BASIS[:, 2] ** 2) / (2 * SPREAD_PX**2))
_WEIGHT = (_WEIGHT / _WEIGHT.sum()).astype(np.float32)


@dataclass(frozen=True)
class _View:
    """Grey values of one raw image at rectified places."""

    rectification: Rectification
    camera: int
    image: Float[np.ndarray, "h w"]

    def patches(
        self, pixels: Float[np.ndarray, "n 2"], shape: Float[np.ndarray, "n 3"]
    ) -> tuple[Patches, Patches]:
        """Grey values of shifted, sheared patches and derivatives along the row."""
        shift, along, across = (shape[:, k, None, None] for k in range(3))
        x = pixels[:, 0, None, None] + _X + shift + along * _X + across * _Y
        y = np.broadcast_to(pixels[:, 1, None, None] + _Y, x.shape)
        grey = self.rectification.grey_at(self.camera, self.image, x, y)
        slope = (grey[:, :, 2:] - grey[:, :, :-2]) / (2 * (1 + along)).astype(np.float32)
        return grey[:, :, 1:-1].reshape(len(pixels), -1), slope.reshape(len(pixels), -1)


@dataclass(frozen=True)
class _Fit:
    """Least squares of a step, gain and offset eliminated.

    Attributes
    ----------
    step: (n, 3) of shift and slopes.   residual: (n,) over the contrast of the left patch.
    """

    step: Float[np.ndarray, "n 3"]
    residual: Float[np.ndarray, " n"]

    @classmethod
    def of(cls, template: Patches, slope: Patches, grey: Patches, own_slope: Patches) -> "_Fit":
        """Damped Gauss-Newton step of each template to its right patch, with its residual."""
        T, own = _centred(template), _centred(grey)
        power = np.maximum((own * own) @ _WEIGHT, 1e-6)
        gain = np.clip((T * own) @ _WEIGHT / power, 0.5, 2.0)[:, None]
        error = T - gain * own
        J = _centred(((gain * own_slope + slope) / 2)[..., None] * _BASIS)
        weighted = np.swapaxes(J * _WEIGHT[:, None], 1, 2)
        information = (weighted @ J).astype(float) + np.diag(DAMPING)
        step = np.linalg.solve(information, weighted @ error[..., None])[..., 0]
        step[:, 0] = np.clip(step[:, 0], -LARGEST_STEP_PX, LARGEST_STEP_PX)
        contrast = np.sqrt((T * T) @ _WEIGHT)
        return cls(step, np.sqrt((error * error) @ _WEIGHT) / np.maximum(contrast, 1.0))


def _centred(values: np.ndarray) -> np.ndarray:
    """Without the weighted mean of each patch."""
    return values - np.tensordot(values, _WEIGHT, axes=(1, 0))[:, None]
