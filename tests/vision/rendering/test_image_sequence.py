"""Rendered sequences: what cameras make of radiance, and the folder that is written."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spinfilters.io.sensor_tables import read_tum
from spinfilters.io.truth import read_truth
from spinfilters.simulation.image_sequence import (
    FramePose,
    ImageScenario,
    Imaging,
    add_stars,
    example_rig,
    ideal_matrix,
    photograph,
    render,
    rendered_pairs,
)
from spinfilters.simulation.scenario_record import Scenario
from spinfilters.vision.rectification import read_raw_rig

SMALL = ImageScenario(
    Scenario(radius_m=0.11, epochs=2),
    shape="box",
    size=(96, 72),
    imaging=Imaging(oversampling=1, stars=5),
)


def rotation(*vector: float) -> np.ndarray:
    """Rotation matrix of a rotation vector, rad."""
    return Rotation.from_rotvec(vector).as_matrix()


def test_a_point_lands_where_the_distorted_camera_puts_it() -> None:
    camera = example_rig((320, 240)).left
    K, point = ideal_matrix(camera, 2, 12), np.array([[0.22, -0.17, 1.0]])
    radiance = np.zeros(((240 + 24) * 2, (320 + 24) * 2))
    add_stars(radiance, point, np.array([40.0]), K)
    image = photograph(
        radiance, camera, 12, Imaging(read_noise=0, blur_px=1.0), np.random.default_rng(0)
    ).astype(float)
    rows, columns = np.mgrid[:240, :320]
    centre = np.array([(columns * image).sum(), (rows * image).sum()]) / image.sum()
    expected = cv2.projectPoints(point, np.zeros(3), np.zeros(3), camera.camera_matrix, camera.distortion)[
        0
    ].ravel()
    assert np.abs(centre - expected).max() < 0.35  # a star is one sample, half a pixel wide


def test_noise_is_that_of_the_seed_and_of_the_stated_size() -> None:
    camera, flat = example_rig((64, 48)).left, np.full((48 + 8, 64 + 8), 0.5)
    imaging = Imaging(oversampling=1, blur_px=0, exposure=1.0, read_noise=3.0, full_well=1e6)
    images = [photograph(flat, camera, 4, imaging, np.random.default_rng(seed)) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(images[0], images[1])
    assert (images[0] != images[2]).any()
    assert np.std(images[0]) == pytest.approx(3.0, rel=0.1)
    assert np.mean(images[0]) == pytest.approx(127.5, abs=0.3)


def test_the_same_scenario_gives_the_same_images() -> None:
    first, again = (next(iter(rendered_pairs(SMALL.stage(), SMALL.motion()))) for _ in range(2))
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)
        assert (a > 30).mean() > 0.02


def test_a_folder_holds_images_calibration_and_truth(tmp_path: Path) -> None:
    render(SMALL, tmp_path)
    for camera in ("cam0", "cam1"):
        lines = (tmp_path / camera / "data.csv").read_text().splitlines()
        assert lines[0] == "#timestamp [ns],filename"
        assert [line.split(",")[0] for line in lines[1:]] == ["0", "500000000"]
        for line in lines[1:]:
            image = cv2.imread(str(tmp_path / camera / "data" / line.split(",")[1]), cv2.IMREAD_UNCHANGED)
            assert image is not None
            assert image.shape == (72, 96)
    assert 'kind = "stereo-images"' in (tmp_path / "dataset.toml").read_text()
    truth, rig = read_truth(tmp_path), read_raw_rig(tmp_path)
    assert truth.time.tolist() == [0.0, 0.5]
    np.testing.assert_allclose(rig.relative_position, SMALL.stage().rig.relative_position, atol=1e-12)


def test_an_image_from_a_moved_camera_is_that_of_the_body_as_it_lies_before_it() -> None:
    dark = replace(SMALL, imaging=Imaging(oversampling=1, stars=0))
    before_it = FramePose(rotation(0.3, -0.2, 0.5), np.array([0.02, -0.01, 0.6]))
    camera = FramePose(rotation(-0.1, 0.4, 0.2), np.array([0.15, 0.03, 0.1]))
    sun = rotation(-0.1, 0.4, 0.2).T @ np.array(dark.sun)
    body = FramePose(camera.rotation @ before_it.rotation, camera.place + camera.rotation @ before_it.place)
    seen = dark.stage().pair(body, 0, camera)
    at_rest = replace(dark, sun=tuple(sun.tolist())).stage().pair(before_it, 0)
    for image, expected in zip(seen, at_rest, strict=True):
        assert (image > 30).mean() > 0.02
        np.testing.assert_allclose(image.astype(int), expected.astype(int), atol=2)


def test_a_circling_inspector_is_written_and_keeps_the_body_in_view(tmp_path: Path) -> None:
    circling = replace(SMALL.scenario, inspector="circle", interval=15.0)
    render(replace(SMALL, scenario=circling), tmp_path)
    inspector, truth = read_tum(tmp_path / "inspector.tum"), read_truth(tmp_path)
    np.testing.assert_array_equal(inspector.time, truth.time)
    assert np.linalg.norm(inspector.values[1, :3]) > 0.5  # a quarter of a circle about a body 0.6 m away
    images = [cv2.imread(str(path)) for path in sorted((tmp_path / "cam0/data").iterdir())]
    assert all((image > 30).mean() > 0.02 for image in images if image is not None)
