"""A pose from one image and a known map: exact without noise, sound with wrong matches, none where there is none."""

import numpy as np
import pytest
from jaxtyping import Float

from spinfilters.models.camera_landmarks import MonocularLandmark, camera_parameters
from spinfilters.models.sensors.monocular import perspective_pose
from spinfilters.models.state_layout import StateLayout

LAYOUT = StateLayout(("t", "a"))
CAMERA = MonocularLandmark(LAYOUT)
CALIBRATION = np.array([466.7, 470.0, 320.0, 240.0])


def scene(
    seed: int, count: int = 60, planar: bool = False
) -> tuple[Float[np.ndarray, " 7"], Float[np.ndarray, "k p"], Float[np.ndarray, "k 2"]]:
    """A true pose, parameters of landmarks on a body of 0.1 m, and the pixels they have exactly."""
    generator = np.random.default_rng(seed)
    points = 0.1 * generator.uniform(-1, 1, (count, 3)) * [1, 1, 0 if planar else 1]
    pose = LAYOUT.retract(LAYOUT.origin(), np.r_[0.05, -0.04, 0.6, generator.uniform(-1.5, 1.5, 3)])
    parameters = camera_parameters(points, CALIBRATION, 1.0)
    return pose, parameters, CAMERA.predict(np.tile(pose, (count, 1)), parameters)


@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_exact_pixels_give_the_exact_pose(seed: int, planar: bool) -> None:
    pose, parameters, pixels = scene(seed, planar=planar)
    found = perspective_pose(CAMERA, parameters, pixels)
    assert found is not None
    np.testing.assert_allclose(LAYOUT.local(pose, found), 0.0, atol=1e-8)


@pytest.mark.parametrize("wrong", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("seed", range(4))
def test_wrong_matches_are_outvoted(seed: int, wrong: float) -> None:
    pose, parameters, pixels = scene(seed)
    generator = np.random.default_rng(seed)
    noisy = pixels + generator.standard_normal(pixels.shape)
    rows = generator.choice(len(pixels), round(wrong * len(pixels)), replace=False)
    noisy[rows] = noisy[np.roll(rows, 1)]
    found = perspective_pose(CAMERA, parameters, noisy)
    assert found is not None
    away = LAYOUT.local(pose, found)
    assert np.linalg.norm(away[:3]) < 0.01
    assert np.linalg.norm(away[3:]) < 0.05


def test_matches_without_a_pose_have_none() -> None:
    _, parameters, pixels = scene(0)
    scattered = np.random.default_rng(1).uniform(0, 640, pixels.shape)
    assert perspective_pose(CAMERA, parameters, scattered) is None
    assert perspective_pose(CAMERA, parameters[:3], pixels[:3]) is None
    assert perspective_pose(CAMERA, np.tile(parameters[:1], (5, 1)), pixels[:5]) is None
    assert perspective_pose(CAMERA, parameters, np.full_like(pixels, np.nan)) is None


def test_a_few_matches_among_which_one_is_not_finite_have_a_pose() -> None:
    pose, parameters, pixels = scene(0, 8)
    pixels[3] = np.nan
    found = perspective_pose(CAMERA, parameters, pixels)
    assert found is not None
    np.testing.assert_allclose(LAYOUT.local(pose, found), 0.0, atol=1e-8)
