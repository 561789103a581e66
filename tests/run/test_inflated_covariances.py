"""Covariances that are inflated for errors which rows have in common: residuals are held against them without the inflation."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from plain_comparison import plain_comparison

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset, DatasetOptions
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.models.status import EstimatorStatus
from spinfilters.run.readers import read_dataset
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate

STD_PX = 0.2
INFLATION = 2.5


@cache
def _tracks() -> Dataset:
    return simulate(Scenario.simplified(rate_rpm=RICH_RPM, epochs=50, landmarks=40, pixel_std=STD_PX))


def _stating(variance: float, inflation: float) -> Dataset:
    """Tracks whose rows state a variance, in those that the data have, and by how much it is inflated."""
    dataset = _tracks()
    (s,) = dataset.log.streams
    covariance = np.tile(variance * STD_PX**2 * np.eye(3), (len(s), 1, 1))
    stream = MeasurementStream(s.sensor, s.time, s.values, s.ids, covariance)
    options = replace(dataset.options, pixel_std=None, covariance_inflation=inflation)
    return replace(dataset, log=MeasurementLog((stream,)), options=options)


def _smoothed(dataset: Dataset) -> EstimatorStatus:
    settings = Settings(estimators=("smoother",))
    (evaluation,) = plain_comparison(dataset, settings).evaluations
    return evaluation.history.status


def test_rows_that_are_larger_by_what_is_told_are_no_doubt() -> None:
    status = _smoothed(_stating(INFLATION, INFLATION))
    assert status.verdict == "ok", status.reasons


def test_rows_that_are_larger_and_do_not_tell_it_are_doubted() -> None:
    status = _smoothed(_stating(INFLATION, 1.0))
    assert status.verdict == "degraded"
    assert "pixel_std: the data have 0.6" in status.reasons[0]


def test_rows_that_are_smaller_than_the_inflation_told_are_doubted() -> None:
    status = _smoothed(_stating(1.0, INFLATION))
    assert status.verdict == "degraded"
    assert "times the deviations that the rows state without their inflation" in status.reasons[0]


def _poses_stating(variance: float) -> Dataset:
    """Poses whose rows state their variance times this, and an inflation."""
    dataset = simulate(Scenario.simplified(kind="pose", rate_rpm=RICH_RPM, epochs=80))
    (s,) = dataset.log.streams
    stated = np.diag(np.repeat(list(dataset.options.sensor_noise.values()), 3)) ** 2
    stream = MeasurementStream(s.sensor, s.time, s.values, s.ids, np.tile(variance * stated, (len(s), 1, 1)))
    options = DatasetOptions(covariance_inflation=INFLATION, calibration=dataset.options.calibration)
    return replace(dataset, log=MeasurementLog((stream,)), options=options)


@pytest.mark.parametrize("variance", [1.0, INFLATION])
def test_inflated_rows_of_poses_may_be_right_with_and_without_their_inflation(variance: float) -> None:
    """Errors that poses share may be slow, or be in the residuals: both are told by the inflation."""
    status = _smoothed(_poses_stating(variance))
    assert status.verdict == "ok", status.reasons


def test_poses_with_more_noise_than_their_inflated_rows_state_are_doubted() -> None:
    status = _smoothed(_poses_stating(0.5))
    assert status.verdict == "degraded"
    assert "times the deviations that the rows state without their inflation" in status.reasons[0]


def test_the_inflation_is_written_and_read(tmp_path: Path) -> None:
    write_dataset(_stating(INFLATION, INFLATION), tmp_path)
    assert read_dataset(tmp_path).options.covariance_inflation == INFLATION


@pytest.mark.parametrize("value", [0.9, float("nan"), -1.0, 1e9])
def test_an_inflation_that_is_none_is_refused(value: float) -> None:
    with pytest.raises(InputError, match=r"covariance_inflation is .*; give a number from 1"):
        DatasetOptions(covariance_inflation=value)


def test_an_inflation_that_is_no_number_is_refused(tmp_path: Path) -> None:
    write_dataset(_stating(1.0, 1.0), tmp_path)
    with (tmp_path / "dataset.toml").open() as file:
        text = file.read()
    (tmp_path / "dataset.toml").write_text('covariance_inflation = "2"\n' + text)
    with pytest.raises(InputError, match=r"covariance_inflation is .*, expected a number"):
        read_dataset(tmp_path)
