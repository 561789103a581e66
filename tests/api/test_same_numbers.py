"""The same numbers from a file, a data frame, a mapping and an array give the same estimates, bit for bit."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spinfilters
from spinfilters.plots import figures


@pytest.fixture
def from_file(own_csv: str, tmp_path: Path) -> spinfilters.Run:
    """Filters on the recording as a table with names."""
    path = tmp_path / "own.csv"
    path.write_text(own_csv)
    return spinfilters.compare(str(path), "mekf,ukf", units="rad/s")


@pytest.mark.parametrize("form", ["frame", "mapping", "array"])
def test_memory_gives_the_estimates_of_a_file(
    gyro: spinfilters.Dataset, from_file: spinfilters.Run, form: str
) -> None:
    stream = gyro.log.stream("gyro")
    rows = np.column_stack([stream.time, stream.values])
    columns = dict(zip(("time", "wx", "wy", "wz"), rows.T, strict=True))
    pandas = pytest.importorskip("pandas")
    given = {"frame": pandas.DataFrame(columns), "mapping": columns, "array": rows}[form]
    run = spinfilters.compare(given, "mekf,ukf", kind="gyro", units="rad/s")
    for name in from_file:
        ours, theirs = run[name].evaluation.history, from_file[name].evaluation.history
        for part in ("time", "mean", "factor", "nis"):
            np.testing.assert_array_equal(getattr(ours, part), getattr(theirs, part))
        assert run[name].status == from_file[name].status


def test_a_file_is_compared_as_it_is_loaded(gyro: spinfilters.Dataset, tmp_path: Path) -> None:
    stream = gyro.log.stream("gyro")
    path = tmp_path / "bare.csv"
    np.savetxt(path, np.column_stack([1e3 * stream.time, np.degrees(stream.values)]), delimiter=",")
    reading: dict[str, Any] = {"columns": "t,x,y,z", "unit": "deg/s", "clock": "ms"}
    loaded = spinfilters.compare(spinfilters.load(path, **reading), "mekf", verdict="filter")
    run = spinfilters.compare(path, "mekf", verdict="filter", **reading)
    np.testing.assert_array_equal(run["mekf"].evaluation.history.mean, loaded["mekf"].evaluation.history.mean)
    with pytest.raises(spinfilters.InputError, match="rate 5 says how to read a file"):
        spinfilters.compare(gyro, rate=5)


def test_memory_and_a_file_write_the_same_trajectories(
    gyro: spinfilters.Dataset, from_file: spinfilters.Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures, "_figures", lambda run: [])
    stream = gyro.log.stream("gyro")
    rows = np.column_stack([stream.time, stream.values])
    run = spinfilters.compare(rows, "mekf", kind="gyro", units="rad/s")
    written = [each.save(tmp_path / name) / "mekf" for each, name in ((run, "a"), (from_file, "b"))]
    for name in ("trajectory.csv", "trajectory.tum"):
        assert (written[0] / name).read_bytes() == (written[1] / name).read_bytes()
