"""What users get wrong: exit code 2, one line on standard error that names file or value, and nothing half-written."""

import shutil
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from spinfilters.cli.main import main
from spinfilters.logs.dataset_writing import write_dataset
from spinfilters.simulation.scenario import Scenario, simulate

Change = Callable[[Path], object]


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One small simulated data set of every kind, by name of the kind."""
    folder = tmp_path_factory.mktemp("originals")
    for kind in ("stereo-tracks", "pose", "gyro"):
        write_dataset(simulate(Scenario(kind=kind, frames=12, landmarks=40)), folder / kind)
    return folder


def replaced(file: str, old: str, new: str) -> Change:
    """Change a file's text where ``old`` first occurs."""

    def change(folder: Path) -> None:
        text = (folder / file).read_text(encoding="utf-8")
        assert old in text
        (folder / file).write_text(text.replace(old, new, 1), encoding="utf-8")

    return change


def line(file: str, number: int, new: str) -> Change:
    """Replace a line of a file, counted from 1."""

    def change(folder: Path) -> None:
        lines = (folder / file).read_text(encoding="utf-8").splitlines()
        lines[number - 1] = new
        (folder / file).write_text("\n".join(lines) + "\n", encoding="utf-8")

    return change


def first_lines(file: str, count: int) -> Change:
    """Cut a file off."""

    def change(folder: Path) -> None:
        lines = (folder / file).read_text(encoding="utf-8").splitlines()
        (folder / file).write_text("\n".join(lines[:count]) + "\n", encoding="utf-8")

    return change


def without(name: str) -> Change:
    """Delete a file or folder."""
    return lambda folder: (
        shutil.rmtree(folder / name) if (folder / name).is_dir() else (folder / name).unlink()
    )


def text(name: str, content: str) -> Change:
    """Write a file."""
    return lambda folder: (folder / name).write_text(content, encoding="utf-8")


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
    "one frame": Fault("gyro", first_lines("gyro.csv", 2), "1 frame"),
    "four frames": Fault("gyro", first_lines("gyro.csv", 5), "4 frame"),
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
        "stereo-tracks", replaced("cam0/sensor.yaml", "[0.0, 0.0, 0.0, 0.0]", "[-0.3, 0.1, 0.0, 0.0]"), "-0.3"
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


CONFIG_FAULTS = {
    "not TOML": ("estimators = ", "config.toml: is not TOML"),
    "unknown table": ("[filter]\na = 1", "'filter'"),
    "unknown key": ("[process]\nforce = 1", "process.force"),
    "text for a number": ('[process]\nforce_psd = "big"', "process.force_psd is 'big'"),
    "truth value for a number": ("[ukf]\nalpha = true", "ukf.alpha is True"),
    "number for a truth value": ("[process]\ndrag = 1", "process.drag is 1"),
    "NaN": ("[ukf]\nbeta = nan", "ukf.beta is nan"),
    "beyond float64": ("[process]\ntolerance = 1" + 400 * "0", "process.tolerance"),
    "negative density": ("[process]\nforce_psd = -1.0", "force_psd is -1.0"),
    "negative std": ("[sensors]\npixel_std = -1.0", "sensors.pixel_std is -1.0"),
    "tolerance of nothing": ("[process]\ntolerance = 0.0", "process.tolerance is 0.0"),
    "no frames": ("[start]\nframes = 0", "start.frames is 0"),
    "half a frame": ("[start]\nframes = 7.5", "start.frames is 7.5"),
    "table that is none": ("process = 3", "process is 3"),
    "estimators that are none": ("estimators = 3", "estimators is 3"),
    "unknown estimator": ('estimators = ["kalman"]', "config.toml: unknown estimator 'kalman'"),
    "no estimator": ("estimators = []", "none given"),
    "nested without end": ("a = " + 5000 * "[", "config.toml"),
}


