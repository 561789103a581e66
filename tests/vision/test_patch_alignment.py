"""Disparities of patches of raw images: exact on slanted planes, whatever gain and offset the cameras have."""

import numpy as np
import pytest
from jaxtyping import Float

from spinfilters.simulation.image_sequence import example_rig
from spinfilters.vision.front_end import aligned_patches
from spinfilters.vision.rectification import RawCamera, Rectification

RECTIFICATION = Rectification(example_rig((320, 240)))
DEPTH = 0.6
PLACES = np.stack(np.meshgrid(np.linspace(100.3, 220.1, 9), np.linspace(70.2, 170.7, 9)), axis=2).reshape(
    -1, 2
)

Pair = tuple[np.ndarray, np.ndarray]


def _texture(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Blotches of some mm, 30 to 220."""
    waves = np.random.default_rng(1).uniform(-350, 350, (12, 2))
    phases = np.random.default_rng(2).uniform(0, 2 * np.pi, 12)
    total = sum(np.sin(a * x + b * y + c) for (a, b), c in zip(waves, phases, strict=True))
    return 125 + 95 * np.tanh(np.asarray(total) / 3)


def _plane(slope: float) -> tuple[Float[np.ndarray, " 3"], float]:
    """n and c of the points n'p = c, frame of the rectified left camera: turned about the vertical by a slope."""
    normal = np.array([-slope, 0.2 * slope, 1.0])
    return normal, DEPTH


def _image(camera: int, slope: float) -> np.ndarray:
    """Raw image of the plane."""
    rig = RECTIFICATION.rig
    raw: RawCamera = (rig.left, rig.right)[camera]
    u, v = np.meshgrid(np.arange(raw.width, dtype=float), np.arange(raw.height, dtype=float))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    place = RECTIFICATION.points(pixels, pixels)[camera]
    stereo = RECTIFICATION.stereo
    rays = np.column_stack([(place - [stereo.left.cx, stereo.left.cy]) / stereo.left.fx, np.ones(len(place))])
    normal, distance = _plane(slope)
    origin = np.array([camera * stereo.baseline_m, 0.0, 0.0])
    at = origin + rays * ((distance - normal @ origin) / (rays @ normal))[:, None]
    return np.rint(_texture(at[:, 0], at[:, 1])).reshape(u.shape).astype(np.uint8)


def _disparity(slope: float) -> Float[np.ndarray, " n"]:
    stereo = RECTIFICATION.stereo
    rays = np.column_stack(
        [(PLACES - [stereo.left.cx, stereo.left.cy]) / stereo.left.fx, np.ones(len(PLACES))]
    )
    normal, distance = _plane(slope)
    return stereo.left.fx * stereo.baseline_m * (rays @ normal) / distance


@pytest.mark.parametrize("slope", [-2.0, -1.0, 0.0, 1.0, 2.0])
def test_disparity_of_a_slanted_plane_is_exact(slope: float) -> None:
    images, expected = (_image(0, slope), _image(1, slope)), _disparity(slope)
    found = aligned_patches(RECTIFICATION, *images, PLACES, expected + 0.4)
    assert found.found.mean() > 0.95
    error = (found.disparity - expected)[found.found]
    assert np.median(np.abs(error)) < 0.03
    assert abs(error.mean()) < 0.01


def test_cameras_of_other_gain_and_offset_give_the_same_disparity() -> None:
    left, right = _image(0, 1.0), _image(1, 1.0)
    plain = aligned_patches(RECTIFICATION, left, right, PLACES, _disparity(1.0))
    darker = (0.7 * right.astype(float) + 15).astype(np.uint8)
    other = aligned_patches(RECTIFICATION, left, darker, PLACES, _disparity(1.0))
    both = plain.found & other.found
    assert both.mean() > 0.9
    assert np.median(np.abs(plain.disparity - other.disparity)[both]) < 0.01


def test_patches_without_texture_stay_where_they_are() -> None:
    grey = np.full((240, 320), 90, dtype=np.uint8)
    found = aligned_patches(RECTIFICATION, grey, grey, PLACES, np.full(len(PLACES), 30.0))
    np.testing.assert_allclose(found.disparity, 30.0, atol=1e-6)


def test_patches_of_unlike_images_have_a_large_residual() -> None:
    images = _image(0, 0.0), np.random.default_rng(0).integers(0, 255, (240, 320)).astype(np.uint8)
    found = aligned_patches(RECTIFICATION, *images, PLACES, _disparity(0.0))
    like = aligned_patches(RECTIFICATION, images[0], _image(1, 0.0), PLACES, _disparity(0.0))
    assert np.median(found.residual) > 5 * np.median(like.residual)


def test_no_places_give_no_disparities() -> None:
    images = _image(0, 0.0), _image(1, 0.0)
    assert len(aligned_patches(RECTIFICATION, *images, np.zeros((0, 2)), np.zeros(0)).disparity) == 0
