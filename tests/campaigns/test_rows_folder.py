"""Rows survive a kill at any moment and a full disk; none stands twice."""

import json
from pathlib import Path
from typing import Any

import pytest

from spinfilters.campaigns.rows_folder import ROWS, RowsFolder, part_files, read_rows
from spinfilters.errors import InputError

FACTORS = ["estimator"]


def _row(run: int) -> dict[str, Any]:
    return {"run": run, "cell": 0, "seed": run, "estimator": "mekf", "outcome": "done", "nees": 0.1 * run}


def test_rows_are_read_in_the_order_of_runs(tmp_path: Path) -> None:
    with RowsFolder(tmp_path, FACTORS) as rows:
        for run in (3, 1, 2):
            rows.append(_row(run))
    table = read_rows(tmp_path, FACTORS)
    assert table["run"].to_pylist() == [1, 2, 3]
    assert table["nees"].to_pylist() == [0.1, 0.2, 0.1 * 3]
    assert RowsFolder(tmp_path, FACTORS).done() == {1, 2, 3}


def test_a_kill_leaves_a_journal_that_is_read_and_taken_over_without_its_cut_line(tmp_path: Path) -> None:
    rows = RowsFolder(tmp_path, FACTORS)
    for run in range(3):
        rows.append(_row(run))
    journal = tmp_path / ROWS / "000001.jsonl"
    assert rows._journal is not None
    rows._journal.close()
    with open(journal, "ab") as stream:
        stream.write(json.dumps(_row(3)).encode()[:-10])
    assert read_rows(tmp_path, FACTORS)["run"].to_pylist() == [0, 1, 2]
    assert RowsFolder(tmp_path, FACTORS).done() == {0, 1, 2}
    assert not journal.exists()
    assert [path.name for path in part_files(tmp_path / ROWS)] == ["000001.parquet"]


def test_a_journal_beside_its_part_counts_once(tmp_path: Path) -> None:
    with RowsFolder(tmp_path, FACTORS) as rows:
        rows.append(_row(0))
    (tmp_path / ROWS / "000001.jsonl").write_text(json.dumps(_row(0)) + "\n")
    assert len(read_rows(tmp_path, FACTORS)) == 1
    assert RowsFolder(tmp_path, FACTORS).done() == {0}


def test_parts_are_only_added(tmp_path: Path) -> None:
    for run in range(3):
        with RowsFolder(tmp_path, FACTORS) as rows:
            rows.append(_row(run))
    assert [path.name for path in part_files(tmp_path / ROWS)] == [f"00000{k}.parquet" for k in (1, 2, 3)]


def test_a_full_disk_is_one_line_and_loses_nothing(tmp_path: Path) -> None:
    rows = RowsFolder(tmp_path, FACTORS)
    rows.append(_row(0))
    kept = rows._journal
    with open("/dev/full", "wb", buffering=0) as full:
        rows._journal = full
        with pytest.raises(InputError, match="--resume"):
            rows.append(_row(1))
    assert kept is not None
    kept.close()
    assert read_rows(tmp_path, FACTORS)["run"].to_pylist() == [0]


def test_a_damaged_part_and_a_foreign_one_are_refused(tmp_path: Path) -> None:
    with RowsFolder(tmp_path, FACTORS) as rows:
        rows.append(_row(0))
    with pytest.raises(InputError, match="other columns"):
        read_rows(tmp_path, ["estimator", "weather"])
    (tmp_path / ROWS / "000001.parquet").write_bytes(b"PAR1 nothing PAR1")
    with pytest.raises(InputError, match="no Parquet file"):
        read_rows(tmp_path, FACTORS)
