"""Figures that Ctrl-C left undrawn: ``compare --resume`` draws them, and no estimator runs again."""

import os
from pathlib import Path

import pytest

from spinfilters.cli.main import main
from spinfilters.io.output_files import write_bytes
from spinfilters.plots import figures
from spinfilters.run import comparison_run
from spinfilters.run.run_folder import picture_files


def interrupted_at_rates(path: Path, data: bytes) -> None:
    """Write a picture, unless it is the second."""
    if path.name == "rates.png":
        raise KeyboardInterrupt
    write_bytes(path, data)


@pytest.mark.usefixtures("unrendered")
def test_a_run_whose_figures_were_interrupted_gets_those_it_lacks(
    originals: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    arguments = ["compare", str(originals / "gyro"), "--estimators", "mekf", "-o", str(run)]
    with monkeypatch.context() as patch:
        patch.setattr(figures, "write_bytes", interrupted_at_rates)
        assert main(arguments) == 2
    assert "the same command with --resume continues" in capsys.readouterr().err
    assert [path.name for path in run.glob("*.png")] == ["summary.png"]
    stamp = (run / "summary.png").stat().st_mtime_ns
    monkeypatch.setattr(comparison_run, "compare_estimators", None)
    assert main([*arguments, "--resume"]) == 0
    assert "is complete, made rates.png, inertia.png" in capsys.readouterr().out
    assert {path.name for path in run.glob("*.png")} == set(picture_files(["mekf"]))
    assert (run / "summary.png").stat().st_mtime_ns == stamp
    assert main([*arguments, "--resume"]) == 0
    assert "nothing is left to do" in capsys.readouterr().out


def test_a_run_that_was_there_before_is_not_what_an_interrupted_command_has_finished(
    originals: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    older = tmp_path / "run" / "mekf" / "checkpoint.npz"
    older.parent.mkdir(parents=True)
    older.touch()
    for path in (older, older.parent):
        os.utime(path, (1e9, 1e9))
    monkeypatch.setattr("spinfilters.run.readers.read_dataset", interrupted)
    assert main(["compare", str(originals / "gyro"), "-o", str(tmp_path / "run")]) == 2
    assert "--resume" not in capsys.readouterr().err
