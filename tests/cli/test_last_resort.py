"""What a command says of an error that nobody foresaw, and of names that are no text."""

import os
import shutil
from pathlib import Path

import pytest
from faults import refusal

from spinfilters.cli.main import main
from spinfilters.simulation import scenario


def fail(_: object) -> None:
    """An error that is no one's fault but the program's."""
    raise ValueError("shapes differ\nin two lines")


def test_an_unforeseen_error_is_one_line_that_names_its_place(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("SPINFILTERS_DEBUG", raising=False)
    monkeypatch.setattr(scenario, "simulate", fail)
    said = refusal(capsys, "compare")
    assert "unexpected ValueError in spinfilters/cli/compare.py:" in said
    assert "_dataset" in said
    assert "SPINFILTERS_DEBUG=1" in said


def test_with_debugging_the_whole_trace_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SPINFILTERS_DEBUG", "1")
    monkeypatch.setattr(scenario, "simulate", fail)
    with pytest.raises(ValueError, match="shapes differ"):
        main(["compare"])


def test_a_long_path_leaves_room_for_what_is_wrong(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refusal(capsys, "compare", str(tmp_path / ("a" * 200) / ("b" * 200)))
    assert len(said) < 300
    assert "check the path" in said


@pytest.mark.usefixtures("few_figures")
@pytest.mark.parametrize("name", [b"a\xffb.csv", b"[red]a[bold].csv", b"a\x1b[2Jb.csv"])
def test_a_recording_of_any_name_is_estimated(
    name: bytes, originals: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording, run = tmp_path / os.fsdecode(name), tmp_path / os.fsdecode(b"run \xff [bold]")
    shutil.copyfile(originals / "gyro" / "gyro.csv", recording)
    assert main(["compare", str(recording), "--estimators", "mekf", "-o", str(run)]) == 0
    assert (run / "summary.json").is_file()
    assert "[bold]" in capsys.readouterr().out
