"""Stereo calibration: exact on synthetic views, close on the real board, and what it does with bad views."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spinfilters.cli.main import main
from spinfilters.core.errors import InputError
from spinfilters.io.camera import camera_deviations, read_sensor_file
from spinfilters.simulation.image_sequence import example_rig
from spinfilters.vision.calibration_images import Board, BoardView, board_views, image_pairs
from spinfilters.vision.depth_map import disparity_map
from spinfilters.vision.image_folder import LossCount
from spinfilters.vision.rectification import RawRig, camera_text, raw_camera, read_raw_rig, write_raw_rig
from spinfilters.vision.stereo_calibration import (
    StereoCalibration,
    calibrate_stereo,
    checks,
    measured_board,
    stated_deviations,
)

BOARD, SIZE = Board(7, 5, 0.03), (640, 480)


def _views(rig: RawRig, count: int, noise: float = 0.0) -> list[BoardView]:
    """Views of the board in many directions, as both cameras project it."""
    generator, views = np.random.default_rng(1), []
    for k in range(count):
        R = Rotation.from_rotvec(generator.uniform(-0.5, 0.5, 3)).as_matrix()
        place = np.array(
            [generator.uniform(-0.12, 0.02), generator.uniform(-0.12, 0.0), generator.uniform(0.45, 0.7)]
        )
        at_left = BOARD.points @ R.T + place
        at_right = at_left @ rig.relative_rotation.T + rig.relative_position
        seen = []
        for camera, points in ((rig.left, at_left), (rig.right, at_right)):
            pixels = cv2.projectPoints(
                points, np.zeros(3), np.zeros(3), camera.camera_matrix, camera.distortion
            )[0]
            seen.append(pixels.reshape(-1, 2) + noise * generator.standard_normal((len(points), 2)))
        views.append(BoardView(f"left{k:02d}.png", seen[0], seen[1], np.ones(len(BOARD.points), dtype=bool)))
    return views


@pytest.fixture(scope="module")
def exact() -> StereoCalibration:
    """Calibration of ten views without noise."""
    return calibrate_stereo(_views(example_rig(SIZE), 10), BOARD, SIZE)


def test_views_without_noise_give_the_true_rig(exact: StereoCalibration) -> None:
    rig = example_rig(SIZE)
    for found, true in ((exact.rig.left, rig.left), (exact.rig.right, rig.right)):
        np.testing.assert_allclose(found.intrinsics, true.intrinsics, atol=0.02)
    np.testing.assert_allclose(exact.rig.relative_position, rig.relative_position, atol=1e-5)
    np.testing.assert_allclose(exact.rig.relative_rotation, rig.relative_rotation, atol=2e-5)
    assert exact.dropped == {}
    assert exact.rms < 0.01


def test_stated_deviations_are_those_of_the_errors() -> None:
    rig = example_rig(SIZE)
    found = calibrate_stereo(_views(rig, 10, noise=0.2), BOARD, SIZE)
    for camera, true in zip(found.cameras, (rig.left, rig.right), strict=True):
        errors = (np.diag(camera.K)[:2] - true.intrinsics[:2]) / [camera.std["fx"], camera.std["fy"]]
        assert np.abs(errors).max() < 4
        assert camera.rms == pytest.approx(0.2 * np.sqrt(2), rel=0.15)


def test_a_shuffled_pair_is_found_and_named() -> None:
    views = _views(example_rig(SIZE), 9, noise=0.1)
    views[4] = replace(views[4], right=views[7].right)
    found = calibrate_stereo(views, BOARD, SIZE)
    assert list(found.dropped) == ["left04.png"]
    assert "no pair" in found.dropped["left04.png"]


def test_left_and_right_exchanged_in_one_pair_or_in_all_are_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    views = _views(example_rig(SIZE), 9, noise=0.1)
    exchanged = [replace(view, left=view.right, right=view.left) for view in views]
    assert list(calibrate_stereo([*views[:3], exchanged[3], *views[4:]], BOARD, SIZE).dropped) == [
        "left03.png"
    ]
    monkeypatch.setattr("spinfilters.vision.calibration_images.image_pairs", lambda _: [])
    monkeypatch.setattr("spinfilters.vision.calibration_images.board_views", lambda *_: (exchanged, SIZE))
    call = ["calibrate", str(tmp_path), "--corners", "7x5", "--square", "0.03", "-o", str(tmp_path / "out")]
    assert main(call) == 2
    assert "not side by side with cam0 on the left; exchange them" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_view_whose_corners_are_wrong_is_left_out_with_a_reason() -> None:
    views = _views(example_rig(SIZE), 9, noise=0.1)
    views[2].left[:] += 6 * np.random.default_rng(0).standard_normal(views[2].left.shape)
    found = calibrate_stereo(views, BOARD, SIZE)
    assert list(found.dropped) == ["left02.png"]
    assert "left corners miss by" in found.dropped["left02.png"]


def test_the_checkout_passes_a_good_rig_and_fails_a_bent_one(exact: StereoCalibration) -> None:
    good = checks(exact.rig, measured_board(exact.rig, exact.views, BOARD), BOARD)
    assert all(check.passed for check in good)
    turned = exact.rig.right.R_bc @ Rotation.from_euler("x", 0.5, degrees=True).as_matrix()
    bent = RawRig(exact.rig.left, replace(exact.rig.right, R_bc=turned))
    failed = [
        check.name
        for check in checks(bent, measured_board(bent, exact.views, BOARD), BOARD)
        if not check.passed
    ]
    assert "epipolar misalignment, rms" in failed


def test_a_sensor_file_gives_back_the_same_camera(tmp_path: Path) -> None:
    camera = example_rig(SIZE).right
    (tmp_path / "sensor.yaml").write_text(camera_text(camera))
    path = tmp_path / "sensor.yaml"
    again = raw_camera(path, read_sensor_file(path))
    np.testing.assert_array_equal(again.intrinsics, camera.intrinsics)
    np.testing.assert_array_equal(again.distortion, camera.distortion)
    np.testing.assert_allclose(again.R_bc, camera.R_bc, atol=1e-12)


def test_real_boards_give_the_published_calibration(shared_data, tmp_path: Path, capsys) -> None:
    source = shared_data("opencv_stereo_calib")
    call = ["calibrate", str(source), "--corners", "9x6", "--square", "0.025", "-o", str(tmp_path / "out")]
    assert main(call) == 0
    assert "baseline" in capsys.readouterr().out
    document = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert document["cam0"]["parameters"]["fx"]["value"] == pytest.approx(535.9, abs=1.5)
    assert document["cam0"]["rms_px"] <= 0.41
    assert document["cam1"]["rms_px"] <= 0.46
    assert document["stereo_rms_px"] <= 0.45
    assert document["baseline_m"]["value"] == pytest.approx(0.0836, abs=0.0003)
    assert len(document["views"]) == 13
    rig = read_raw_rig(tmp_path / "out")
    assert np.linalg.norm(rig.relative_position) == pytest.approx(document["baseline_m"]["value"])
    storage = cv2.FileStorage(str(tmp_path / "out" / "opencv.yml"), cv2.FILE_STORAGE_READ)
    np.testing.assert_allclose(storage.getNode("M1").mat(), rig.left.camera_matrix)


def test_charuco_boards_are_found() -> None:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
    drawn = cv2.aruco.CharucoBoard((8, 6), 0.03, 0.0225, dictionary).generateImage((640, 480), marginSize=20)
    found = Board.of("7x5", 0.03, charuco=True).corners(drawn)
    assert found is not None
    places, seen = found
    assert seen.all()
    steps = np.diff(places.reshape(5, 7, 2), axis=1)[..., 0]
    assert steps == pytest.approx(np.median(steps), abs=1.5)  # squares are drawn of whole pixels


@pytest.mark.parametrize("corners", ["9", "9x", "x6", "2x6", "9x6x3", "ninexsix", "-9x6", ""])
def test_corners_that_are_none_are_refused(corners: str) -> None:
    with pytest.raises(InputError, match="9x6"):
        Board.of(corners, 0.025)


def test_a_left_image_without_its_right_one_is_named(tmp_path: Path) -> None:
    for name in ("left1.png", "right1.png", "left2.png"):
        (tmp_path / name).write_bytes(b"x")
    with pytest.raises(InputError, match=r"left2\.png"):
        image_pairs(tmp_path)


def test_images_without_a_board_are_counted_and_refused(tmp_path: Path) -> None:
    for k in range(4):
        for side in ("left", "right"):
            cv2.imwrite(str(tmp_path / f"{side}{k}.png"), np.full((48, 64), 40 * k, dtype=np.uint8))
    losses = LossCount()
    with pytest.raises(InputError, match="found in 0 of 4 pairs"):
        board_views(image_pairs(tmp_path), Board(7, 5, 0.03), losses)
    assert losses.lost["board images", "without the board"] == 4
    shutil.rmtree(tmp_path)


def test_pipes_in_place_of_images_are_said_to_be_no_files(tmp_path: Path) -> None:
    for k in range(4):
        for side in ("left", "right"):
            os.mkfifo(tmp_path / f"{side}{k}.png")
    with pytest.raises(InputError, match=r"images of 4 of 4 pairs cannot be read \(4 not a file\)"):
        board_views(image_pairs(tmp_path), Board(7, 5, 0.03), LossCount())


def test_the_files_of_a_calibration_tell_its_deviations(exact: StereoCalibration, tmp_path: Path) -> None:
    write_raw_rig(exact.rig, tmp_path, stated_deviations(exact))
    found, baseline = camera_deviations(tmp_path), np.linalg.norm(exact.rig.relative_position)
    assert found["baseline_std"] == pytest.approx(exact.baseline_std / baseline)
    ratios = [each.std["fx"] / each.K[0, 0] for each in exact.cameras]
    assert max(ratios) <= found["focal_std"] < 2 * max(ratios)
    np.testing.assert_array_equal(read_raw_rig(tmp_path).left.intrinsics, exact.rig.left.intrinsics)


def test_rig_answers_as_the_thesis_does(capsys: pytest.CaptureFixture[str]) -> None:
    """1 px at 0.5 m moves a point by [0.5, 0, -5.9] mm, or by 1.1 mm across (Tweddle 2013, section 5.3)."""
    assert main(["rig"]) == 0
    said = capsys.readouterr().out
    assert "[0.53, 0.00, -5.88] mm" in said
    assert "1.07, " in said
    assert "0.06563 m" in said  # the thesis: 6.56 cm
    assert "42 m" in said


def test_disparity_of_a_shifted_texture_is_the_shift() -> None:
    generator = np.random.default_rng(0)
    texture = cv2.GaussianBlur(generator.integers(0, 255, (60, 160)).astype(np.uint8), (0, 0), 1.0)
    left, right = np.ascontiguousarray(texture[:, :140]), np.ascontiguousarray(texture[:, 9:149])
    found = disparity_map(left, right, 31)
    assert np.nanmedian(found) == pytest.approx(9.0, abs=0.1)


def test_real_disparity_is_within_two_pixels_of_the_truth(shared_data) -> None:
    """A quarter of the images of the Aloe, where both cameras see."""
    folder = shared_data("opencv_aloe")
    left, right, truth = (
        cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE)
        for name in ("aloeL.jpg", "aloeR.jpg", "aloeGT.png")
    )
    assert left is not None
    assert right is not None
    assert truth is not None
    part = np.s_[400:560]
    found = disparity_map(left[part], right[part], 224)
    known = (truth[part] > 0) & np.isfinite(found)
    assert known.mean() > 0.6
    assert (np.abs(found - truth[part])[known] <= 2).mean() >= 0.85
