"""What counts as a finished run: one whose numbers belong to the settings beside them."""

import os
import signal
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from forked import killed
from plain_comparison import plain_comparison
from swapped_ids import swapped

from spinfilters.io.camera import StereoRig
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.run import run_folder
from spinfilters.run.estimation import Comparison
from spinfilters.run.run_folder import finished_run, write_run
from spinfilters.run.segment_runs import run_segments
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate

EKF = Settings(estimators=("mekf",))
WITH_DRAG = replace(EKF, process=replace(EKF.process, drag=True))


def silent(*_: object) -> None:
    """Report no progress."""


def compared(dataset: Dataset, settings: Settings) -> Comparison:
    """A run."""
    return plain_comparison(dataset, settings)


@pytest.fixture
def gyro() -> Dataset:
    """A short recording."""
    return simulate(Scenario.simplified(kind="gyro", epochs=12))


def test_numbers_are_not_taken_for_those_of_segments_made_later_beside_them(
    gyro: Dataset, tmp_path: Path
) -> None:
    write_run(tmp_path, compared(gyro, EKF), EKF)
    run_segments([gyro], tmp_path, WITH_DRAG, silent)
    assert finished_run(tmp_path, gyro, WITH_DRAG) is None
    assert finished_run(tmp_path, gyro, EKF) is None


def test_segments_made_beside_a_run_with_the_same_settings_leave_it(gyro: Dataset, tmp_path: Path) -> None:
    write_run(tmp_path, compared(gyro, EKF), EKF)
    run_segments([gyro], tmp_path, EKF, silent)
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


def with_tracks(dataset: Dataset, change: Callable[[MeasurementStream], MeasurementStream]) -> Dataset:
    """The data set with other tracks."""
    streams = [change(each) if each.sensor == "stereo" else each for each in dataset.log.streams]
    return replace(dataset, log=MeasurementLog(tuple(streams)))


def with_ids(tracks: MeasurementStream) -> MeasurementStream:
    """Tracks, some of other landmarks."""
    other = swapped(tracks, 0.5, np.random.default_rng(0))
    assert other.ids is not None
    assert tracks.ids is not None
    assert not np.array_equal(other.ids, tracks.ids)
    return replace(tracks, ids=other.ids)


def with_covariance(tracks: MeasurementStream, pixel_variance: float = 2.0) -> MeasurementStream:
    """Tracks with a covariance of every row."""
    return replace(tracks, covariance=np.tile(pixel_variance * np.eye(3), (len(tracks), 1, 1)))


@dataclass(frozen=True)
class Finished:
    """A run folder and the data set that the run was made of."""

    folder: Path
    dataset: Dataset


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    """A run on tracks with all that can be known of them."""
    tracks = simulate(Scenario.simplified(rate_rpm=RICH_RPM, epochs=12, landmarks=40))
    gyro = simulate(Scenario.simplified(kind="gyro", epochs=12)).log.stream("gyro")
    both = replace(tracks, log=MeasurementLog((gyro, *tracks.log.streams)))
    dataset, folder = with_tracks(both, with_covariance), tmp_path_factory.mktemp("finished") / "run"
    write_run(folder, compared(dataset, EKF), EKF)
    return Finished(folder, dataset)


def other_rig(dataset: Dataset) -> Dataset:
    """Cameras a little further apart."""
    assert isinstance(dataset.rig, StereoRig)
    return replace(dataset, rig=replace(dataset.rig, baseline_m=1.01 * dataset.rig.baseline_m))


def other_map(dataset: Dataset) -> Dataset:
    """A map that is a millimetre off."""
    known = dataset.known_map
    assert known is not None
    return replace(dataset, known_map=replace(known, points=known.points + 1e-3))


def other_truth(dataset: Dataset) -> Dataset:
    """A centre of mass in another place."""
    assert dataset.truth is not None
    return replace(dataset, truth=replace(dataset.truth, center_of_mass_g=np.array([0.02, -0.015, 0.011])))


OTHER_KNOWLEDGE: dict[str, Callable[[Dataset], Dataset]] = {
    "kind": lambda dataset: replace(dataset, kind="gyro"),
    "ids": lambda dataset: with_tracks(dataset, with_ids),
    "covariances": lambda dataset: with_tracks(dataset, lambda tracks: with_covariance(tracks, 3.0)),
    "no covariances": lambda dataset: with_tracks(dataset, lambda tracks: replace(tracks, covariance=None)),
    "rig": other_rig,
    "map": other_map,
    "no map": lambda dataset: replace(dataset, known_map=None),
    "truth": other_truth,
    "noise": lambda dataset: replace(dataset, options=replace(dataset.options, pixel_std=1.5)),
    "calibration": lambda dataset: replace(
        dataset, options=replace(dataset.options, calibration={"focal_std": 0.01})
    ),
    "inflation": lambda dataset: replace(dataset, options=replace(dataset.options, covariance_inflation=2.0)),
}


@pytest.mark.parametrize("change", OTHER_KNOWLEDGE.values(), ids=OTHER_KNOWLEDGE.keys())
def test_a_run_of_another_data_set_is_not_the_finished_one(
    change: Callable[[Dataset], Dataset], finished: Finished
) -> None:
    assert finished_run(finished.folder, change(finished.dataset), EKF) is None


NOTHING_OF_NUMBERS: dict[str, Callable[[Dataset], Dataset]] = {
    "the same": lambda dataset: dataset,
    "note": lambda dataset: replace(dataset, options=replace(dataset.options, notes={"camera": "left"})),
    "no number": lambda dataset: replace(dataset, options=replace(dataset.options, notes={"seed": np.nan})),
    "words on frames": lambda dataset: replace(dataset, options=replace(dataset.options, frames="the lab's")),
    "description": lambda dataset: replace(dataset, description="take two"),
}


@pytest.mark.parametrize("change", NOTHING_OF_NUMBERS.values(), ids=NOTHING_OF_NUMBERS.keys())
def test_words_about_a_data_set_do_not_undo_its_run(
    change: Callable[[Dataset], Dataset], finished: Finished
) -> None:
    assert finished_run(finished.folder, change(finished.dataset), EKF) is not None


def test_a_run_of_a_data_set_with_a_note_that_is_no_number_is_finished(tmp_path: Path, gyro: Dataset) -> None:
    noted = replace(gyro, options=replace(gyro.options, notes={"seed": np.nan}))
    write_run(tmp_path, compared(noted, EKF), EKF)
    assert finished_run(tmp_path, noted, EKF) is not None
