"""Data sets and recordings with a fault: exit code 2, one line that names file or value, and nothing half-written."""

import shutil
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.cli.faults import Change, first_lines, line, refusal, replaced, text, without


@dataclass(frozen=True)
class Fault:
    """A change of a data set of some kind, and what the line must say."""

    kind: str
    change: Change
    says: str


DATASET_FAULTS = {
    "missing table": Fault("gyro", without("gyro.csv"), "gyro.csv"),
    "missing dataset.toml": Fault("gyro", without("dataset.toml"), "dataset.toml"),
    "unknown kind": Fault("gyro", replaced("dataset.toml", '"gyro"', '"radar"'), "'radar'"),
    "kind without front end": Fault(
        "gyro", replaced("dataset.toml", '"gyro"', '"lidar-scans"'), "lidar-scans"
    ),
    "bad TOML": Fault("gyro", text("dataset.toml", "kind = = 3"), "dataset.toml"),
    "unknown TOML key": Fault("gyro", replaced("dataset.toml", "kind", "colour = 3\nkind"), "'colour'"),
    "negative std": Fault("gyro", replaced("dataset.toml", "_std = ", "_std = -"), "gyro_noise_std"),
    "std as text": Fault("gyro", replaced("dataset.toml", "_std = 0.002", '_std = "low"'), "'low'"),
    "degrees": Fault("gyro", line("gyro.csv", 1, "time_s,wx (deg/s),wy (deg/s),wz (deg/s)"), "degrees"),
    "milliseconds": Fault("gyro", line("gyro.csv", 1, "time_ms,wx,wy,wz"), "time_ms"),
    "NaN cell": Fault("gyro", line("gyro.csv", 4, "1.0,nan,0,0"), "line 4: wx is 'nan'"),
    "infinite cell": Fault("gyro", line("gyro.csv", 4, "1.0,0,inf,0"), "line 4: wy is 'inf'"),
    "text cell": Fault("gyro", line("gyro.csv", 4, "1.0,0,0,fast"), "line 4: wz is 'fast'"),
    "a column too few": Fault("gyro", line("gyro.csv", 4, "1.0,0,0"), "line 4"),
    "time backwards": Fault("gyro", line("gyro.csv", 4, "0.25,0,0,0"), "0.25"),
    "time twice": Fault("gyro", line("gyro.csv", 4, "0.5,0,0,0"), "0.5 s occurs twice"),
    "one epoch": Fault("gyro", first_lines("gyro.csv", 2), "1 epoch"),
    "four epochs": Fault("gyro", first_lines("gyro.csv", 5), "4 epoch"),
    "header only": Fault("gyro", first_lines("gyro.csv", 1), "no rows"),
    "zero bytes": Fault("gyro", text("gyro.csv", ""), "gyro.csv: is empty"),
    "truth of another format": Fault("gyro", first_lines("truth.csv", 1), "truth.csv"),
    "impossible true body": Fault(
        "gyro",
        replaced("truth.toml", "principal_moments = [", "principal_moments = [9, 1, 1]\nx = ["),
        "truth.toml",
    ),
    "quaternion zero": Fault("pose", line("poses.tum", 3, "0.5 0 0 1 0 0 0 0"), "[0.0, 0.0, 0.0, 0.0]"),
    "pose of seven numbers": Fault("pose", line("poses.tum", 3, "0.5 0 0 1 0 0 0"), "poses.tum: line 3"),
    "covariance not positive": Fault(
        "pose", line("poses_covariance.csv", 2, "0.0" + ",0" * 21), "covariance"
    ),
    "tracks without calibration": Fault("stereo-tracks", without("cam1"), "cam1"),
    "behind the cameras": Fault(
        "stereo-tracks", line("tracks.csv", 3, "0.0,1,300,200,320"), "behind the cameras"
    ),
    "landmark twice": Fault("stereo-tracks", line("landmarks.csv", 3, "0,1,2,3"), "landmark 0 occurs twice"),
    "fractional landmark": Fault("stereo-tracks", line("landmarks.csv", 3, "1.5,1,2,3"), "1.5"),
    "zero baseline": Fault("stereo-tracks", replaced("cam1/sensor.yaml", "0.09", "0.0"), "baseline"),
    "zero focal length": Fault(
        "stereo-tracks",
        lambda folder: [replaced(f"cam{k}/sensor.yaml", "[466.7", "[0.0")(folder) for k in (0, 1)],
        "fx is 0.0",
    ),
    "lens distortion": Fault(
        "stereo-tracks", replaced("cam0/sensor.yaml", "[0.0, 0.0, 0.0, 0.0]", "[-0.3, 0.1, 0.0]"), "-0.3"
    ),
    "inspector of half the time": Fault(
        "stereo-tracks", text("inspector.tum", "0.0 0 0 0 0 0 0 1\n1.0 0 0 0 0 0 0 1\n"), "do not cover"
    ),
    "inspector of a gyro": Fault(
        "gyro", text("inspector.tum", "0.0 0 0 0 0 0 0 1\n9.0 0 0 0 0 0 0 1\n"), "leave it out"
    ),
    "bad YAML": Fault("stereo-tracks", text("cam0/sensor.yaml", "T_BS: [1, 2"), "cam0/sensor.yaml"),
    "python in YAML": Fault(
        "stereo-tracks", text("cam0/sensor.yaml", "a: !!python/object/apply:os.system ['true']\n"), "python"
    ),
}


@pytest.mark.parametrize("fault", DATASET_FAULTS.values(), ids=DATASET_FAULTS.keys())
def test_a_faulty_data_set_is_refused_in_one_line(
    fault: Fault, originals: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, run = tmp_path / "data", tmp_path / "run"
    shutil.copytree(originals / fault.kind, folder)
    fault.change(folder)
    said = refusal(capsys, "compare", str(folder), "-o", str(run))
    assert fault.says in said
    assert not run.exists() or not list(run.iterdir())


def not_a_trial(folder: Path) -> None:
    """Make the folder a phyphox export whose segments are one trial and one that was dropped."""
    rows = "\n".join(f"{0.01 * k},1,0,0,1" for k in range(100))
    header = '"Time (s)","Gyroscope x (rad/s)","Gyroscope y (rad/s)","Gyroscope z (rad/s)","Absolute (rad/s)"'
    (folder / "meta").mkdir(parents=True)
    (folder / "Raw Data.csv").write_text(f"{header}\n{rows}\n", encoding="utf-8")
    (folder / "meta" / "segments.csv").write_text(
        "segment,start,end,keep,comment\n0,0.1,0.5,,throw\n1,0.5,0.8,false,dropped\n", encoding="utf-8"
    )


@pytest.mark.parametrize(("segment", "says"), [("1", "'dropped'"), ("7", "no segment 7")])
def test_a_segment_that_is_no_trial_is_refused(
    segment: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    not_a_trial(tmp_path / "phone")
    said = refusal(
        capsys, "compare", str(tmp_path / "phone"), "--segment", segment, "-o", str(tmp_path / "run")
    )
    assert says in said


def test_poses_that_do_not_turn_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "still.tum"
    path.write_text("".join(f"{0.1 * k:.1f} 0 0 1 0 0 0 1\n" for k in range(12)), encoding="utf-8")
    assert "rotat" in refusal(capsys, "compare", str(path), "-o", str(tmp_path / "run"))
