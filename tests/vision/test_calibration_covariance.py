"""Stated deviations of a calibration: what the views determine, and refusal where they do not."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spinfilters.cli.main import main
from spinfilters.core.errors import InputError
from spinfilters.io.camera import camera_deviations
from spinfilters.simulation.board_images import drawn_poses, drawn_views, write_board_images
from spinfilters.simulation.image_sequence import example_rig
from spinfilters.vision.calibration_images import Board, board_views, distinct_views, image_pairs
from spinfilters.vision.image_folder import LossCount
from spinfilters.vision.stereo_calibration import StereoCalibration, calibrate_stereo, determination

BOARD, SIZE = Board(7, 5, 0.03), (640, 480)
RIG = example_rig(SIZE)
WORDS = ("move the board", "do not determine")


def _errors(found: StereoCalibration) -> np.ndarray:
    """Errors of the intrinsics of both cameras and of the baseline over their stated deviations."""
    over = []
    for camera, true in zip(found.cameras, (RIG.left, RIG.right), strict=True):
        values = [*np.diag(camera.K)[:2], *camera.K[:2, 2]]
        over += [
            (value - right) / camera.std[name]
            for name, value, right in zip(("fx", "fy", "cx", "cy"), values, true.intrinsics, strict=True)
        ]
    true_baseline = float(np.linalg.norm(RIG.relative_position))
    return np.array([*over, (found.baseline - true_baseline) / found.baseline_std])


@pytest.mark.parametrize("kind", ["still", "jitter", "flat"])
@pytest.mark.parametrize("seed", range(3))
def test_a_board_that_does_not_show_the_focal_length_is_refused_by_that_name(kind: str, seed: int) -> None:
    with pytest.raises(InputError, match="do not determine the focal length") as refused:
        calibrate_stereo(drawn_views(kind, 10, RIG, BOARD, seed), BOARD, SIZE)
    assert "move the board" in str(refused.value)


@pytest.mark.parametrize("count", [4, 5, 12])
@pytest.mark.parametrize("seed", range(4))
def test_errors_are_within_four_stated_deviations_or_a_check_says_so(count: int, seed: int) -> None:
    found = calibrate_stereo(drawn_views("good", count, RIG, BOARD, seed), BOARD, SIZE)
    named = [check.name for check in determination(found) if not check.passed]
    assert named or np.abs(_errors(found)).max() < 4
    assert all("move the board" in name for name in named)
    assert count < 12 or not named


@pytest.mark.parametrize(("count", "seed"), [(6, 281), (8, 203), (5, 279)])
def test_an_error_that_the_pair_shows_is_counted(count: int, seed: int) -> None:
    """Intrinsics of one camera by themselves are off, so that both cameras do not see a board in one place."""
    found = calibrate_stereo(drawn_views("few", count, RIG, BOARD, seed), BOARD, SIZE)
    assert np.abs(_errors(found)).max() < 3


def test_errors_of_many_good_sets_are_as_large_as_stated() -> None:
    over = [
        _errors(calibrate_stereo(drawn_views("good", 8, RIG, BOARD, seed), BOARD, SIZE))
        for seed in range(20, 32)
    ]
    assert 0.6 < np.sqrt(np.mean(np.square(over))) < 1.5


def test_views_repeated_do_not_sharpen_a_calibration() -> None:
    views = drawn_views("good", 8, RIG, BOARD, seed=1)
    again = [replace(view, name=f"again-{view.name}") for view in views]
    once, twice = calibrate_stereo(views, BOARD, SIZE), calibrate_stereo([*views, *again], BOARD, SIZE)
    assert twice.cameras.left.std == pytest.approx(once.cameras.left.std)
    assert twice.repeated == {view.name: view.name.removeprefix("again-") for view in again}


def test_views_at_one_place_become_their_mean() -> None:
    views = drawn_views("still", 6, RIG, BOARD, seed=2)
    (mean,), repeated = distinct_views(views, SIZE)
    np.testing.assert_allclose(mean.left, np.mean([view.left for view in views], axis=0))
    assert list(repeated.values()) == ["left00.png"] * 5


def test_a_far_view_of_a_pair_is_not_called_unpaired() -> None:
    """Its pose is poor, so that the cameras seem to stand elsewhere, but its corners agree."""
    dropped = {}
    for seed in range(40, 52):
        dropped |= calibrate_stereo(drawn_views("good", 10, RIG, BOARD, seed), BOARD, SIZE).dropped
    assert dropped == {}


def test_the_command_refuses_a_board_on_a_tripod(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    generator, size = np.random.default_rng(3), (320, 240)
    rig, board = example_rig(size), Board(7, 5, 0.03)
    write_board_images(
        tmp_path / "boards", drawn_poses("still", 5, rig, board, generator), rig, board, generator
    )
    call = ["calibrate", str(tmp_path / "boards"), "--corners", "7x5", "--square", "0.03", "--window", "3"]
    assert main([*call, "--check", "-o", str(tmp_path / "rig")]) == 2
    said = capsys.readouterr().err
    assert all(word in said for word in WORDS)
    assert len(said.splitlines()) == 1
    assert not (tmp_path / "rig").exists()


def test_the_command_names_what_the_views_leave_open(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Views with little tilt: a deviation of several percent reaches the data set, and the check fails."""
    generator, size = np.random.default_rng(6), (320, 240)
    rig, board = example_rig(size), Board(7, 5, 0.03)
    poses = drawn_poses("slanted", 10, rig, board, generator)
    write_board_images(tmp_path / "boards", poses, rig, board, generator)
    call = ["calibrate", str(tmp_path / "boards"), "--corners", "7x5", "--square", "0.03", "--window", "3"]
    assert main([*call, "--check", "-o", str(tmp_path / "rig")]) == 1
    said = capsys.readouterr().out
    assert all(word in said for word in WORDS)
    document = json.loads((tmp_path / "rig/calibration.json").read_text())
    told = camera_deviations(tmp_path / "rig")
    assert told["focal_std"] > 0.02 or told["baseline_std"] > 0.02
    assert document["baseline_m"]["std"] / document["baseline_m"]["value"] == pytest.approx(
        told["baseline_std"]
    )


def test_real_boards_are_not_doubted_and_agree_with_their_jackknife(shared_data) -> None:
    board = Board(9, 6, 0.025, window=7)
    views, size = board_views(image_pairs(shared_data("opencv_stereo_calib")), board, LossCount())
    found = calibrate_stereo(views, board, size)
    assert all(check.passed for check in determination(found))
    left_out = [calibrate_stereo(views[:k] + views[k + 1 :], board, size) for k in range(len(views))]
    for stated, values in (
        (found.cameras.left.std["fx"], [each.cameras.left.K[0, 0] for each in left_out]),
        (found.baseline_std, [each.baseline for each in left_out]),
    ):
        jackknife = np.sqrt((len(views) - 1) * np.var(values))
        assert 0.5 < stated / jackknife < 2
