"""Models fused from depth maps that are known."""

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.io.camera import PinholeCamera, StereoRig
from spinfilters.vision.body_model import DistanceVolume, Grid, body_model
from spinfilters.vision.depth_map import DepthMap
from spinfilters.vision.visible_surface import HEIGHT_PX, animation, beside, reprojection

RIG = StereoRig(PinholeCamera(250.0, 250.0, 59.5, 44.5, 120, 90), 0.1)
RADIUS, AWAY = 0.08, np.array([0.0, 0.0, 0.5])


def _depth_of_a_ball(generator: np.random.Generator, noise: float) -> DepthMap:
    columns, rows = np.meshgrid(np.arange(120), np.arange(90))
    rays = np.stack(
        [(columns - RIG.left.cx) / RIG.left.fx, (rows - RIG.left.cy) / RIG.left.fy, np.ones((90, 120))],
        axis=-1,
    )
    a, b = (rays**2).sum(axis=-1), rays @ AWAY
    inside = b**2 - a * (AWAY @ AWAY - RADIUS**2)
    depth = np.where(inside > 0, (b - np.sqrt(np.maximum(inside, 0))) / a, np.nan)
    depth += noise * generator.standard_normal(depth.shape)
    return DepthMap(
        (0, 0), depth, np.full(depth.shape, max(noise, 1e-4)), np.full(depth.shape, 120, np.uint8)
    )


def _volume(noise: float, views: int = 24) -> DistanceVolume:
    generator, volume = np.random.default_rng(0), DistanceVolume(Grid(0.1, 48))
    for _ in range(views):
        Q, R = np.linalg.qr(generator.standard_normal((3, 3)))
        turn = Q * np.sign(np.diag(R))
        turn[:, 0] *= np.linalg.det(turn)
        volume.add(_depth_of_a_ball(generator, noise), RIG, turn, AWAY)
    return volume


def test_a_ball_seen_from_all_sides_has_its_dimensions_within_their_deviations() -> None:
    model = body_model(_volume(noise=1e-3))
    assert model.dimensions.extents == pytest.approx(np.full(3, 2 * RADIUS), abs=2.5e-3)
    assert (np.abs(model.dimensions.extents - 2 * RADIUS) < 3 * model.dimensions.std).all()
    assert np.median(np.linalg.norm(model.vertices, axis=1)) == pytest.approx(RADIUS, abs=4e-4)
    assert model.share_near(RADIUS * np.eye(3), 2e-3) == 1.0
    assert model.share_near(0.5 * RADIUS * np.eye(3), 2e-3) == 0.0
    assert np.median(model.grey) == pytest.approx(120, abs=1)


def test_a_ball_is_as_wide_along_axes_that_are_not_known() -> None:
    volume = _volume(noise=0.0)
    exact, vague = (body_model(volume, axes_cov).dimensions for axes_cov in (None, np.diag([0.0, 0.0, 0.01])))
    assert vague.std == pytest.approx(exact.std, rel=0.2)
    assert exact.sentences == vague.sentences == []


def test_the_surface_is_put_where_the_landmarks_lie() -> None:
    volume, generator = _volume(noise=0.0), np.random.default_rng(1)
    directions = generator.standard_normal((200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    before = body_model(volume).dimensions.extents
    for outward in (-5e-4, 5e-4):
        landmarks = (RADIUS + outward) * directions
        found = body_model(volume, None, landmarks)
        radius = np.median(np.linalg.norm(found.vertices, axis=1))
        assert radius == pytest.approx(RADIUS + outward, abs=1.5e-4)
        assert np.sign(found.dimensions.extents - before) == pytest.approx(np.full(3, np.sign(outward)))
    far = body_model(volume, None, 0.5 * RADIUS * directions)  # of another body: refused later, not followed
    np.testing.assert_array_equal(far.dimensions.extents, before)


def test_depth_maps_that_make_no_surface_are_refused_in_one_line() -> None:
    with pytest.raises(InputError, match=r"0 pair\(s\) makes a surface of 0 triangles; give sharper"):
        body_model(DistanceVolume(Grid(0.1, 16)))


def test_a_reprojection_covers_what_the_camera_saw_and_becomes_an_animation() -> None:
    model = body_model(_volume(noise=0.0))
    drawn = reprojection(model, RIG, np.eye(3), AWAY)
    seen = np.isfinite(_depth_of_a_ball(np.random.default_rng(0), 0.0).depth)
    assert drawn.shape == (HEIGHT_PX, 320)
    assert np.count_nonzero(drawn) == pytest.approx(
        (HEIGHT_PX / RIG.left.height) ** 2 * np.count_nonzero(seen), rel=0.05
    )
    picture = beside(np.zeros((90, 120), np.uint8), drawn)
    assert animation([picture, picture[::-1].copy()]).startswith(b"GIF89a")
