"""Imaging by lens and sensor: distortion, blur, exposure, noise, stars."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from spinfilters.vision.raw_rig import RawCamera

WHITE = 255.0


@dataclass(frozen=True)
class Imaging:
    """Properties of both cameras.

    Attributes
    ----------
    exposure: grey value over 255 of radiance 1.   blur_px: standard deviation of the point spread.
    read_noise: grey values.   full_well: electrons at 255; their number is a Poisson number.   stars: in a field of view.
    oversampling: samples of a pixel along each axis.
    """

    exposure: float = 0.85
    blur_px: float = 0.5
    read_noise: float = 1.0
    full_well: float = 10_000.0
    stars: int = 40
    oversampling: int = 2


def ideal_matrix(camera: RawCamera, oversampling: int, margin: int) -> Float[np.ndarray, "3 3"]:
    """K of the oversampled ideal image, ``margin`` px larger on all sides.

    Without distortion; pixel centres are whole numbers.
    """
    K = camera.camera_matrix * oversampling
    K[:2, 2] = (camera.camera_matrix[:2, 2] + margin + 0.5) * oversampling - 0.5
    K[2, 2] = 1.0
    return K


def photograph(
    radiance: Float[np.ndarray, "h w"],
    camera: RawCamera,
    margin: int,
    imaging: Imaging,
    generator: np.random.Generator,
) -> UInt8[np.ndarray, "r c"]:
    """Raw image of oversampled radiance with a margin (`ideal_matrix`)."""
    ratio = imaging.oversampling
    image = cv2.remap(radiance.astype(np.float32), *_sample_places(camera, ratio, margin), cv2.INTER_LINEAR)
    height, width = camera.height, camera.width
    image = image.reshape(height, ratio, width, ratio).mean(axis=(1, 3))
    if imaging.blur_px > 0:
        image = cv2.GaussianBlur(image, (0, 0), imaging.blur_px)
    electrons = np.clip(image * imaging.exposure, 0, None) * imaging.full_well
    grey = generator.poisson(electrons) * (WHITE / imaging.full_well)
    grey += imaging.read_noise * generator.standard_normal(grey.shape)
    return np.clip(np.round(grey), 0, WHITE).astype(np.uint8)


def add_stars(
    radiance: Float[np.ndarray, "h w"],
    directions: Float[np.ndarray, "s 3"],
    brightness: Float[np.ndarray, " s"],
    K: Float[np.ndarray, "3 3"],
) -> None:
    """Add points at infinity in these directions (camera frame) where nothing is in front of them."""
    ahead = directions[:, 2] > 0.1
    place = directions[ahead] @ K.T
    column, row = np.round(place[:, :2] / place[:, 2:]).astype(int).T
    height, width = radiance.shape
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    column, row, light = column[inside], row[inside], brightness[ahead][inside]
    dark = radiance[row, column] == 0
    radiance[row[dark], column[dark]] = light[dark]


@lru_cache(maxsize=8)
def _sample_places(camera: RawCamera, ratio: int, margin: int) -> tuple[np.ndarray, np.ndarray]:
    """Column and row, in the ideal image, of every sample of the raw one."""
    columns, rows = np.arange(camera.width * ratio), np.arange(camera.height * ratio)
    u, v = np.meshgrid((columns + 0.5) / ratio - 0.5, (rows + 0.5) / ratio - 0.5)
    raw = np.stack([u, v], axis=2).reshape(-1, 1, 2)
    K = ideal_matrix(camera, ratio, margin)
    if camera.distortion.any():
        rays = cv2.undistortPoints(raw, camera.camera_matrix, camera.distortion).reshape(-1, 2)
        ideal = rays * np.diag(K)[:2] + K[:2, 2]
    else:
        ideal = (raw.reshape(-1, 2) + margin + 0.5) * ratio - 0.5
    shape = (len(rows), len(columns))
    return ideal[:, 0].reshape(shape).astype(np.float32), ideal[:, 1].reshape(shape).astype(np.float32)
