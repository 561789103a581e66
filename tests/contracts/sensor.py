"""The contract that every registered sensor keeps: a new sensor's test is one call of `check_sensor`."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from models.sensor_contract import check_sensor_contract
from scipy.stats import chi2

from spinfilters.evaluation.consistency import true_states
from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.sensor_format import SensorFormat, SensorNoise
from spinfilters.models.sensor import BoundStream, CameraView, Sensor
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout
from spinfilters.run.readers import read_dataset
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate

FALSE_ALARM = 1e-4
"""Probability that a consistent sensor's NIS lies outside the band; the seeds are fixed."""


def check_sensor(sensor: Sensor, folder: Path) -> None:
    """Files, simulator, binding, consistency and derivatives of a sensor that data sets hold."""
    form = sensor.format
    assert form is not None
    assert form.name == sensor.name
    dataset = simulate(
        Scenario.simplified(kind=form.kind, rate_rpm=RICH_RPM, epochs=40, landmarks=60, seed=3)
    )
    assert dataset.log.sensors == (sensor.name,)
    own = with_row_covariances(dataset, form)
    for number, each in enumerate((dataset, own)):
        _check_files(each, folder / str(number))
        _check_consistency(sensor, each)
    _check_rows(sensor, own)
    _check_model(sensor, dataset)


def with_row_covariances(dataset: Dataset, form: SensorFormat) -> Dataset:
    """Every other row ten times as noisy, as the covariances of the rows say; nothing is stated for all."""
    (stream,), generator = dataset.log.streams, np.random.default_rng(5)
    stated = [option for option in form.noise if option.components is not None]
    std = np.empty(form.dimension)
    for option in stated:
        std[list(option.components or ())] = dataset.options.sensor_noise[option.name]
    if form.has_landmarks:  # pixel coordinates beyond those that an option names have its deviation too
        std[:] = std[0]
    every = std * np.where(np.arange(len(stream)) % 2, 10.0, 1.0)[:, None]
    more = np.sqrt(every**2 - std**2) * generator.standard_normal(every.shape)
    covariance = every[:, :, None] ** 2 * np.eye(form.dimension)
    moved = replace(stream, values=_moved(form, stream.values, more), covariance=covariance)
    return replace(dataset, log=MeasurementLog((moved,)), options=replace(dataset.options, sensor_noise={}))


def _moved(
    form: SensorFormat, values: Float[np.ndarray, "n m"], error: Float[np.ndarray, "n d"]
) -> Float[np.ndarray, "n m"]:
    """Values with an error of the covariance's dimension, of the leading columns where there are more."""
    if form.quaternion is None:
        return np.hstack([values[:, : form.dimension] + error, values[:, form.dimension :]])
    layout = StateLayout(("t", "a") if form.quaternion else ("a",))
    return layout.retract(values, error)


def _check_files(dataset: Dataset, folder: Path) -> None:
    write_dataset(dataset, folder)
    read = read_dataset(folder)
    assert (read.kind, read.rig, read.options) == (dataset.kind, dataset.rig, dataset.options)
    for mine, theirs in zip(dataset.log.streams, read.log.streams, strict=True):
        for name in ("time", "values", "ids", "covariance"):
            np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name))


def _bound(sensor: Sensor, dataset: Dataset) -> BoundStream:
    layout = StateLayout(FULL_BLOCKS if sensor.sees_place else ROTATION_BLOCKS)
    view = None if dataset.rig is None else CameraView(dataset.known_map, dataset.rig.calibration)
    noise = SensorNoise(dataset.options.sensor_noise)
    return sensor.bind(dataset.log.streams[0], layout, noise, view)


def _check_consistency(sensor: Sensor, dataset: Dataset) -> None:
    """Whitened innovations about the true states are standard normal."""
    assert dataset.truth is not None
    bound, truth = _bound(sensor, dataset), dataset.truth
    states, squares, count = true_states(truth, bound.model.layout), 0.0, 0
    for time, x in zip(truth.time, states, strict=True):
        rows = np.flatnonzero(bound.time == time)
        about = bound.model.linearise(x, bound.parameters[rows], bound.values[rows])
        squares += float(np.sum(about.innovation[about.valid] ** 2))
        count += int(np.count_nonzero(about.valid)) * bound.model.dim
    assert count >= len(truth.time) * bound.model.dim
    low, high = chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], count)
    assert low < squares < high, f"NIS per degree of freedom {squares / count:.3f}"


def _check_rows(sensor: Sensor, dataset: Dataset) -> None:
    """A row of ten times the deviation counts a tenth."""
    (stream,), truth = dataset.log.streams, dataset.truth
    assert truth is not None
    assert stream.covariance is not None
    worse = replace(stream, covariance=100 * stream.covariance)
    good, bad = _bound(sensor, dataset), _bound(sensor, replace(dataset, log=MeasurementLog((worse,))))
    x = true_states(truth, good.model.layout)[0]
    expected = 10 * bad.model.whitening(x, bad.parameters[:2])
    np.testing.assert_allclose(good.model.whitening(x, good.parameters[:2]), expected, rtol=1e-9)


def _check_model(sensor: Sensor, dataset: Dataset) -> None:
    """The contract of measurement models at a true state, for rows of its first frame or the first few."""
    assert dataset.truth is not None
    bound = _bound(sensor, dataset)
    x = true_states(dataset.truth, bound.model.layout)[0]
    valid = bound.model.linearise(x, bound.parameters, bound.values).valid
    check_sensor_contract(bound.model, x, bound.parameters[valid][:5])
