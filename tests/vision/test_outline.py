"""Points at the outline of a body, by synthetic images."""

import cv2
import numpy as np
import pytest
from jaxtyping import Float, UInt8

from spinfilters.vision.front_end import MARGIN_PX, background_distance, clear_of_outline

SIZE, CENTRE, RADIUS = (160, 200), (100, 80), 50


def _disc(level: float, spread: float, grey: tuple[int, int] = (60, 220)) -> UInt8[np.ndarray, "h w"]:
    """A disc of blotches on an even background with noise."""
    generator = np.random.default_rng(0)
    blotches = cv2.resize(generator.uniform(*grey, (40, 50)), SIZE[::-1], interpolation=cv2.INTER_CUBIC)
    image = level + spread * generator.standard_normal(SIZE)
    inside = _depth() > 0
    image[inside] = blotches[inside]
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _depth() -> Float[np.ndarray, "h w"]:
    """Distance within the disc's edge, px."""
    column, row = np.meshgrid(np.arange(SIZE[1]), np.arange(SIZE[0]))
    return RADIUS - np.hypot(column - CENTRE[0], row - CENTRE[1])


def _points() -> Float[np.ndarray, "n 3"]:
    """Every fourth pixel of the disc, without disparity."""
    row, column = np.nonzero(_depth() > 0.5)
    return np.column_stack([column, row, column]).astype(float)[::4]


@pytest.mark.parametrize(("level", "spread"), [(2.0, 1.5), (250.0, 1.0), (30.0, 0.0)])
def test_the_distance_from_the_background_is_that_from_the_outline(level: float, spread: float) -> None:
    found, depth = background_distance(_disc(level, spread)), _depth()
    assert np.median(np.abs(found - depth)[depth > 2]) < 1
    assert np.quantile(found[depth < -2], 0.95) < 1.5


def test_points_at_the_outline_in_either_image_are_dropped() -> None:
    points, image = _points(), _disc(2.0, 1.5)
    depth = _depth()[points[:, 1].astype(int), points[:, 0].astype(int)]
    clear = clear_of_outline((image, image), points)
    assert clear[depth > MARGIN_PX + 2].all()
    assert not clear[depth < MARGIN_PX - 2].any()
    moved = np.roll(image, -10, axis=1)
    both = clear_of_outline((image, moved), points)  # without disparity: the right body ends 10 px earlier
    assert np.count_nonzero(both) < np.count_nonzero(clear)


def test_before_an_uneven_background_every_point_is_kept() -> None:
    image = _disc(100.0, 25.0)
    assert np.isinf(background_distance(image)).all()
    assert clear_of_outline((image, image), _points()).all()


def test_blotches_of_an_even_body_that_fills_the_image_are_kept() -> None:
    image, points = np.full(SIZE, 180, np.uint8), []
    for row in range(20, 150, 20):
        for column in range(20, 190, 20):
            cv2.circle(image, (column, row), 4, 40, -1)
            points.append((column, row, column))
    assert clear_of_outline((image, image), np.array(points, dtype=float)).all()


def test_an_image_without_points_has_none_at_its_outline() -> None:
    image = _disc(2.0, 1.5)
    assert clear_of_outline((image, image), np.zeros((0, 3))).shape == (0,)
