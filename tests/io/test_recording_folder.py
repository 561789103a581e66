"""Folders of several recordings."""

from pathlib import Path

import pytest

from spinfilters.core.errors import InputError
from spinfilters.run.readers import read_dataset, recordings_in

TABLE = "time_s,wx,wy,wz\n0,1,2,3\n0.01,1,2,3\n"


def test_a_folder_of_tables_holds_recordings_and_says_so(tmp_path: Path) -> None:
    for name in ("b.csv", "a.csv", "LICENCE.txt", "notes.md"):
        (tmp_path / name).write_text(TABLE)
    assert [path.name for path in recordings_in(tmp_path)] == ["a.csv", "b.csv"]
    with pytest.raises(InputError, match=r"holds 2 recordings, such as a\.csv; .* --segment auto"):
        read_dataset(tmp_path)


def test_a_folder_of_data_sets_holds_recordings(tmp_path: Path) -> None:
    for name in ("0", "1"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "dataset.toml").write_text("kind = 'pose'")
    assert [path.name for path in recordings_in(tmp_path)] == ["0", "1"]
    assert not recordings_in(tmp_path / "0")


def test_a_single_recording_or_none_is_no_folder_of_them(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(TABLE)
    assert not recordings_in(tmp_path)
    assert not recordings_in(tmp_path / "a.csv")
    with pytest.raises(InputError, match="write it with a line kind"):
        read_dataset(tmp_path)
