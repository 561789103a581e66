"""Depth of rectified pairs."""

import cv2
import numpy as np
import pytest

from spinfilters.io.camera import PinholeCamera, StereoRig
from spinfilters.vision.depth_map import depth_map, refined_disparity

RIG = StereoRig(PinholeCamera(300.0, 300.0, 159.5, 119.5, 320, 240), 0.1)


def _texture(seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).random((240, 400)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    return (smooth - smooth.min()) / np.ptp(smooth) * 200 + 20


def _pair(disparity: float, noise: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """A wall before both cameras: right(u) = left(u + d)."""
    wall, generator = _texture(0), np.random.default_rng(1)
    columns, rows = np.meshgrid(np.arange(320, dtype=np.float32), np.arange(240, dtype=np.float32))
    images = [cv2.remap(wall, columns + shift, rows, cv2.INTER_LANCZOS4) for shift in (20.0, 20 + disparity)]
    left, right = (image + noise * generator.standard_normal(image.shape) for image in images)
    return np.clip(np.rint(left), 0, 255).astype(np.uint8), np.clip(np.rint(right), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("noise", [3.0, 6.0])
def test_the_refinement_finds_a_fraction_of_a_pixel_and_its_deviation(noise: float) -> None:
    left, right = _pair(30.37, noise)
    start = np.full(left.shape, 30.0)
    start[:, :40] = np.nan
    found, std = refined_disparity(left.astype(np.float32), right.astype(np.float32), start)
    inside = np.isfinite(found)
    error = found[inside] - 30.37
    assert np.count_nonzero(inside) > 0.8 * left.size
    assert abs(error.mean()) < 0.02
    ratio = np.sqrt(np.mean((error / std[inside]) ** 2))
    assert 0.8 < ratio < 1.25


def test_a_wall_has_its_depth_where_it_lies_within_the_sphere() -> None:
    depth = RIG.left.fx * RIG.baseline_m / 30.37
    seen = depth_map(*_pair(30.37), RIG, (np.array([0.0, 0.0, depth]), 0.2))
    assert seen is not None
    assert np.nanmedian(seen.depth) == pytest.approx(depth, rel=2e-3)
    assert seen.count > 0.5 * seen.depth.size


def test_noise_without_a_counterpart_has_next_to_no_depth() -> None:
    generator = np.random.default_rng(2)
    pair = tuple(generator.integers(0, 6, (240, 320)).astype(np.uint8) for _ in range(2))
    seen = depth_map(pair[0], pair[1], RIG, (np.array([0.0, 0.0, 1.0]), 0.2))
    assert seen is not None
    assert seen.count < 0.01 * seen.depth.size


@pytest.mark.parametrize("centre", [(0.0, 0.0, -1.0), (0.0, 0.0, 0.1), (5.0, 0.0, 1.0)])
def test_a_sphere_that_is_not_before_the_camera_has_no_depth(centre: tuple[float, float, float]) -> None:
    assert depth_map(*_pair(30.0), RIG, (np.array(centre), 0.2)) is None


def test_what_lies_outside_an_outline_has_no_depth() -> None:
    """A disc before darkness; windows half beyond its outline correlate as well as those within."""
    rows, columns = np.mgrid[:240, :320]
    noise = np.random.default_rng(3)
    images = [
        np.where(np.hypot(columns - 180 + shift, rows - 120) < 60, image, noise.integers(0, 4, image.shape))
        for image, shift in zip(_pair(0.0), (0.0, 30.0), strict=True)
    ]
    images[1] = np.where(images[1] > 3, np.roll(images[0], -30, axis=1), images[1])
    depth = RIG.left.fx * RIG.baseline_m / 30.0
    seen = depth_map(
        images[0].astype(np.uint8), images[1].astype(np.uint8), RIG, (np.array([0.0, 0.0, depth]), 0.25)
    )
    assert seen is not None
    row, column = np.nonzero(np.isfinite(seen.depth))
    away = np.hypot(column + seen.corner[0] - 180, row + seen.corner[1] - 120)
    assert len(away) > 0.6 * np.pi * 60**2
    assert away.max() <= 60.5
