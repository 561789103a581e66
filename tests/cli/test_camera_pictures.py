"""``checkout``, ``depth`` and ``track --figures``: files, exit codes, and refusals in one line."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from spinfilters.cli.main import main
from spinfilters.simulation.board_images import drawn_poses, write_board_images
from spinfilters.simulation.image_sequence import ImageScenario, Imaging, example_rig, render
from spinfilters.simulation.scenario import Scenario
from spinfilters.vision.calibration_images import Board
from spinfilters.vision.rectification import write_raw_rig

BOARD = Board(7, 5, 0.03)


@pytest.fixture(scope="module")
def rig_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibration, and images of a board by its cameras."""
    folder, rig, generator = tmp_path_factory.mktemp("rig"), example_rig((320, 240)), np.random.default_rng(3)
    write_raw_rig(rig, folder)
    write_board_images(
        folder / "boards", drawn_poses("good", 4, rig, BOARD, generator), rig, BOARD, generator
    )
    return folder


def test_a_stored_calibration_is_checked_and_compared(
    rig_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    board = ["--images", str(rig_folder / "boards"), "--corners", "7x5", "--window", "4", "--square", "0.03"]
    out = tmp_path / "out"
    assert main(["checkout", str(rig_folder), *board, "--difference", str(rig_folder), "-o", str(out)]) == 0
    for name in ("checkout.png", "difference.png"):
        assert (out / name).stat().st_size > 10_000
    assert "left focal length fx" in (out / "difference.csv").read_text()
    assert "rotation change: 0.0000 deg" in capsys.readouterr().out
    board[-1] = "0.02"
    assert main(["checkout", str(rig_folder), *board, "-o", str(out)]) == 1
    assert "BAD  measured square" in capsys.readouterr().out


def test_a_checkout_with_nothing_is_refused(
    rig_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["checkout", str(rig_folder), "-o", str(tmp_path / "out")]) == 2
    assert "--images" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_depth_of_a_pair_is_its_shift(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    texture = cv2.GaussianBlur(np.random.default_rng(1).uniform(0, 255, (120, 240)), (0, 0), 1.0)
    texture = (255 * (texture - texture.min()) / np.ptp(texture)).astype(np.uint8)
    names = [str(tmp_path / f"{side}.png") for side in ("left", "right")]
    cv2.imwrite(names[0], texture)
    cv2.imwrite(names[1], np.roll(texture, -12, axis=1))
    out = tmp_path / "out"
    assert main(["depth", *names, "--largest", "32", "-o", str(out)]) == 0
    with np.load(out / "depth.npz") as arrays:
        for name in ("disparity_local_px", "disparity_global_px"):
            assert np.nanmedian(arrays[name]) == pytest.approx(12.0, abs=0.2)
    assert (out / "depth.png").stat().st_size > 10_000
    cv2.imwrite(names[1], texture[:100])
    capsys.readouterr()
    assert main(["depth", *names, "-o", str(out)]) == 2
    assert "one size" in capsys.readouterr().err
    assert main(["depth", names[0], str(tmp_path / "none.png"), "-o", str(out)]) == 2
    assert "none.png" in capsys.readouterr().err


def test_matches_of_tracked_images_are_drawn(tmp_path: Path) -> None:
    scenario = ImageScenario(
        Scenario(radius_m=0.13, epochs=5, interval=0.25),
        shape="box",
        size=(320, 240),
        imaging=Imaging(oversampling=1, stars=0),
    )
    images = tmp_path / "images"
    images.mkdir()
    render(scenario, images)
    assert main(["track", str(images), "--figures", "-o", str(tmp_path / "tracks")]) == 0
    assert (tmp_path / "tracks" / "matches.png").stat().st_size > 10_000
