"""One segment that cannot be used stops none of the others: it gets its row, with the reason."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spinfilters.cli.main import main
from spinfilters.core.errors import InputError
from spinfilters.inference.setup import Setup
from spinfilters.run import estimation, segment_runs
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate

HEADER = '"Time (s)","Gyroscope x (rad/s)","Gyroscope y (rad/s)","Gyroscope z (rad/s)","Absolute (rad/s)"'
pytestmark = pytest.mark.usefixtures("unrendered")


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A phyphox export of four kept segments; the third lies beyond the end of the recording."""
    folder = tmp_path / "phyphox"
    (folder / "meta").mkdir(parents=True)
    gyro = simulate(Scenario.simplified(kind="gyro", rate_rpm=RICH_RPM, epochs=120, interval=0.1)).log.stream(
        "gyro"
    )
    rows = np.column_stack([gyro.time, gyro.values, np.linalg.norm(gyro.values, axis=1)])
    lines = [HEADER, *(",".join(map(repr, row)) for row in rows.tolist())]
    (folder / "Raw Data.csv").write_text("\n".join(lines) + "\n")
    marks = ["segment,start,end,keep,comment", "1,0,2,,a", "2,3,5,,b", "3,80,90,,c", "4,6,8,,d"]
    (folder / "meta" / "segments.csv").write_text("\n".join(marks) + "\n")
    return folder


def rows_of(recording: Path, run: Path) -> dict[str, Any]:
    """segments.json after a comparison of all segments, which must end well."""
    arguments = ["compare", str(recording), "--segment", "all", "--estimators", "mekf", "-o", str(run)]
    assert main(arguments) == 0
    return json.loads((run / "segments.json").read_text(), parse_constant=pytest.fail)["segments"]


def test_a_segment_outside_the_recording_or_without_a_start_has_its_row(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refusing(dataset: Any, settings: Settings) -> Setup:
        if dataset.segment.number == 1:
            raise InputError("the body does not rotate; give another recording")
        return prepare(dataset, settings)

    monkeypatch.setattr(segment_runs, "prepare", refusing)
    found = rows_of(recording, tmp_path / "run")
    assert list(found) == ["1", "2", "3", "4"]
    assert "does not rotate" in found["1"]["failure"]
    assert "segment 3 runs from" in found["3"]["failure"]
    for number in ("2", "4"):
        assert found[number]["mekf"]["frames"] == 21
    assert (tmp_path / "run" / "throws-mekf.png").exists()
    printed = capsys.readouterr().out
    assert "does not rotate" in " ".join(printed.split())


def test_segments_whose_estimates_are_not_finite_are_in_the_table_and_not_in_the_picture(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(estimation, "_with_initialisation", with_nan(estimation._with_initialisation))
    found = rows_of(recording, tmp_path / "run")
    for number in ("1", "2", "4"):
        assert found[number]["mekf"]["status"] == "failed"
        assert found[number]["mekf"]["principal_moments"] == [None, None, None]
    assert not (tmp_path / "run" / "throws-mekf.png").exists()
    assert "throws-mekf" not in capsys.readouterr().out
    monkeypatch.undo()
    assert list(rows_of(recording, tmp_path / "run")) == ["1", "2", "3", "4"]


def with_nan(real: Any) -> Any:
    """A history of which nothing is a number."""

    def start(*arguments: Any) -> Any:
        history = real(*arguments)
        return replace(history, mean=history.mean * np.nan)

    return start


def test_a_folder_of_others_in_the_place_of_a_segment_is_its_failure_alone(
    recording: Path, tmp_path: Path
) -> None:
    place = tmp_path / "run" / "segments" / "002"
    assert rows_of(recording, tmp_path / "run")["2"]["mekf"]["frames"] == 21
    for path in place.rglob("*"):
        if path.is_file():
            path.unlink()
    (place / "notes.md").write_text("mine")
    found = rows_of(recording, tmp_path / "run")
    assert "not a run folder" in found["2"]["failure"]
    assert found["4"]["mekf"]["frames"] == 21
    assert (place / "notes.md").read_text() == "mine"
