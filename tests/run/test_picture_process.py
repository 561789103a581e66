"""Pictures drawn by further processes: the same ones, and all of them whatever becomes of a process."""

import os
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from PIL import Image

from spinfilters.core.errors import InputError
from spinfilters.models.status import EstimatorStatus, Verdict
from spinfilters.plots.figures import early_pictures, picture_files
from spinfilters.run.comparison_run import RunOutput, compare_into
from spinfilters.run.picture_process import EarlyPictures, PictureProcess, draw_together, picture_processes
from spinfilters.run.run_folder import read_figure_data
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate

NAMES = ("mekf",)
Pixels = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """60 epochs of a gyro, drawn by the process of the test."""
    folder = tmp_path_factory.mktemp("run") / "run"
    dataset = simulate(Scenario.simplified(kind="gyro", rate_rpm=RICH_RPM, epochs=60))
    compare_into(dataset, Settings(estimators=NAMES), RunOutput(folder))
    return folder


def pixels(folder: Path) -> Pixels:
    return {path.name: np.asarray(Image.open(path)) for path in folder.glob("*.png")}


def redrawn(run: Path, process: PictureProcess) -> Pixels:
    for path in run.glob("*.png"):
        path.unlink()
    with EarlyPictures([process], NAMES) as early:
        draw_together(read_figure_data(run), run, lambda *_: None, early)
    return pixels(run)


def test_a_further_process_draws_the_same_pictures(run: Path) -> None:
    alone, process = pixels(run), PictureProcess()
    try:
        assert process.open(run)  # it is ready, and takes its share
        last = picture_files(NAMES)[-1]
        (run / last).unlink()
        assert process.draw(last)
        together = redrawn(run, process)
    finally:
        process.close()
    assert set(together) == set(alone) == {*picture_files(NAMES)}
    for name, wanted in alone.items():
        np.testing.assert_array_equal(together[name], wanted, name)


def test_pictures_that_a_process_keeps_until_the_run_is_written_are_the_same(run: Path) -> None:
    alone, process = pixels(run), PictureProcess()
    kept = [name for _, names in early_pictures(NAMES, NAMES) for name in names]
    assert "summary.png" not in kept  # it shows the verdicts
    try:
        for name in kept:
            (run / name).unlink(missing_ok=True)
            assert process.keep(run, NAMES, name)
            assert not (run / name).exists()
            if name in alone:
                assert process.write(name, run)
    finally:
        process.close()
    together = pixels(run)
    assert set(together) == set(alone)
    for name, wanted in alone.items():
        np.testing.assert_array_equal(together[name], wanted, name)


def test_a_picture_kept_is_that_of_the_run_if_its_estimates_are_and_whatever_the_verdict(run: Path) -> None:
    data, kept = read_figure_data(run), threading.Event()
    setup: Any = SimpleNamespace(dataset=data.dataset)
    process: Any = Mock(keep=lambda *_: not kept.set())
    doubted = EstimatorStatus(Verdict.DEGRADED)
    with EarlyPictures([process], NAMES) as early:
        early.take(setup, data.evaluations, {})
        assert kept.wait(60.0)
        judged = [each.with_status(doubted) for each in data.evaluations]
        assert early.end(replace(data, evaluations=judged)) == {process: early.end(data)[process]}
        assert early.end(data)[process]
        assert not early.end(read_figure_data(run))[process]  # other arrays


def test_what_a_process_that_ended_should_have_drawn_is_drawn(run: Path) -> None:
    process = PictureProcess()
    process.close()
    assert set(redrawn(run, process)) == {*picture_files(NAMES)}
    assert not list(run.glob("**/*.part"))


@pytest.mark.parametrize(("cores", "stated", "count"), [(1, "", 0), (2, "0", 0), (2, "", 1), (64, "2", 2)])
def test_a_process_for_each_further_core(
    cores: int, stated: str, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(cores)))
    monkeypatch.setenv("SPINFILTERS_PICTURE_PROCESSES", stated)
    with picture_processes(True) as processes:
        assert len(processes) == count


@pytest.mark.parametrize("stated", ["abc", "-1", "1.5"])
def test_a_stated_number_that_is_none_is_refused(stated: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SPINFILTERS_PICTURE_PROCESSES", stated)
    with pytest.raises(InputError, match=f"SPINFILTERS_PICTURE_PROCESSES: '{stated}' is not allowed; give"):
        picture_processes(True).__enter__()


def test_none_is_started_where_nothing_is_drawn() -> None:
    with picture_processes(False) as processes:
        assert not processes
