"""An optional output that fails is left out, and everything else is written."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spinfilters.evaluation import recording_bound
from spinfilters.run import optional_outputs, predictions, smoother_convergence
from spinfilters.smoother import recursive_smoother as convergence_record
from tests.cli.failures import compared, of_casadi, singular

pytestmark = pytest.mark.usefixtures("few_figures", "unrendered", "prepared_once")
ESTIMATES_ALONE = ("--verdict", "filter")
"""Without the tests of their models, which no optional output shows."""


def test_a_bound_that_raises_is_left_out(
    poses: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording_bound, "_factors", of_casadi)
    estimates = compared(poses, tmp_path / "run", *ESTIMATES_ALONE, names=("mekf",))
    assert estimates["mekf"]["status"] != "failed"
    assert estimates["mekf"]["errors"]["bound"] is None


@pytest.mark.parametrize("error", [singular, of_casadi], ids=["numpy", "casadi"])
def test_a_prediction_that_raises_is_left_out(
    error: Callable[..., Any], poses: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(predictions, "predict_ahead", error)
    compared(poses, tmp_path / "run", "--predict", "5", *ESTIMATES_ALONE, names=("mekf", "ukf"))
    assert not (tmp_path / "run" / "prediction.png").exists()
    assert not (tmp_path / "run" / "mekf" / "prediction.csv").exists()


def test_a_prediction_of_one_estimator_that_is_not_finite_leaves_those_of_the_others(
    poses: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, count = predictions.predict_ahead, 0

    def predict(*arguments: Any) -> Any:
        nonlocal count
        count += 1
        found = real(*arguments)
        return replace(found, factor=found.factor * np.nan) if count % 2 else found

    monkeypatch.setattr(predictions, "predict_ahead", predict)
    compared(poses, tmp_path / "run", "--predict", "5", *ESTIMATES_ALONE, names=("mekf", "ukf"))
    assert (tmp_path / "run" / "prediction.png").exists()
    assert not (tmp_path / "run" / "mekf" / "prediction.csv").exists()
    assert (tmp_path / "run" / "ukf" / "prediction.csv").exists()


@pytest.mark.parametrize("solve", [0, 1, 12])
def test_convergence_ends_at_a_solve_that_raises(
    solve: int,
    tracks: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> None:
    if solve > 1:  # what no solve or one gives is drawn whole
        request.getfixturevalue("few_surfaces")
    real, count = convergence_record.SlidingSmoother.add, 0

    def add(smoother: Any, frame: Any, guess: Any = None) -> Any:
        nonlocal count
        count += 1
        return singular() if count > solve and recording else real(smoother, frame, guess)

    recording = False
    written = smoother_convergence.write_convergence

    def write(*arguments: Any) -> None:
        nonlocal recording, count
        recording, count = True, 0
        written(*arguments)
        recording = False

    monkeypatch.setattr(convergence_record.SlidingSmoother, "add", add)
    monkeypatch.setattr(optional_outputs.smoother_convergence, "write_convergence", write)
    compared(tracks, tmp_path / "run", "--convergence", *ESTIMATES_ALONE, names=("smoother",))
    assert (tmp_path / "run" / "convergence.png").exists()
    with np.load(tmp_path / "run" / "smoother" / "convergence.npz") as file:
        finite = np.isfinite(file["position"]).any(axis=(1, 2))
    np.testing.assert_array_equal(finite, np.arange(20) < solve)
