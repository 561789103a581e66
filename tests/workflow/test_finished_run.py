"""What counts as a finished run: one whose numbers belong to the settings beside them."""

import os
import signal
from dataclasses import replace
from pathlib import Path

import pytest
from forked import killed

from spinfilters.logs.dataset import Dataset
from spinfilters.simulation.scenario import Scenario, simulate
from spinfilters.workflow import run_folder
from spinfilters.workflow.estimation import Comparison, compare_estimators
from spinfilters.workflow.preparation import prepare
from spinfilters.workflow.run_folder import finished_run, write_run
from spinfilters.workflow.segments import run_segments
from spinfilters.workflow.settings import Settings

EKF = Settings(estimators=("mekf",))
WITH_DRAG = replace(EKF, process=replace(EKF.process, drag=True))


def silent(*_: object) -> None:
    """Report no progress."""


def compared(dataset: Dataset, settings: Settings) -> Comparison:
    """A run."""
    return compare_estimators(prepare(dataset, settings), settings, silent)


@pytest.fixture
def gyro() -> Dataset:
    """A short recording."""
    return simulate(Scenario(kind="gyro", frames=12))


def test_numbers_are_not_taken_for_those_of_segments_made_later_beside_them(
    gyro: Dataset, tmp_path: Path
) -> None:
    write_run(tmp_path, compared(gyro, EKF), EKF)
    run_segments([gyro], tmp_path, WITH_DRAG, silent, silent)
    assert finished_run(tmp_path, gyro, WITH_DRAG) is None
    assert finished_run(tmp_path, gyro, EKF) is None


def test_segments_made_beside_a_run_with_the_same_settings_leave_it(gyro: Dataset, tmp_path: Path) -> None:
    write_run(tmp_path, compared(gyro, EKF), EKF)
    run_segments([gyro], tmp_path, EKF, silent, silent)
    assert finished_run(tmp_path, gyro, EKF) is not None


def test_a_kill_before_an_earlier_run_is_cleared_leaves_no_finished_one(
    gyro: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_run(tmp_path, compared(gyro, EKF), EKF)
    assert finished_run(tmp_path, gyro, EKF) is not None
    comparison = compared(gyro, WITH_DRAG)
    monkeypatch.setattr(run_folder, "_clear", lambda *_: os.kill(os.getpid(), signal.SIGKILL))
    assert killed(lambda: write_run(tmp_path, comparison, WITH_DRAG))
    assert finished_run(tmp_path, gyro, WITH_DRAG) is None
