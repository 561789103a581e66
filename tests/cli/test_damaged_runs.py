"""Run folders with a fault: ``plot`` ends with exit code 2 and one line that names the file."""

import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from pictures import unrendered_pictures

from spinfilters.cli.main import main
from tests.cli.faults import Change, cut_off, refusal, text, without


@pytest.fixture(scope="module")
def finished(originals: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder."""
    run = tmp_path_factory.mktemp("finished") / "run"
    with unrendered_pictures():
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
    "history cut off": (cut_off("mekf/history.npz"), "history.npz"),
    "history of text": (text("mekf/history.npz", "no archive"), "history.npz"),
    "history of another state": (archive(blocks=np.array(["t", "a"])), "history.npz"),
    "history of unknown blocks": (archive(blocks=np.array(["x"])), "history.npz"),
    "history of words": (archive(mean=np.array(["a", "b"])), "history.npz"),
    "history of negative counts": (archive(dof=np.full(12, -5)), "less than nothing"),
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
