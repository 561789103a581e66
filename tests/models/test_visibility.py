"""Landmarks that face a camera."""

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.models import feature_tracks as visibility
from spinfilters.models.feature_tracks import (
    NEAREST_M,
    SomeAppearances,
    Surface,
    draw_detections,
    facing,
    recognised,
)


def sample(depth: float) -> tuple[Surface, np.ndarray, np.ndarray]:
    generator = np.random.default_rng(2)
    normals = generator.standard_normal((500, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    quaternions = generator.standard_normal((20, 4))
    rotations = matrix_from_quaternion(quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True))
    return Surface(0.1 * normals, normals), rotations, np.tile([0.02, -0.01, depth], (20, 1))


@pytest.mark.parametrize("cosine", [-0.3, 0.0, 0.4])
@pytest.mark.parametrize("depth", [0.6, 0.1 + NEAREST_M])
def test_compiled_and_numpy_find_the_same_landmarks(monkeypatch, cosine, depth):
    found = facing(cosine, *sample(depth))
    monkeypatch.setattr(visibility, "_library", lambda: None)
    np.testing.assert_array_equal(found, facing(cosine, *sample(depth)))
    assert found.any()
    assert not found.all()


def test_only_points_on_the_near_side_of_a_ball_are_seen():
    surface, rotations, origins = sample(0.6)
    places = np.einsum("nij,kj->nki", rotations, surface.points) + origins[:, np.newaxis]
    found = facing(0.0, surface, rotations, origins)
    centre = np.linalg.norm(origins, axis=1)[:, np.newaxis]
    np.testing.assert_array_equal(found, np.linalg.norm(places, axis=2) < np.sqrt(centre**2 - 0.1**2))


def test_compiled_and_numpy_know_the_same_appearances_again(monkeypatch):
    generator = np.random.default_rng(4)
    visible = generator.random((12, 37)) < 0.6
    drawn, probability = generator.random(visible.shape), generator.random(37)
    found = recognised(visible, drawn, probability)
    monkeypatch.setattr(visibility, "_library", lambda: None)
    np.testing.assert_array_equal(found, recognised(visible, drawn, probability))
    assert found.any()
    assert (found <= visible).all()


def test_an_appearance_is_known_again_as_a_whole_and_each_is_drawn_anew():
    visible = np.array([[1, 0], [1, 1], [0, 1], [1, 0], [1, 1]], dtype=bool)
    drawn = np.tile([[0.9], [0.1], [0.5], [0.5], [0.5]], (1, 2))
    found = recognised(visible, drawn, np.array([0.3, 0.95]))
    np.testing.assert_array_equal(found, np.array([[0, 0], [0, 1], [0, 1], [1, 0], [1, 1]], dtype=bool))


@pytest.mark.parametrize("bits", [np.random.PCG64, np.random.MT19937])
def test_compiled_and_numpy_draw_the_same_tracks_and_leave_the_generator_at_the_same_place(monkeypatch, bits):
    def drawn() -> tuple[np.ndarray, ...]:
        generator = np.random.Generator(bits(5))
        visible = np.random.default_rng(6).random((12, 37)) < 0.6
        known = SomeAppearances(2.0, 1.0).known(visible, generator)
        return known, *draw_detections(known, 0.8, 3, generator), generator.random(2)

    found = drawn()
    monkeypatch.setattr(visibility, "_library", lambda: None)
    for ours, reference in zip(found, drawn(), strict=True):
        np.testing.assert_array_equal(ours, reference)
    known, ids, counts, noise, _ = found
    assert counts.sum() == len(ids) == len(noise) < known.sum()
    assert known[np.repeat(np.arange(len(counts)), counts), ids].all()


def test_an_appearance_is_drawn_as_if_every_frame_had_one():
    visible = np.random.default_rng(7).random((9, 20)) < 0.5
    generator, reference = np.random.default_rng(8), np.random.default_rng(8)
    probability = reference.beta(2.0, 1.0, visible.shape[1])
    expected = recognised(visible, reference.random(visible.shape), probability)
    np.testing.assert_array_equal(SomeAppearances(2.0, 1.0).known(visible, generator), expected)
    assert generator.random() == reference.random()
