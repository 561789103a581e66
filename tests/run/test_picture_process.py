"""Pictures drawn by further processes: the same ones, and all of them whatever becomes of a process."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from spinfilters.core.errors import InputError
from spinfilters.plots.figures import picture_files
from spinfilters.run.comparison_run import RunOutput, compare_into
from spinfilters.run.picture_process import PictureProcess, draw_together, picture_processes
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
    draw_together(read_figure_data(run), run, lambda *_: None, [process])
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
