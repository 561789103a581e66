"""``spinfilters segments`` and ``compare --segment auto``."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spinfilters.cli.main import main
from spinfilters.io.dataset import Dataset
from spinfilters.run.segment_runs import SegmentResult
from tests.run.throws import carried


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Two throws, whose columns do not say their unit."""
    log = carried(0.005, np.random.default_rng(1))
    path = tmp_path / "throws.csv"
    rows = np.column_stack([log.time, log.rates])
    np.savetxt(path, rows, delimiter=",", header="time,gyroX,gyroY,gyroZ", comments="")
    return path


def test_flights_are_listed_and_the_unit_is_asked_for(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["segments", str(recording)]) == 2
    assert "give --unit deg/s or rad/s (Python: unit=...)" in capsys.readouterr().err
    assert main(["segments", str(recording), "--unit", "rad/s"]) == 0
    printed = capsys.readouterr().out
    assert "2.000" in printed
    assert "4.5" in printed
    assert "--segment auto" in printed


def test_all_flights_are_compared_and_pooled(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def estimated(datasets: Sequence[Dataset], *_: object) -> list[SegmentResult]:
        numbers = [each.segment.number or 0 for each in datasets if each.segment is not None]
        return [SegmentResult(number, {"estimators": {"mekf": estimate(number)}}) for number in numbers]

    monkeypatch.setattr("spinfilters.run.segment_runs.run_segments", estimated)
    run = tmp_path / "run"
    arguments = ["compare", str(recording), "--unit", "rad/s", "--segment", "auto", "--estimators", "mekf"]
    assert main([*arguments, "-o", str(run)]) == 0
    document = json.loads((run / "segments.json").read_text())
    assert list(document["segments"]) == ["1", "2"]
    np.testing.assert_allclose(document["pooled"]["mekf"]["ratios"], [0.2005, 0.8])
    assert "mekf: pooled J1/J3 0.2005 ± 0.0021, J2/J3 0.8000 ± 0.0021, chi-square" in capsys.readouterr().out


def test_flights_of_all_recordings_in_a_folder_are_compared_and_numbered_through(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "many"
    folder.mkdir()
    for name in ("a.csv", "c.csv"):
        (folder / name).write_text(recording.read_text())
    (folder / "b.csv").write_text("time_s,wx,wy,wz\n" + "".join(f"{0.01 * k},0,0,0\n" for k in range(100)))

    def estimated(datasets: Sequence[Dataset], *_: object) -> list[SegmentResult]:
        assert ["c.csv" in each.description for each in datasets] == [False, False, True, True]
        numbers = [each.segment.number or 0 for each in datasets if each.segment is not None]
        return [SegmentResult(number, {"estimators": {"mekf": estimate(number)}}) for number in numbers]

    monkeypatch.setattr("spinfilters.run.segment_runs.run_segments", estimated)
    run = tmp_path / "run"
    arguments = ["compare", str(folder), "--unit", "rad/s", "--segment", "auto", "--estimators", "mekf"]
    assert main([*arguments, "-o", str(run)]) == 0
    document = json.loads((run / "segments.json").read_text())
    assert list(document["segments"]) == ["1", "2", "3", "4", "5"]
    assert "b.csv" in document["segments"]["3"]["failure"]


def estimate(number: int) -> dict[str, Any]:
    """An estimator's entry of a segment's summary."""
    covariance = np.diag([9e-6, 9e-6, 0.0])
    return {
        "status": "ok",
        "reasons": [],
        "drag_per_rad": None,
        "principal_moments": [0.199 + 0.001 * number, 0.8, 1.0],
        "principal_moments_std": np.sqrt(np.diag(covariance)).tolist(),
        "principal_moments_cov": covariance.tolist(),
    }


def test_what_cannot_be_stated_is_refused(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, says in (
        (["compare", "--unit", "deg/s"], "unit does not apply to the bundled example"),
        (["compare", str(recording.parent), "--rate", "5"], "rate does not apply to a folder"),
        (["compare", str(recording), "--unit", "mph"], "unit 'mph' is unknown"),
        (["compare", str(recording), "--rate", "0"], "--rate"),
    ):
        assert _exit_code(arguments) == 2
        assert says in capsys.readouterr().err


def _exit_code(arguments: list[str]) -> object:
    try:
        return main(arguments)
    except SystemExit as error:
        return error.code
