"""``spinfilters lidar scan``: a scan, a data set of scans, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from spinfilters.cli.main import main
from spinfilters.core.attitude_conversions import angle_between
from spinfilters.io.truth import read_truth
from spinfilters.lidar.scan import read_scan
from spinfilters.run.readers import read_dataset


def test_a_preset_is_scanned_into_files_and_a_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [
        "lidar",
        "scan",
        "--preset",
        "figure-2.18",
        "-o",
        str(tmp_path / "out"),
        "--format",
        "ply",
        "csv",
    ]
    assert main(command) == 0
    assert "3034 of 6731 rays returned" in capsys.readouterr().out
    assert {"scan.ply", "scan.csv", "scan.png"} <= {path.name for path in (tmp_path / "out").iterdir()}
    scan = read_scan(tmp_path / "out" / "scan.ply")
    assert scan.metadata["noise"]["mode"] == "thesis"  # pyright: ignore[reportIndexIssue]
    assert np.linalg.norm(scan.points - [3, 0, 0], axis=1).max() < 0.9


def test_the_size_of_a_body_is_told_and_a_far_one_is_doubted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["lidar", "scan", "cube", "--rays", "9", "9", "-o", str(tmp_path / "m")]) == 0
    assert "1 x 1 x 1 m, 3.4641 m away\n" in capsys.readouterr().out
    assert (
        main(["lidar", "scan", "cube", "--scale", "1000", "--rays", "9", "9", "-o", str(tmp_path / "mm")])
        == 0
    )
    assert "--scale 0.001 if it is in mm" in capsys.readouterr().out


def test_a_tumbling_body_is_scanned_into_a_data_set(tmp_path: Path) -> None:
    body = ["--rays", "30", "30", "--scans", "4", "--scan-seconds", "0.5", "--noise", "jitter"]
    assert main(["lidar", "scan", "spacecraft", "-o", str(tmp_path / "out"), *body]) == 0
    assert len(list((tmp_path / "out" / "scans").iterdir())) == 4
    truth = read_truth(tmp_path / "out")
    assert truth.time.tolist() == [0.25, 1.25, 2.25, 3.25]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "nothing to scan"),
        (["nowhere.stl"], "no such file"),
        (["cube", "--fov", "0", "1"], "0"),
        (["cube", "--translation", "0", "10", "0"], "none of"),
        (["--preset", "figure-9"], "use one of table-2.1"),
        (["cube", "--bias"], "belong to --noise"),
        (["cube", "--scale", "20000", "--translation", "30", "0", "0"], "2e+04 x 2e+04 x 2e+04 m large"),
        (["cube", "--sun", "0", "0", "0"], "no direction"),
        (["cube", "--scans", "3", "--scan-seconds", "2"], "overlap"),
        (["cube", "--scans", "3", "--translation", "0", "10", "0"], "no ray of any scan"),
    ],
)
def test_what_cannot_be_scanned_is_refused_in_one_line(
    arguments: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main(["lidar", "scan", *arguments, "-o", str(tmp_path / "out")])
    except SystemExit as stop:
        code = stop.code
    assert code == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert says in said[0]
    assert not (tmp_path / "out").exists()


def test_the_number_of_scans_needed_is_told_with_a_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scans, out = str(tmp_path / "scans"), tmp_path / "needed"
    body = ["--rays", "40", "40", "--rotation", "20", "30", "0", "--scans", "5", "--noise", "jitter"]
    assert main(["lidar", "scan", "cube", "-o", scans, *body]) == 0
    assert main(["lidar", "needed", scans, "-o", str(out), "--attitude-deg", "0.001"]) == 0
    assert "scans like these for an attitude of 0.001 deg" in capsys.readouterr().out
    assert (out / "scans_needed.png").stat().st_size > 1000


def test_scans_needed_of_nothing_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lidar", "needed", str(tmp_path), "-o", str(tmp_path / "out")]) == 2
    assert "holds no .ply" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("body", "rays", "count", "least"),
    [
        ("cube", 30, 6, 6),
        ("cube", 30, 12, 12),
        ("spacecraft", 60, 6, 4),
    ],  # two ways must agree where faces hide others
)
def test_scans_without_noise_become_regular_poses(
    body: str, rays: int, count: int, least: int, tmp_path: Path
) -> None:
    command = ["lidar", "scan", body, "--scans", str(count), "--rays", str(rays), str(rays)]
    assert main([*command, "-o", str(tmp_path / "s")]) == 0
    dataset = read_dataset(tmp_path / "s")
    (stream,), truth = dataset.log.streams, dataset.truth
    assert least <= len(stream) <= count
    assert stream.covariance is not None
    assert truth is not None
    std = np.sqrt(np.linalg.eigvalsh(stream.covariance))
    assert std.min() > 5e-6  # no face is flatter
    true = truth.q_ig[np.searchsorted(truth.time, stream.time)]
    apart = angle_between(true, stream.values[:, 3:])
    sure = np.sqrt(np.linalg.eigvalsh(stream.covariance[:, 3:, 3:])[:, -1]) < 1e-2
    assert sure.sum() >= 3
    assert apart[sure].max() < 1e-6  # and the poses are exact all the same
