"""No command deletes or overwrites what it did not write, and no two runs write into one folder."""

import errno
import os
import shutil
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from forked import killed

from spinfilters.cli.main import main
from spinfilters.core.errors import InputError
from spinfilters.plots import figures
from spinfilters.run import run_lock
from spinfilters.run.readers import read_dataset
from spinfilters.run.run_lock import LOCK_FILE, locked_run
from tests.cli.faults import refusal

pytestmark = pytest.mark.usefixtures("few_figures")
SMALL = ("--kind", "gyro", "--frames", "12")


def tree(folder: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def run_arguments(originals: Path, run: Path, *options: str) -> list[str]:
    """A short comparison."""
    return ["compare", str(originals / "gyro"), "--estimators", "mekf", "-o", str(run), *options]


@pytest.fixture(scope="module")
def finished(originals: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that all tests copy."""
    run = tmp_path_factory.mktemp("finished") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "_figures", lambda _: ())
        assert main(run_arguments(originals, run)) == 0
    return run


@pytest.fixture
def run(finished: Path, tmp_path: Path) -> Path:
    """A run folder that a test may change."""
    return Path(shutil.copytree(finished, tmp_path / "run"))


@pytest.mark.parametrize("kind", ["gyro", "stereo-tracks"])
def test_simulate_refuses_a_measured_recording(
    kind: str, originals: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(originals / kind, tmp_path / "measured")
    before = tree(tmp_path / "measured")
    assert "no result of simulate" in refusal(capsys, "simulate", "-o", str(tmp_path / "measured"), *SMALL)
    assert tree(tmp_path / "measured") == before


def test_simulate_replaces_what_it_made_and_refuses_it_once_changed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "simulated"
    for kind in ("stereo-tracks", "gyro"):
        assert main(["simulate", "-o", str(folder), "--kind", kind, "--frames", "12"]) == 0
        assert read_dataset(folder).kind == kind
    assert not (folder / "cam0").exists()
    with open(folder / "gyro.csv", "a") as table:
        table.write("100.0,0,0,0\n")
    before = tree(folder)
    assert "gyro.csv" in refusal(capsys, "simulate", "-o", str(folder), *SMALL)
    assert tree(folder) == before


def test_simulate_on_a_full_disk_leaves_the_old_data_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "simulated"
    assert main(["simulate", "-o", str(folder), *SMALL]) == 0
    before = tree(folder)

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    assert "No space left" in refusal(capsys, "simulate", "-o", str(folder), *SMALL)
    assert tree(folder) == before


def test_a_new_run_keeps_the_files_of_others_in_its_folder(run: Path, originals: Path) -> None:
    kept = [
        run / "notes.md",
        run / "mekf" / "notes.md",
        run / "mekf" / "mine" / "x",
        run / "dataset" / "notes.md",
    ]
    for path in kept:
        path.parent.mkdir(exist_ok=True)
        path.write_text("mine")
    (run / "mekf" / ".0123456789abcdef.part").write_text("left by a kill")
    assert main(["compare", str(originals / "pose"), "--estimators", "ukf", "-o", str(run)]) == 0
    assert [path.read_text() for path in kept] == 4 * ["mine"]
    assert sorted(os.listdir(run / "mekf")) == ["mine", "notes.md"]
    assert sorted(path.name for path in (run / "dataset").iterdir()) == [
        *("dataset.toml", "notes.md", "poses.tum", "poses_covariance.csv", "truth.csv", "truth.toml"),
    ]


@pytest.mark.parametrize("link", ["mekf", "ukf", "dataset", "dataset/cam0", "segments"])
def test_a_link_in_a_run_folder_is_not_followed(
    link: str, run: Path, originals: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    elsewhere = tmp_path / "elsewhere"
    if (run / link).exists():
        (run / link).rename(elsewhere)
    else:
        elsewhere.mkdir()
        (elsewhere / "history.npz").write_text("mine")
    (run / link).symlink_to(elsewhere)
    before = tree(elsewhere)
    for options in ((), ("--resume",)):
        message = refusal(capsys, *run_arguments(originals, run, *options))
        assert f"{link}: is a symbolic link" in message
    assert tree(elsewhere) == before


def test_a_linked_file_in_a_run_folder_is_replaced_and_its_target_kept(
    run: Path, originals: Path, tmp_path: Path
) -> None:
    names, targets = ("summary.json", "config.toml", "mekf/history.npz"), tmp_path / "targets"
    (targets / "mekf").mkdir(parents=True)
    for name in names:
        (run / name).rename(targets / name)
        (run / name).symlink_to(targets / name)
    before = tree(targets)
    assert main(run_arguments(originals, run)) == 0
    assert tree(targets) == before
    assert not any((run / name).is_symlink() for name in names)


def test_a_run_made_from_its_own_data_set_leaves_that_untouched(run: Path) -> None:
    before = tree(run / "dataset")
    inode = (run / "dataset" / "dataset.toml").stat().st_ino
    assert main(["compare", str(run / "dataset"), "--estimators", "ukf", "-o", str(run)]) == 0
    assert tree(run / "dataset") == before
    assert (run / "dataset" / "dataset.toml").stat().st_ino == inode


def test_a_run_is_not_made_from_a_file_that_it_would_replace(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = tree(run)
    source = str(run / "dataset" / "gyro.csv")
    message = refusal(capsys, "compare", source, "--estimators", "mekf", "-o", str(run))
    assert "choose another folder" in message
    assert tree(run) == before


@contextmanager
def held_elsewhere(folder: Path) -> Iterator[None]:
    """Another process that writes a run into a folder."""
    ready, go = os.pipe()
    stop, end = os.pipe()

    def work() -> None:
        with locked_run(folder):
            os.write(go, b".")
            os.read(stop, 1)
            os.kill(os.getpid(), signal.SIGKILL)

    child = os.fork()
    if child == 0:
        work()
    os.read(ready, 1)
    try:
        yield
    finally:
        os.write(end, b".")
        os.waitpid(child, 0)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_second_run_in_one_folder_is_refused_until_the_first_ends_even_by_a_kill(
    run: Path, originals: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = tree(run)
    with held_elsewhere(run):
        for options in ((), ("--resume",), ("--segment", "all")):
            message = refusal(capsys, *run_arguments(originals, run, *options))
            assert str(run) in message
            assert "another run is writing" in message
        assert "another run is writing" in refusal(capsys, "plot", str(run))
        assert tree(run) | {LOCK_FILE: b""} == before | {LOCK_FILE: b""}
    assert (run / LOCK_FILE).exists()
    assert main(run_arguments(originals, run, "--resume")) == 0
    assert not (run / LOCK_FILE).exists()


def test_a_kill_before_anything_was_written_leaves_a_folder_that_a_run_takes(
    originals: Path, tmp_path: Path
) -> None:
    (tmp_path / "run").mkdir()

    def work() -> None:
        with locked_run(tmp_path / "run"):
            os.kill(os.getpid(), signal.SIGKILL)

    assert killed(work)
    assert os.listdir(tmp_path / "run") == [LOCK_FILE]
    assert main(run_arguments(originals, tmp_path / "run")) == 0


def test_a_lock_file_that_its_holder_removed_is_not_what_is_held(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, removed = run_lock._locked, []

    def locked(path: Path) -> Any:
        held = real(path)
        if not removed:
            removed.append(path.unlink())
        return held

    monkeypatch.setattr(run_lock, "_locked", locked)
    with locked_run(tmp_path):
        assert (tmp_path / LOCK_FILE).exists()
    assert not (tmp_path / LOCK_FILE).exists()


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.EOPNOTSUPP])
def test_a_file_system_without_locks_is_written_nevertheless(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def flock(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(run_lock.fcntl, "flock", flock)
    with locked_run(tmp_path), locked_run(tmp_path):
        (tmp_path / "report.txt").write_text("written")
    assert os.listdir(tmp_path) == ["report.txt"]


def test_a_lock_is_not_written_through_a_link(tmp_path: Path) -> None:
    (tmp_path / LOCK_FILE).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match=r"\.lock: cannot be written"), locked_run(tmp_path):
        pass
    assert not (tmp_path / "elsewhere").exists()
