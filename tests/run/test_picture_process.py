"""Pictures drawn by further processes: the same ones, and all of them whatever becomes of a process."""

import os
import time
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from spinfilters.core.errors import InputError
from spinfilters.models.status import EstimatorStatus, Verdict
from spinfilters.plots.figures import early_pictures, figure_names, picture_files
from spinfilters.run import picture_process
from spinfilters.run.comparison_run import RunOutput, compare_into
from spinfilters.run.picture_process import (
    EarlyPictures,
    PictureProcess,
    PictureSource,
    draw_together,
    picture_processes,
)
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


@pytest.mark.parametrize("sends_data", [True, False])
def test_a_further_process_draws_the_same_pictures(run: Path, sends_data: bool) -> None:
    process = PictureProcess()
    try:
        source = PictureSource(read_figure_data(run)) if sends_data else PictureSource(folder=run)
        for name, wanted in pixels(run).items():
            content = process.drawn(name, source)
            assert content is not None
            np.testing.assert_array_equal(np.asarray(Image.open(BytesIO(content))), wanted, name)
    finally:
        process.close()


def test_the_twin_of_a_process_draws_the_same_pictures(run: Path) -> None:
    process = PictureProcess(has_twin=True)
    if process.twin is None:
        pytest.skip("no copies of processes on this system")
    try:
        data, name = PictureSource(read_figure_data(run)), picture_files(NAMES)[0]
        contents = [painter.drawn(name, data) for painter in (process.twin, process, process.twin)]
        assert contents[0] is not None
        assert contents == [contents[0]] * 3
    finally:
        process.close()


def test_pictures_of_further_processes_and_of_this_one_are_all_of_a_run(run: Path) -> None:
    alone, process = pixels(run), PictureProcess()
    try:
        together = redrawn(run, process)
    finally:
        process.close()
    assert set(together) == set(alone) == {*picture_files(NAMES)}
    for name, wanted in alone.items():
        np.testing.assert_array_equal(together[name], wanted, name)


class Recorded:
    """A process that draws nothing and keeps what it was asked for."""

    twin = None

    def __init__(self) -> None:
        self.asked: list[tuple[str, Any]] = []

    def drawn(self, name: str, source: Any) -> bytes:
        self.asked.append((name, source))
        return self.content(name, source)

    def content(self, name: str, source: Any) -> bytes:
        return f"{name} of {id(source)}".encode()


@pytest.mark.parametrize("changes", ["the verdict", "the estimates"])
def test_a_picture_drawn_early_stays_if_its_estimates_do_whatever_the_verdict(
    run: Path, changes: str
) -> None:
    data, process = read_figure_data(run), Recorded()
    setup: Any = SimpleNamespace(dataset=data.dataset)
    others: Any = [process]
    possible = {f"{name}.png" for name in figure_names(data)}
    early_names = {name for _, names in early_pictures(NAMES, NAMES) for name in names} & possible
    assert "summary.png" not in early_names  # it shows the verdicts
    doubted = [each.with_status(EstimatorStatus(Verdict.DEGRADED)) for each in data.evaluations]
    final = read_figure_data(run) if changes == "the estimates" else replace(data, evaluations=doubted)
    with EarlyPictures(others, NAMES) as early:
        early.take(setup, data.evaluations, {})
        while len(process.asked) < len(early_names):
            time.sleep(0.001)
        early.take_all(final)
        drawn = dict(iter(early.next_drawn, None))
    assert set(drawn) == possible
    of_final = {name for name, content in drawn.items() if content in (None, process.content(name, final))}
    assert of_final == (possible if changes == "the estimates" else possible - early_names)


def test_data_that_are_too_large_to_send_are_read_from_the_written_run(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(picture_process, "LARGEST_SENT", 0)
    data, process = read_figure_data(run), Recorded()
    setup: Any = SimpleNamespace(dataset=data.dataset)
    others: Any = [process]
    with EarlyPictures(others, NAMES) as early:
        early.take(setup, data.evaluations, {})
        early.take_all(data)
        assert early.next_drawn() is None
        early.take_all(data, run)
        drawn = dict(iter(early.next_drawn, None))
    assert set(drawn) == {f"{name}.png" for name in figure_names(data)}
    assert all(source == run for _, source in process.asked)


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