@pytest.mark.parametrize(("content", "says"), CONFIG_FAULTS.values(), ids=CONFIG_FAULTS.keys())
def test_a_faulty_configuration_is_refused_in_one_line(
    content: str, says: str, originals: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "config.toml"
    config.write_text(content, encoding="utf-8")
    said = refusal(
        capsys, "compare", str(originals / "gyro"), "--config", str(config), "-o", str(tmp_path / "run")
    )
    assert says in said


ARGUMENT_FAULTS = {
    "no command": ("", "COMMAND"),
    "unknown command": ("guess", "'guess'"),
    "unknown option": ("compare --fast", "--fast"),
    "missing folder": ("compare {tmp}/nowhere -o {tmp}/run", "nowhere"),
    "empty folder": ("compare {tmp}/empty -o {tmp}/run", "empty/dataset.toml"),
    "not a data file": ("compare {tmp}/notes.md -o {tmp}/run", "'.md'"),
    "missing configuration": ("compare {gyro} --config {tmp}/none.toml", "none.toml"),
    "unknown estimator": ("compare {gyro} --estimators mekf,magic", "'magic'"),
    "estimator twice": ("compare {gyro} --estimators ukf,ukf", "ukf"),
    "no estimator": ("compare {gyro} --estimators ,", "none given"),
    "one estimator wanted": ("estimate {gyro} --estimator best", "'best'"),
    "segment not a number": ("compare {gyro} --segment first", "--segment first"),
    "segment of digits that are none": ("compare {gyro} --segment ²", "--segment ²"),
    "segment beyond all": ("compare {gyro} --segment 99999999999999999999", "--segment 9999"),
    "segment of what has none": ("compare {gyro} --segment 1", "--segment 1"),
    "segment of the simulation": ("compare --segment 1", "--segment 1"),
    "negative seed": ("compare --seed -1", "--seed -1"),
    "seed of a simulation negative": ("simulate -o {tmp}/s --seed -1", "--seed -1"),
    "seed not a number": ("compare --seed x", "'x'"),
    "simulation nowhere": ("simulate", "--output"),
    "unknown kind of simulation": ("simulate -o {tmp}/s --kind radar", "'radar'"),
    "a single frame": ("simulate -o {tmp}/s --frames 1", "1 frames"),
    "frames not a number": ("simulate -o {tmp}/s --frames many", "'many'"),
    "no interval": ("simulate -o {tmp}/s --interval 0", "0.0 s"),
    "interval NaN": ("simulate -o {tmp}/s --interval nan", "nan"),
    "interval infinite": ("simulate -o {tmp}/s --interval inf", "inf"),
    "rate NaN": ("simulate -o {tmp}/s --rate-rpm 1 nan 1", "nan"),
    "rate beyond all": ("simulate -o {tmp}/s --rate-rpm 1 1e30 1", "1e+30"),
    "two moments": ("simulate -o {tmp}/s --moments 1 1", "--moments"),
    "moments of no body": ("simulate -o {tmp}/s --moments 1 1 3", "triangle"),
    "negative moment": ("simulate -o {tmp}/s --moments -1 1 1", "-1.0"),
    "moment NaN": ("simulate -o {tmp}/s --moments nan 1 1", "nan"),
    "simulation among other files": ("simulate -o {tmp}/foreign --frames 5", "foreign"),
    "simulation onto a file": ("simulate -o {tmp}/notes.md --kind gyro --frames 5", "notes.md"),
    "run onto a file": ("compare {gyro} -o {tmp}/notes.md", "notes.md"),
    "run below a file": ("compare {gyro} -o {tmp}/notes.md/run", "notes.md/run"),
    "run among other files": ("compare {gyro} -o {tmp}/foreign", "foreign"),
    "plot of nothing": ("plot {tmp}/nowhere", "nowhere/summary.json"),
    "plot of no run": ("plot {tmp}/foreign", "foreign/summary.json"),
    "plot of a file": ("plot {tmp}/notes.md", "notes.md"),
}


@pytest.mark.parametrize(("command", "says"), ARGUMENT_FAULTS.values(), ids=ARGUMENT_FAULTS.keys())
def test_faulty_arguments_are_refused_in_one_line(
    command: str, says: str, originals: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.md").write_text("notes", encoding="utf-8")
    (tmp_path / "foreign" / "dataset").mkdir(parents=True)
    (tmp_path / "foreign" / "config.toml").write_text("theirs = 1\n", encoding="utf-8")
    said = refusal(capsys, *(word.format(tmp=tmp_path, gyro=originals / "gyro") for word in command.split()))
    assert says in said
    assert not (tmp_path / "s").exists()
    assert {path.name for path in (tmp_path / "foreign").iterdir()} == {"config.toml", "dataset"}
    assert (tmp_path / "notes.md").read_text(encoding="utf-8") == "notes"


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


def refusal(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What a command that must fail says: its one line."""
    try:
        code: object = main(arguments)
    except SystemExit as stop:  # argparse
        code = stop.code
    captured = capsys.readouterr()
    assert code == 2, captured.err
    assert len(captured.err.splitlines()) == 1, captured.err
    assert captured.err.startswith("spinfilters: ")
    assert captured.out == ""
    return captured.err


@pytest.fixture(scope="module")
def finished(originals: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder."""
    run = tmp_path_factory.mktemp("finished") / "run"
    assert main(["compare", str(originals / "gyro"), "--estimators", "mekf", "-o", str(run)]) == 0
    return run


def archive(**changes: np.ndarray) -> Change:
    """Change arrays of a history."""

    def change(folder: Path) -> None:
        path = folder / "mekf" / "history.npz"
        with np.load(path) as file:
            arrays = dict(file)
        np.savez(path, **{**arrays, **changes})  # pyright: ignore[reportArgumentType]

    return change


def archive_member(data: bytes) -> Change:
    """Put these bytes in the place of an array of a history, packed."""

    def change(folder: Path) -> None:
        path = folder / "mekf" / "history.npz"
        with np.load(path) as file:
            arrays = {name: file[name] for name in file if name != "mean"}
        np.savez(path, **arrays)  # pyright: ignore[reportArgumentType]
        with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as file:
            file.writestr("mean.npy", data)

    return change


def archive_bomb(folder: Path) -> None:
    """Half a gigabyte of zeros in the place of an array."""
    archive_member(bytes(1 << 29))(folder)


RUN_FAULTS = {
    "history missing": (without("mekf"), "history.npz"),
    "history cut off": (
        lambda run: (run / "mekf/history.npz").write_bytes((run / "mekf/history.npz").read_bytes()[:700]),
        "history.npz",
    ),
    "history of text": (text("mekf/history.npz", "no archive"), "history.npz"),
    "history of another state": (archive(blocks=np.array(["t", "a"])), "history.npz"),
    "history of unknown blocks": (archive(blocks=np.array(["x"])), "history.npz"),
    "history of words": (archive(mean=np.array(["a", "b"])), "history.npz"),
    "history of unknown status": (archive(verdict=np.array("fine")), "'fine'"),
    "history with objects": (archive(reasons=np.array([{}], dtype=object)), "history.npz"),
    "history that is a bomb": (archive_bomb, "history.npz"),
    "history with a header of brackets": (
        archive_member(b"\x93NUMPY\x01\x00\x00\x10" + 4096 * b"("),
        "history.npz",
    ),
    "summary not JSON": (text("summary.json", "{"), "summary.json"),
    "summary of another schema": (text("summary.json", '{"schema": 99}'), "schema"),
    "summary without estimators": (text("summary.json", '{"schema": 1}'), "summary.json"),
    "summary of no estimator": (
        text("summary.json", '{"schema": 1, "start": {"end_s": 1}, "estimators": {}}'),
        "summary.json",
    ),
    "summary nested without end": (text("summary.json", 100_000 * "["), "summary.json"),
    "data set missing": (without("dataset"), "dataset"),
}


@pytest.mark.parametrize(("change", "says"), RUN_FAULTS.values(), ids=RUN_FAULTS.keys())
def test_a_damaged_run_folder_is_refused_in_one_line(
    change: Change, says: str, finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    shutil.copytree(finished, run)
    change(run)
    assert says in refusal(capsys, "plot", str(run))
