"""An estimator that fails, in any way: the run goes on, and everything is written with `null` for what is not finite."""

import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spinfilters.cli.main import main
from spinfilters.evaluation import estimator_evaluation
from spinfilters.filters import timeline
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.inference import first_epochs
from spinfilters.models.state_layout import Gaussian
from spinfilters.run import comparison_run, estimators, preparation
from tests.cli.failures import compared, of_casadi, singular

pytestmark = pytest.mark.usefixtures("few_figures", "unrendered", "prepared_once", "single_epochs")


@pytest.fixture
def single_epochs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let filters take every epoch by itself, so that what replaces a step of theirs is called."""
    monkeypatch.setattr(timeline, "MOST_TOGETHER", 0)


@pytest.mark.parametrize("frame", [0, 7])
def test_a_filter_that_stops_being_finite_leaves_the_others_complete(
    frame: int,
    poses: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    found, updates = MultiplicativeEkf.belief, Counter[int]()

    def belief(estimator: MultiplicativeEkf) -> Gaussian:
        known = found.fget(estimator)  # pyright: ignore[reportOptionalCall]
        broken = updates[id(estimator)] > frame
        return replace(known, mean=known.mean * np.nan) if broken else known

    def update(estimator: MultiplicativeEkf, measurement: Any) -> Any:
        updates[id(estimator)] += 1
        return original(estimator, measurement)

    original = MultiplicativeEkf.update
    monkeypatch.setattr(MultiplicativeEkf, "belief", property(belief))
    monkeypatch.setattr(MultiplicativeEkf, "update", update)
    estimates = compared(poses, tmp_path / "run", names=("mekf", "ukf"))
    assert estimates["mekf"]["status"] == "failed"
    assert f"stopped being finite at epoch {frame}" in estimates["mekf"]["reasons"][0]
    assert estimates["ukf"]["frames"] == 20
    assert estimates["ukf"]["status"] != "failed"
    assert "failed" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("error", "place"),
    [(singular, "start"), (singular, "predict"), (of_casadi, "start"), (of_casadi, "update")],
)
def test_a_filter_that_raises_leaves_the_others_complete(
    error: Callable[..., Any], place: str, poses: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(MultiplicativeEkf, place, error)
    estimates = compared(poses, tmp_path / "run", names=("mekf", "ukf"))
    assert estimates["mekf"]["status"] == "failed"
    assert all("\n" not in reason and len(reason) < 300 for reason in estimates["mekf"]["reasons"])
    assert estimates["ukf"]["status"] != "failed"
    assert estimates["ukf"]["frames"] == 20


def nan_history(part: str, epochs: slice) -> Callable[..., Any]:
    """A smoother that ends with a part of its history not a number."""
    real = estimators.smooth_and_sample

    def smooth(*arguments: Any) -> Any:
        history = real(*arguments)
        array = getattr(history, part).copy()
        array[epochs] = np.nan
        return replace(history, **{part: array})

    return smooth


@pytest.mark.parametrize(
    ("part", "epochs"),
    [("mean", slice(None)), ("mean", slice(5, 9)), ("factor", slice(-1, None)), ("factor", slice(1))],
)
def test_a_smoother_that_ends_without_numbers_is_null_in_the_summary(
    part: str, epochs: slice, poses: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimators, "smooth_and_sample", nan_history(part, epochs))
    estimates = compared(poses, tmp_path / "run", "--predict", "5", names=("smoother", "mekf"))
    assert estimates["smoother"]["status"] == "failed"
    assert estimates["smoother"]["frames"] == 20
    last = epochs.indices(20)[1] == 20
    assert (estimates["smoother"]["principal_moments_std"][0] is None) is last
    assert estimates["mekf"]["status"] != "failed"
    assert (tmp_path / "run" / "mekf" / "prediction.csv").exists()
    assert not (tmp_path / "run" / "smoother" / "prediction.csv").exists()


@pytest.mark.parametrize("error", [singular, of_casadi], ids=["numpy", "casadi"])
def test_a_smoother_that_raises_leaves_the_others_complete(
    error: Callable[..., Any], poses: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimators, "smooth_and_sample", error)
    estimates = compared(poses, tmp_path / "run", names=("smoother", "ukf"))
    assert estimates["smoother"]["status"] == "failed"
    assert estimates["ukf"]["status"] != "failed"


def test_a_sliding_smoother_whose_last_solution_fails_keeps_what_it_said_on_the_way(
    tracks: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimators, "smoothed_history", singular)
    estimates = compared(tracks, tmp_path / "run", names=("smoother", "mekf"))
    assert estimates["smoother"]["status"] == "failed"
    assert estimates["smoother"]["frames"] == 20
    assert estimates["mekf"]["status"] != "failed"


def for_estimator(name: str, real: Callable[..., Any], error: Callable[..., Any]) -> Callable[..., Any]:
    """A function that raises for the history of one estimator."""

    def function(history: Any, *arguments: Any) -> Any:
        return error() if history.name == name else real(history, *arguments)

    return function


def test_an_evaluation_that_raises_fails_its_estimator_alone(
    poses: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = for_estimator("mekf", estimator_evaluation.normalised_errors, singular)
    monkeypatch.setattr(estimator_evaluation, "normalised_errors", broken)
    estimates = compared(poses, tmp_path / "run", names=("mekf", "ukf"))
    assert estimates["mekf"]["status"] == "failed"
    assert estimates["mekf"]["errors"] is None
    assert estimates["ukf"]["errors"]["nees_per_dof"] > 0


def test_a_body_that_cannot_be_evaluated_fails_its_estimator_alone(
    poses: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = estimator_evaluation.trajectory_of

    def trajectory_of(history: Any) -> Any:
        return singular() if history.name == "mekf" and np.isfinite(history.mean).all() else real(history)

    monkeypatch.setattr(estimator_evaluation, "trajectory_of", trajectory_of)
    estimates = compared(poses, tmp_path / "run", names=("mekf", "ukf"))
    assert estimates["mekf"]["status"] == "failed"
    assert estimates["mekf"]["principal_moments"] == [None, None, None]
    assert estimates["mekf"]["k1"] is None
    assert estimates["ukf"]["status"] != "failed"


@pytest.mark.parametrize("recording", ["poses", "tracks"])
def test_first_frames_that_cannot_be_smoothed_fail_every_estimator_with_the_reason(
    recording: str, request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(first_epochs, "initialise", singular)
    monkeypatch.setattr(comparison_run, "prepare", preparation.prepare)
    estimates = compared(request.getfixturevalue(recording), tmp_path / "run")
    for estimate in estimates.values():
        assert estimate["status"] == "failed"
        assert any("Singular matrix" in reason for reason in estimate["reasons"])
        assert estimate["principal_moments"] == [None, None, None]


def test_histories_of_any_numbers_are_drawn_or_refused_in_one_line(
    poses: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    arguments = ["compare", str(poses), "--estimators", "mekf", "-o", str(run)]
    assert main(arguments) == 0
    for name in ("mean", "factor", "nis", "runtime", "time"):
        for value in (np.nan, np.inf, -1e308, 1e308):
            copy = tmp_path / "copy"
            shutil.copytree(run, copy)
            path = copy / "mekf" / "history.npz"
            with np.load(path) as file:
                arrays = dict(file)
            arrays[name][4:] = value
            np.savez(path, **arrays)  # pyright: ignore[reportArgumentType]
            capsys.readouterr()
            code = main(["plot", str(copy)])
            message = capsys.readouterr().err
            assert code == (2 if name == "time" else 0), (name, value, message)
            assert len(message.splitlines()) == (name == "time")
            assert main([*arguments[:-1], str(copy), "--resume"]) == code
            shutil.rmtree(copy)
