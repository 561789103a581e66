"""A folder of results appears whole or not at all, and over nothing of anybody else's."""

import os
import signal
from pathlib import Path

import pytest
from forked import killed

from spinfilters.core.errors import InputError
from spinfilters.io import output_files as module
from spinfilters.io.output_files import LIST_FILE, make_folder, output_folder, refuse_foreign, write_text


def fill(folder: Path, **texts: str) -> None:
    """Write files as a command would."""
    with output_folder(folder, "test") as place:
        for name, text in texts.items():
            make_folder((place / name.replace("__", "/")).parent)
            write_text(place / name.replace("__", "/"), text)


def content(folder: Path) -> dict[str, str]:
    """Every file below a folder, as text, without the list."""
    return {
        str(path.relative_to(folder)): path.read_text(encoding="utf-8")
        for path in folder.rglob("*")
        if path.is_file() and path.name != LIST_FILE
    }


def test_files_replace_those_of_the_same_command_and_nothing_else_is_left(tmp_path: Path) -> None:
    fill(tmp_path / "out", a="1", cam0__b="2")
    inode = (tmp_path / "out").stat().st_ino
    fill(tmp_path / "out", a="3", c="4")
    assert content(tmp_path / "out") == {"a": "3", "c": "4"}
    assert sorted(os.listdir(tmp_path / "out")) == [LIST_FILE, "a", "c"]
    assert (tmp_path / "out").stat().st_ino == inode
    assert os.listdir(tmp_path) == ["out"]


def test_an_empty_folder_a_link_to_one_and_the_present_one_are_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    fill(tmp_path / "link", a="1")
    assert content(tmp_path / "real") == {"a": "1"}
    monkeypatch.chdir(tmp_path / "real")
    fill(Path(), a="2")
    assert content(tmp_path / "real") == {"a": "2"}
    assert sorted(os.listdir(tmp_path)) == ["link", "real"]


@pytest.mark.parametrize("foreign", ["new", "changed", "linked", "below", "list", "command"])
def test_a_folder_that_holds_anything_foreign_is_refused(foreign: str, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    fill(folder, a="1")
    if foreign == "new":
        (folder / "notes").write_text("mine")
    elif foreign == "changed":
        (folder / "a").write_text("corrected by hand")
    elif foreign == "linked":
        (folder / "a").rename(tmp_path / "elsewhere")
        (folder / "a").symlink_to(tmp_path / "elsewhere")
    elif foreign == "below":
        (folder / "mine").mkdir()
        (folder / "mine" / "notes").write_text("mine")
    elif foreign == "list":
        (folder / LIST_FILE).write_text("[" * 100_000)
    before = content(folder)
    with pytest.raises(InputError, match=r"out: is not empty and no result of") as refused:
        refuse_foreign(folder, "another" if foreign == "command" else "test")
    assert "\n" not in str(refused.value)
    assert content(folder) == before


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("step", range(5))
def test_whatever_stops_the_writing_the_old_files_stay_whole(
    step: int, error: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, count, rename = tmp_path / "out", 0, os.rename
    fill(folder, a="1", b="2")
    before = sorted(os.listdir(folder))

    def failing(source: Path, target: Path) -> None:
        nonlocal count
        count += 1
        if count == step + 1:
            raise error
        rename(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(module.os, "rename", failing)
        with pytest.raises(type(error) if isinstance(error, KeyboardInterrupt) else InputError):
            fill(folder, a="3", c="4")
    assert content(folder) == {"a": "1", "b": "2"}
    assert sorted(os.listdir(folder)) == before
    assert os.listdir(tmp_path) == ["out"]
    fill(folder, c="5")
    assert content(folder) == {"c": "5"}


def test_a_file_that_appears_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    def work() -> None:
        with output_folder(tmp_path / "out", "test") as place:
            write_text(place / "a", "1")
            (tmp_path / "out").mkdir()
            (tmp_path / "out" / "mine").write_text("x")

    with pytest.raises(InputError, match="mine"):
        work()
    assert content(tmp_path / "out") == {"mine": "x"}


def test_a_kill_while_writing_leaves_the_old_files_and_the_next_writing_succeeds(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    fill(folder, a="1")

    def work() -> None:
        with output_folder(folder, "test") as place:
            write_text(place / "a", "2")
            os.kill(os.getpid(), signal.SIGKILL)

    assert killed(work)
    assert (folder / "a").read_text() == "1"
    fill(folder, a="3")
    assert (folder / "a").read_text() == "3"
