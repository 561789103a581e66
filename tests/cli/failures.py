"""Errors of numerical libraries, and runs that must be whole in spite of them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spinfilters.cli.main import main

NAMES = ("mekf", "ukf", "smoother")


def singular(*_: object, **__: object) -> Any:
    """What LAPACK says of a matrix that it cannot solve."""
    raise np.linalg.LinAlgError("Singular matrix")


def of_casadi(*_: object, **__: object) -> Any:
    """What CasADi says, over several lines."""
    raise RuntimeError(
        "Error in Function::call for 'f' [SXFunction] at .../function.cpp:330:\nassertion failed"
    )


def compared(recording: Path, run: Path, *options: str, names: tuple[str, ...] = NAMES) -> dict[str, Any]:
    """The estimators of summary.json after a comparison, a drawing and a resumption that all end well."""
    arguments = ["compare", str(recording), "--estimators", ",".join(names), "-o", str(run), *options]
    assert main(arguments) == 0
    check_whole(run, names)
    assert main(["plot", str(run)]) == 0
    assert main([*arguments, "--resume"]) == 0
    return check_whole(run, names)


def check_whole(run: Path, names: tuple[str, ...]) -> dict[str, Any]:
    """A run folder that lacks nothing; its estimators' part of the summary."""
    document = json.loads((run / "summary.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    assert list(document["estimators"]) == list(names)
    for name in names:
        assert (run / name / "trajectory.csv").exists()
        assert (run / name / "history.npz").exists()
        assert not (run / name / "checkpoint.npz").exists()
    return document["estimators"]
