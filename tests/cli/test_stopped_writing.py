"""A full disk or Ctrl-C at any file of a run: one line, nothing half written, and ``--resume`` ends with the same bits."""

import errno
import os
from pathlib import Path

import pytest

from spinfilters.cli.main import main

pytestmark = pytest.mark.usefixtures("few_figures", "unrendered", "prepared_once")


def results(run: Path) -> dict[str, bytes]:
    """What must come out alike."""
    names = ("trajectory.csv", "trajectory.tum", "prediction.csv")
    return {name: (run / "mekf" / name).read_bytes() for name in names}


@pytest.mark.parametrize(
    "error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()], ids=["full", "ctrl-c"]
)
def test_a_run_that_is_stopped_at_any_file_is_completed_by_resuming(
    error: BaseException,
    originals: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    replace, left = os.replace, 0

    def failing(source: Path, target: Path) -> None:
        nonlocal left
        left -= 1
        if left == -1:
            raise error
        replace(source, target)

    asked = ["--estimators", "mekf", "--verdict", "filter", "--predict", "2"]
    arguments = ["compare", str(originals / "gyro"), *asked, "-o"]
    assert main([*arguments, str(tmp_path / "whole")]) == 0
    wanted, stopped, code = results(tmp_path / "whole"), 0, 2
    while code == 2:
        run, left = tmp_path / f"stopped{stopped}", stopped
        capsys.readouterr()
        with monkeypatch.context() as patch:
            patch.setattr(os, "replace", failing)
            code = main([*arguments, str(run)])
        message = capsys.readouterr().err
        assert len(message.splitlines()) == (code == 2), message
        assert not [path for path in run.rglob("*") if path.name.endswith(".part") or path.name == ".lock"]
        assert main([*arguments, str(run), "--resume"]) == 0
        assert results(run) == wanted
        stopped += 1
    assert stopped > 10
