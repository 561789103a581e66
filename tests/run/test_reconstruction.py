"""Dense models of runs made of images, and the report of a run with and without one."""

import json
import shutil
from pathlib import Path

import pytest
from pictures import unrendered_pictures

from spinfilters.cli.main import main
from spinfilters.io.ply_files import read_ply
from spinfilters.run.comparison_run import RunOutput, compare_into
from spinfilters.run.run_folder import mark_run_folder
from spinfilters.settings.run_settings import FILTER, ProcessSettings, Settings
from spinfilters.simulation.image_sequence import ImageScenario, Imaging, render
from spinfilters.simulation.scenario_record import Scenario
from spinfilters.vision.track_images import track_images
from tests.plots.chromium import document_after_scripts, pixels_drawn

RADIUS_M = 0.13
FLOATING = Settings(estimators=("smoother",), process=ProcessSettings(gravity=False), verdict=FILTER)


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight pairs of a box at 10 rpm."""
    folder = tmp_path_factory.mktemp("images")
    imaging = Imaging(oversampling=1, stars=10)
    motion = Scenario(radius_m=RADIUS_M, epochs=8, interval=0.25)
    scenario = ImageScenario(motion, shape="box", size=(320, 240), imaging=imaging)
    render(scenario, folder)
    return folder


@pytest.fixture(scope="module")
def run(images: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Their run, without a dense model."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    with unrendered_pictures():
        compare_into(track_images(images).dataset, FLOATING, RunOutput(folder))
    return folder


def test_every_run_has_a_report_with_its_verdict_and_its_map_to_turn(run: Path) -> None:
    text = (run / "report.html").read_text(encoding="utf-8")
    for words in ("Verdict", "smoother", "Numbers", "position error", "Pictures", "config.toml"):
        assert words in text
    assert text.count("data:image/png") == len(list(run.glob("*.png")))
    assert pixels_drawn(document_after_scripts(run / "report.html")) > 100


def test_a_dense_model_has_the_size_of_the_body_and_stands_in_the_report(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["reconstruct", str(run), "--voxels", "64"]) == 0
    assert "extents along the principal axes" in capsys.readouterr().out
    place = run / "reconstruction"
    document = json.loads((place / "reconstruction.json").read_text())
    assert document["epochs"] == 8
    # half a revolution shows a part of the box, none of it farther out than its corners
    assert RADIUS_M < max(document["dimensions_m"]) < 2.2 * RADIUS_M
    content = read_ply(place / "model.ply")
    assert len(content.triangles) == document["triangles"] > 100
    text = (run / "report.html").read_text(encoding="utf-8")
    assert "Dimensions" in text
    assert document["notes"]  # half a revolution leaves the axes uncertain
    assert all(note in text for note in document["notes"])
    assert "data:image/gif" in text


def test_images_of_another_motion_are_refused(
    run: Path, images: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for camera in ("cam0", "cam1"):
        shutil.copytree(images / camera, tmp_path / camera)
        path = tmp_path / camera / "data.csv"
        stamps, files = zip(*(line.split(",") for line in path.read_text().splitlines()[1:]), strict=True)
        path.write_text("\n".join(f"{a},{b}" for a, b in zip(stamps, files[::-1], strict=True)) + "\n")
    assert main(["reconstruct", str(run), "--voxels", "64", "--images", str(tmp_path)]) == 2
    assert "give the images that the run was made of with --images" in capsys.readouterr().err


def test_a_run_whose_position_does_not_hold_is_told_to_be_the_cause(
    images: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Eight epochs leave the place of the centre of mass open to more than fine voxels: the images are the right ones."""
    with unrendered_pictures():
        compare_into(
            track_images(images).dataset, Settings(estimators=("smoother",)), RunOutput(tmp_path / "run")
        )
    assert main(["reconstruct", str(tmp_path / "run"), "--voxels", "128", "--images", str(images)]) == 2
    complaint = capsys.readouterr().err
    assert (
        "give fewer --voxels, or record a longer motion: position and center of mass of that run do not hold"
        in complaint
    )
    assert len(complaint.splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--images", "nowhere"], "nowhere: has no stereo images; give the folder"),
        (["--voxels", "3"], "--voxels"),
    ],
)
def test_what_cannot_be_reconstructed_is_refused_in_one_line(
    run: Path, arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main(["reconstruct", str(run), *arguments])
    except SystemExit as stop:
        code = stop.code
    complaint = capsys.readouterr().err
    assert code == 2
    assert words in complaint
    assert len(complaint.splitlines()) == 1


@pytest.mark.usefixtures("unrendered")
def test_a_run_without_images_takes_an_earlier_model_away_and_says_how_to_give_images(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "gyro.csv").write_text(
        "time_s,wx,wy,wz\n" + "".join(f"{0.01 * k:.2f},0.1,{6.0 + 0.01 * (k % 3)},0.2\n" for k in range(60))
    )
    folder = tmp_path / "run"
    earlier = folder / "reconstruction" / "model.ply"
    earlier.parent.mkdir(parents=True)
    mark_run_folder(folder, Settings(estimators=("smoother",)))
    earlier.write_bytes(b"ply")
    assert main(["compare", str(tmp_path / "gyro.csv"), "-o", str(folder), "--estimators", "smoother"]) == 0
    assert not earlier.parent.exists()
    text = (folder / "report.html").read_text(encoding="utf-8")
    assert "The surface" not in text
    capsys.readouterr()
    assert main(["reconstruct", str(folder)]) == 2
    assert "does not name its images; give their folder with --images" in (capsys.readouterr().err)
