"""Covariances of single rows: estimators weigh by them, are consistent with them, and need no stated deviation."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from jaxtyping import Float
from plain_comparison import plain_comparison

from spinfilters.core.linear_algebra import normalised_square
from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.evaluation.estimated_motion import true_rates
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.io.dataset import Dataset, DatasetOptions
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.run.preparation import prepare
from spinfilters.run.readers import read_dataset
from spinfilters.settings.run_settings import FILTER, SensorSettings, Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map

GYRO = Scenario.simplified(kind="gyro", rate_rpm=RICH_RPM, epochs=150, interval=0.1)
TRACKS = Scenario.simplified(rate_rpm=RICH_RPM, epochs=25, landmarks=120, pixel_std=0.3)
STDS = {"gyro": (0.002, 0.02), "stereo": (0.3, 3.0)}
"""Of every other row."""
SEEDS = range(5)


def with_stream(dataset: Dataset, stream: MeasurementStream, options: DatasetOptions) -> Dataset:
    """The data set with another stream in place of its own."""
    return replace(dataset, log=MeasurementLog((stream,)), options=options)


@cache
def alternating(kind: str, seed: int) -> Dataset:
    """A data set whose rows are alternately good and ten times worse, as their covariances say; no deviation is stated."""
    dataset = simulate(replace(GYRO if kind == "gyro" else TRACKS, seed=seed))
    stream = dataset.log.streams[0]
    good, bad = STDS[stream.sensor]
    std = np.where(np.arange(len(stream)) % 2, bad, good)
    more = np.sqrt(std**2 - good**2)[:, None] * np.random.default_rng(seed).standard_normal((len(stream), 3))
    covariance = (std**2)[:, None, None] * np.eye(3)
    noisy = MeasurementStream(stream.sensor, stream.time, stream.values + more, stream.ids, covariance)
    found = with_stream(dataset, noisy, replace(dataset.options, pixel_std=None, gyro_noise_std=None))
    return without_map(found) if kind == "unknown map" else found


def without_covariances(dataset: Dataset) -> Dataset:
    """The same rows with the root mean square of their deviations stated for all."""
    stream = dataset.log.streams[0]
    std = float(np.sqrt(np.mean(np.square(STDS[stream.sensor]))))
    plain = MeasurementStream(stream.sensor, stream.time, stream.values, stream.ids)
    return with_stream(dataset, plain, replace(dataset.options, pixel_std=std, gyro_noise_std=std))


def repeated(dataset: Dataset, std: float) -> Dataset:
    """The same rows, each with the covariance of this standard deviation."""
    s = dataset.log.streams[0]
    covariance = np.tile(std**2 * np.eye(3), (len(s), 1, 1))
    stream = MeasurementStream(s.sensor, s.time, s.values, s.ids, covariance)
    return with_stream(dataset, stream, replace(dataset.options, pixel_std=None, gyro_noise_std=None))


def estimated(dataset: Dataset, *names: str, sensors: SensorSettings | None = None) -> tuple[Evaluation, ...]:
    """Evaluations of estimators, without the bound and without tests of their models."""
    settings = Settings(estimators=names, sensors=sensors or SensorSettings(), verdict=FILTER)
    return plain_comparison(dataset, settings).evaluations


@cache
def own_estimates(kind: str, seed: int, *names: str) -> tuple[Evaluation, ...]:
    """Evaluations with the covariances of the rows, which several tests look at."""
    return estimated(alternating(kind, seed), *names)


def shape_error(evaluation: Evaluation, dataset: Dataset) -> Float[np.ndarray, " n"]:
    """Of the rates in axes g, rad/s, in the second half."""
    assert dataset.truth is not None
    history = evaluation.history
    away = history.mean[:, history.layout.mean_slice("w")] - true_rates(dataset.truth).rate
    return np.linalg.norm(away[len(away) // 2 :], axis=1)


def test_gyro_rates_and_innovations_are_consistent_with_the_rows_covariances() -> None:
    nees, nis, dof = [], 0.0, 0
    for seed in SEEDS:
        dataset = alternating("gyro", seed)
        evaluation, _ = own_estimates("gyro", seed, "mekf", "smoother")
        history, truth = evaluation.history, dataset.truth
        assert truth is not None
        w = history.mean[-1:, history.layout.mean_slice("w")] - true_rates(truth).rate[-1:]
        nees.append(float(normalised_square(w, history.factor[-1:, history.layout.slice("w")])[0]))
        nis, dof = nis + float(history.nis.sum()), dof + int(history.dof.sum())
    low, high = chi_square_band(3, len(SEEDS), 0.999)
    assert low < np.mean(nees) < high
    low, high = chi_square_band(dof, 1, 0.999)
    assert low < nis < high


def test_tracks_are_consistent_with_the_rows_covariances() -> None:
    last = []
    for seed in SEEDS:
        for evaluation in own_estimates("known map", seed, "mekf", "smoother"):
            assert evaluation.nees is not None
            last.append(float(evaluation.nees.total[-1]))
    low, high = chi_square_band(20, len(SEEDS), 0.999)
    assert low < np.mean(last[::2]) < high
    assert low < np.mean(last[1::2]) < high


@pytest.mark.parametrize("kind", ["gyro", "known map", "unknown map"])
def test_estimates_are_better_with_the_rows_covariances_than_with_their_mean(kind: str) -> None:
    seeds = SEEDS if kind == "gyro" else range(2)
    names = ("mekf",) if kind == "unknown map" else ("mekf", "smoother")
    better = np.zeros(len(names))
    for seed in seeds:
        dataset = alternating(kind, seed)
        pairs = zip(
            own_estimates(kind, seed, *names), estimated(without_covariances(dataset), *names), strict=True
        )
        for k, (own, mean) in enumerate(pairs):
            ratio = np.mean(np.square(shape_error(own, dataset))) / np.mean(
                np.square(shape_error(mean, dataset))
            )
            better[k] += np.log(ratio) / len(seeds)
    assert (np.exp(better / 2) < 0.75).all()


@pytest.mark.parametrize("kind", ["gyro", "known map", "unknown map"])
def test_covariances_that_repeat_one_deviation_give_the_result_of_that_deviation(kind: str) -> None:
    base = simulate(replace(GYRO, epochs=60) if kind == "gyro" else replace(TRACKS, epochs=14))
    base = without_map(base) if kind == "unknown map" else base
    std = GYRO.gyro_std if kind == "gyro" else TRACKS.pixel_std
    baselines = () if kind == "unknown map" else ("filterpy-ekf",)
    names = ("mekf", "ukf", "smoother", *baselines)
    pairs = zip(estimated(base, *names), estimated(repeated(base, std), *names), strict=True)
    for stated, own in pairs:
        scale = np.linalg.norm(stated.history.factor, axis=2)
        away = base_layout_local(stated, own)
        assert (np.abs(away) < 1e-3 * scale).all(), stated.name
        assert np.allclose(np.linalg.norm(own.history.factor, axis=2), scale, rtol=1e-3), stated.name


def base_layout_local(one: Evaluation, other: Evaluation) -> Float[np.ndarray, "n e"]:
    """Error between the means of two histories."""
    return one.history.layout.local(one.history.mean, other.history.mean)


def test_a_gyros_error_is_not_identified_where_its_rows_state_it() -> None:
    dataset = alternating("gyro", 0)
    stated = prepare(dataset, Settings())
    assert "gyro_noise_std" not in {each.name for each in stated.identified}
    silent = with_stream(dataset, without_covariances(dataset).log.streams[0], DatasetOptions())
    found = prepare(silent, Settings())
    assert found.gyro_noise is not None or "gyro_noise_std" in {each.name for each in found.identified}


def test_a_deviation_in_the_settings_takes_the_place_of_the_rows_covariances() -> None:
    dataset, sensors = alternating("gyro", 1), SensorSettings(gyro_noise_std=0.01, gyro_scale_std=0.0)
    (own,) = estimated(dataset, "mekf", sensors=sensors)
    (plain,) = estimated(without_covariances(dataset), "mekf", sensors=sensors)
    assert np.array_equal(own.history.factor, plain.history.factor)


def test_what_is_measured_at_an_epoch_carries_the_covariances_of_the_file(tmp_path: object) -> None:
    from pathlib import Path

    folder = Path(str(tmp_path)) / "data"
    write_dataset(alternating("gyro", 0), folder)
    epochs = prepare(read_dataset(folder), Settings()).timeline
    for epoch, std in ((epochs[0], 0.002), (epochs[1], 0.02)):
        measurement = epoch.measurements[0]
        noise = np.linalg.inv(measurement.model.whitening(np.ones(12), measurement.parameters)[0])
        assert np.allclose(noise, std * np.eye(3), rtol=1e-12)
