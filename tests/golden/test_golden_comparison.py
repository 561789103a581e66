"""The comparison of golden runs sees a changed bit, and nothing of what a clock gives."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.golden.comparison import differences
from tests.golden.runs import GOLDEN_RUNS


def recorded(folder: Path, value: float, runtime: float) -> Path:
    """A recording with one file of each kind that is compared."""
    place = folder / "run"
    place.mkdir(parents=True)
    np.savez(place / "history.npz", mean=np.array([1.0, value]), runtime=np.array(runtime))
    summary = {"estimators": {"mekf": {"k1": value, "runtime_s": {"total": runtime}}}}
    (place / "summary.json").write_text(json.dumps(summary))
    (place / "trajectory.csv").write_text(f"time_s,rx\n0,{value!r}\n")
    (place / "picture.png").write_bytes(str(runtime).encode())
    return folder


def test_recordings_that_differ_only_in_run_times_are_the_same(tmp_path: Path) -> None:
    assert list(differences(recorded(tmp_path / "a", 0.1, 1.0), recorded(tmp_path / "b", 0.1, 2.0))) == []


def test_one_bit_is_seen_in_every_kind_of_file(tmp_path: Path) -> None:
    one, other = recorded(tmp_path / "a", 0.1, 1.0), recorded(tmp_path / "b", np.nextafter(0.1, 1.0), 1.0)
    found = list(differences(one, other))
    assert [line.split(":")[0] for line in found] == [
        "run/history.npz",
        "run/summary.json",
        "run/trajectory.csv",
    ]


def test_a_missing_file_is_a_difference(tmp_path: Path) -> None:
    one, other = recorded(tmp_path / "a", 0.1, 1.0), recorded(tmp_path / "b", 0.1, 1.0)
    (other / "run" / "trajectory.csv").unlink()
    assert len(list(differences(one, other))) == 1


def test_not_a_number_equals_itself(tmp_path: Path) -> None:
    nan = float("nan")
    assert list(differences(recorded(tmp_path / "a", nan, 1.0), recorded(tmp_path / "b", nan, 1.0))) == []


@pytest.mark.parametrize("run", GOLDEN_RUNS, ids=lambda run: run.name)
def test_a_golden_run_names_its_output_folder_within_its_own(run) -> None:
    assert all("/" not in word for command in run.commands for word in command.split())
