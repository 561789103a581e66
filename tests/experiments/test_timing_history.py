"""Times are compared with the last run of the same machine alone."""

import json
from dataclasses import asdict
from pathlib import Path

import pytest

from experiments.benchmarks.timing_history import Timings, compared, read_history
from spinfilters.core.errors import InputError

BEFORE = Timings("2026-01-01T00:00:00+00:00", "old", "this", {"a": 10.0, "b": 10.0, "c": 10.0})
ELSEWHERE = Timings("2026-01-02T00:00:00+00:00", "other", "that", {"a": 1.0, "b": 1.0, "c": 1.0})
NOW = Timings("2026-01-03T00:00:00+00:00", "new", "this", {"a": 11.5, "b": 10.5, "c": 8.0, "d": 1.0})


def test_a_change_of_a_tenth_is_told_and_less_is_not() -> None:
    _, slower, same, faster, new = compared([BEFORE, ELSEWHERE], NOW)
    assert slower.endswith("+15.0 %  SLOWER")
    assert same.endswith("+5.0 %")
    assert faster.endswith("-20.0 %  faster")
    assert new.endswith("1.000 ms")


def test_the_first_run_of_a_machine_is_compared_with_nothing() -> None:
    first, *_ = compared([ELSEWHERE], NOW)
    assert first.endswith("nothing yet")


def test_a_history_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "timings.jsonl"
    assert read_history(path) == []
    path.write_text("".join(json.dumps(asdict(run)) + "\n" for run in (BEFORE, NOW)))
    assert read_history(path) == [BEFORE, NOW]


def test_a_damaged_line_is_named(tmp_path: Path) -> None:
    path = tmp_path / "timings.jsonl"
    path.write_text(json.dumps(asdict(BEFORE)) + "\n{\n")
    with pytest.raises(InputError, match="line 2"):
        read_history(path)
