"""Rows survive a kill at any moment and a full disk; none stands twice."""

import json
import os
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from spinfilters.campaigns.row_columns import schema
from spinfilters.campaigns.rows_folder import ROWS, RowsFolder, part_files, read_rows, write_part
from spinfilters.core.errors import InputError

FACTORS = ["estimator"]
LEVELS = [{"estimator": "mekf"}, {"estimator": "ukf"}]
"""Of a study of two cells."""
DAMAGE = {
    "a negative run": {"run": -1},
    "a run of another study": {"run": 1000},
    "a run beyond 64 bits": {"run": 2**70},
    "a run that is true": {"run": True},
    "a run that is a text": {"run": "2"},
    "a run that is no whole number": {"run": 2.0},
    "another seed": {"seed": 7},
    "a cell that is not there": {"cell": 5},
    "another level": {"estimator": "magic"},
    "a number as a text": {"nees": "0.1"},
    "a number that is a list": {"nees": [0.1]},
    "a truth value that is a number": {"right": 2},
    "a whole number with a fraction": {"epochs": 1.5},
    "a whole number beyond 64 bits": {"epochs": 2**64},
    "a number of 400 digits": {"nees": 10**400},
    "a text that is a number": {"reason": 3},
    "a text that is no Unicode": {"reason": "\ud800"},
    "a list of texts": {"nees_over_time": ["x"]},
    "a list that is a mapping": {"nees_over_time": {}},
    "an unknown outcome": {"outcome": "dine"},
    "an unknown column": {"neer": 1.0},
}
LINES = {
    "no JSON": b'{"run": 2, "ce',
    "not UTF-8": b'{"run": 2, "outcome": "\xff"}',
    "of zeros": bytes(40),
    "nested without end": b"[" * 200_000,
    "a list": b"[2]",
    "a number of 5000 digits": b'{"run": ' + b"9" * 5000 + b"}",
    "two rows in one": b'{"run": 2}{"run": 3}',
    "null": b"null",
}


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


def test_a_part_with_other_metrics_is_read_with_those_that_both_know(tmp_path: Path) -> None:
    with RowsFolder(tmp_path, FACTORS) as rows:
        rows.append(_row(0))
    part = tmp_path / ROWS / "000001.parquet"
    table = pq.read_table(part).drop_columns(["share_used"])
    pq.write_table(table.append_column("of_a_plug_in", pa.array([1.0])), part)
    found = read_rows(tmp_path, FACTORS)
    assert found.schema == schema(FACTORS)
    assert found["nees"].to_pylist() == [0.0]
    assert found["share_used"].to_pylist() == [None]


def _study_row(run: int) -> dict[str, Any]:
    return {"run": run, "cell": run % 2, "seed": run // 2, **LEVELS[run % 2], "outcome": "done", "nees": 0.1}


@pytest.mark.parametrize("damage", [*DAMAGE, *LINES])
def test_a_damaged_row_is_set_aside_and_its_run_made_again(damage: str, tmp_path: Path) -> None:
    line = LINES.get(damage) or json.dumps(_study_row(2) | DAMAGE[damage]).encode()
    (tmp_path / ROWS).mkdir()
    journal = tmp_path / ROWS / "000001.jsonl"
    whole = [json.dumps(_study_row(run)).encode() for run in (0, 1)]
    journal.write_bytes(b"\n".join([whole[0], line, whole[1], b""]))
    assert read_rows(tmp_path, FACTORS, levels=LEVELS)["run"].to_pylist() == [0, 1]
    assert RowsFolder(tmp_path, FACTORS, LEVELS).done() == {0, 1}
    assert journal.with_suffix(".damaged").read_bytes() == line + b"\n"
    assert read_rows(tmp_path, FACTORS, levels=LEVELS)["run"].to_pylist() == [0, 1]


def test_a_part_that_an_earlier_version_spoiled_counts_its_true_rows_alone(tmp_path: Path) -> None:
    with RowsFolder(tmp_path, FACTORS) as rows:
        for row in (_study_row(0), _study_row(1), _study_row(2) | {"run": -1}, _study_row(3) | {"seed": 9}):
            rows.append(row)
    write_part(tmp_path / ROWS / "000002.parquet", [_study_row(2) | {"run": -1}], schema(FACTORS))
    assert RowsFolder(tmp_path, FACTORS, LEVELS).done() == {0, 1}
    assert read_rows(tmp_path, FACTORS, levels=LEVELS)["run"].to_pylist() == [0, 1]


def test_a_journal_that_is_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    (tmp_path / ROWS).mkdir()
    os.mkfifo(tmp_path / ROWS / "000001.jsonl")
    with pytest.raises(InputError, match="pipe"):
        RowsFolder(tmp_path, FACTORS)


def test_rows_that_are_written_together_leave_whole_parts_and_no_journal(tmp_path: Path) -> None:
    with RowsFolder(tmp_path, FACTORS, together=4) as rows:
        for run in range(10):
            rows.append(_row(run))
    assert [len(pq.read_table(path)) for path in part_files(tmp_path / ROWS)] == [4, 4, 2]
    assert not list((tmp_path / ROWS).glob("*.jsonl"))
    assert read_rows(tmp_path, FACTORS)["run"].to_pylist() == list(range(10))


def test_a_row_that_fits_no_column_is_set_aside_from_those_written_together(tmp_path: Path) -> None:
    with RowsFolder(tmp_path, FACTORS, LEVELS[:1], together=4) as rows:
        for run in range(3):
            rows.append(_row(run) | ({"nees": "0.1"} if run == 1 else {}))
    assert read_rows(tmp_path, FACTORS)["run"].to_pylist() == [0, 2]
    assert len(list((tmp_path / ROWS).glob("*.damaged"))) == 1
