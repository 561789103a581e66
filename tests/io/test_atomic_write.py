"""A file appears complete or not at all."""

import errno
import json
import math
import os
from pathlib import Path

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.io.output_files import (
    atomic_file,
    make_folder,
    write_bytes,
    write_json,
    write_text,
    write_toml,
)


def no_space(descriptor: int) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_file_is_written_and_nothing_else_is_left(tmp_path: Path) -> None:
    write_bytes(tmp_path / "plot.png", b"\x89PNG")
    assert (tmp_path / "plot.png").read_bytes() == b"\x89PNG"
    assert os.listdir(tmp_path) == ["plot.png"]


def test_a_file_that_is_there_is_replaced(tmp_path: Path) -> None:
    for text in ("old, and longer", "new µ"):
        write_text(tmp_path / "a.txt", text)
    assert (tmp_path / "a.txt").read_text(encoding="utf-8") == "new µ"


def test_a_full_disk_leaves_the_old_file_and_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")
    monkeypatch.setattr(os, "fsync", no_space)
    with pytest.raises(InputError, match=r"a\.txt: cannot be written \(No space left on device\)"):
        write_text(path, "new")
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_failure_in_the_block_leaves_the_old_file_and_is_not_disguised(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")
    with pytest.raises(FileNotFoundError, match="missing"), atomic_file(path) as stream:
        stream.writelines([b"half", (tmp_path / "missing").read_bytes()])
    with pytest.raises(ZeroDivisionError), atomic_file(path) as stream:
        stream.write(bytes(1 // 0))
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_folder_that_is_missing_or_in_the_way_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"missing/a\.txt: cannot be written"):
        write_text(tmp_path / "missing" / "a.txt", "x")
    with pytest.raises(InputError, match="cannot be written"):
        write_text(tmp_path, "x")
    write_text(tmp_path / "file", "x")
    with pytest.raises(InputError, match="cannot be made a folder"):
        make_folder(tmp_path / "file" / "below")


def test_a_pipe_or_a_device_stays_what_it_is(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match="a device or a pipe"):
        write_bytes(pipe, b"data")
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]


def test_permissions_are_those_of_any_new_file(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    write_text(tmp_path / "atomic", "x")
    assert (tmp_path / "atomic").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_json_is_read_back_with_null_for_what_is_not_finite_and_holds_no_array(tmp_path: Path) -> None:
    document = {"rms": 1e-3, "names": ["µ"], "none": None}
    write_json(tmp_path / "a.json", document)
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8")) == document
    write_json(tmp_path / "a.json", {"rms": [math.nan, (math.inf, 1.0)], "bound": {"x": np.float64(-np.inf)}})
    read = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    assert read == {"rms": [None, [None, 1.0]], "bound": {"x": None}}
    with pytest.raises(InputError, match=r"b\.json"):
        write_json(tmp_path / "b.json", {"rms": np.zeros(2)})
    assert os.listdir(tmp_path) == ["a.json"]


def test_toml_cannot_hold_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.toml"):
        write_toml(tmp_path / "a.toml", {"x": None})
    assert os.listdir(tmp_path) == []
