"""Noise that nobody states is identified and said to be; what is stated is used as it is."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from plain_comparison import plain_comparison

from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.models.process import ProcessNoise
from spinfilters.run.estimation import Comparison
from spinfilters.run.preparation import prepare
from spinfilters.run.readers import read_dataset
from spinfilters.run.run_summary import summary
from spinfilters.settings.run_settings import FILTER, SensorSettings, Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_noise

TRUE = {"pose_position_std": 0.002, "pose_rotation_std": 0.004, "force_psd": 1e-5, "torque_psd": 1e-5}


@cache
def recording(seed: int) -> Dataset:
    """Poses that say nothing of their noise, five times smaller than the default, and disturbances of ten times."""
    scenario = Scenario.simplified(
        kind="pose",
        rate_rpm=RICH_RPM,
        epochs=100,
        interval=0.5,
        seed=seed,
        position_std=TRUE["pose_position_std"],
        rotation_std=TRUE["pose_rotation_std"],
        noise=ProcessNoise(TRUE["force_psd"], TRUE["torque_psd"]),
    )
    dataset = simulate(scenario)
    streams = tuple(replace(stream, covariance=None) for stream in dataset.log.streams)
    options = replace(dataset.options, force_psd=None, torque_psd=None, sensor_noise={})
    return replace(dataset, log=MeasurementLog(streams), options=options)


@cache
def judged(seed: int) -> Comparison:
    """MEKF and smoother at the noise that they identify, with their verdicts."""
    return plain_comparison(recording(seed), Settings(estimators=("mekf", "smoother")))


def smoothed(dataset: Dataset, settings: Settings) -> Comparison:
    """The smoother alone, without tests of its models, where its noise is looked at."""
    return plain_comparison(dataset, replace(settings, estimators=("smoother",), verdict=FILTER))


def test_the_summary_says_what_was_identified_with_its_deviation() -> None:
    noise = summary(judged(0))["estimators"]["mekf"]["noise"]
    for name, true in TRUE.items():
        assert noise[name]["source"] == "identified"
        assert abs(noise[name]["value"] - true) < 4 * noise[name]["std"] + 0.3 * true * name.endswith("psd")


def test_estimates_with_identified_noise_are_consistent() -> None:
    mean = np.zeros(2)
    for seed in range(4):
        for k, evaluation in enumerate(judged(seed).evaluations):
            assert evaluation.history.status.verdict == "ok", evaluation.history.status.reasons
            assert evaluation.nees is not None
            own = evaluation.history.own
            total = sum(block[own].mean() for block in evaluation.nees.blocks.values())
            mean[k] += total / evaluation.history.layout.error_dim / 4
    assert (mean > 0.6).all()
    assert (mean < 1.6).all()


@pytest.mark.parametrize("by", ["settings", "data set"])
def test_what_is_stated_is_used_as_it_is(by: str) -> None:
    dataset, settings = recording(0), Settings()
    if by == "settings":
        settings = Settings(sensors={"pose_position_std": 0.02}, process={"torque_psd": 3e-6})  # pyright: ignore[reportArgumentType]
    else:
        told = replace(dataset.options, sensor_noise={"pose_position_std": 0.02}, torque_psd=3e-6)
        dataset = replace(dataset, options=told)
    noise = summary(smoothed(dataset, settings))["estimators"]["smoother"]["noise"]
    assert noise["pose_position_std"] == {"value": 0.02, "std": None, "upper": None, "source": "stated"}
    assert noise["torque_psd"] == {"value": 3e-6, "std": None, "upper": None, "source": "stated"}
    assert noise["pose_rotation_std"]["source"] == "identified"


def test_the_smoother_identifies_noise_over_its_own_epochs_and_filters_over_the_first() -> None:
    comparison = judged(1)
    setup, (mekf, smoother) = comparison.setup, comparison.evaluations
    assert mekf.history.noise == setup.identified
    first, later = (
        {each.name: each for each in noise} for noise in (setup.identified, smoother.history.noise)
    )
    assert first.keys() == later.keys() == TRUE.keys()
    for name, true in TRUE.items():
        assert later[name].log_std < first[name].log_std
        away = np.log(later[name].value / true) * (1 if name.endswith("psd") else 2)
        assert abs(away) < 3 * later[name].log_std


def test_a_disturbance_too_small_to_be_seen_is_said_to_be_below_a_bound() -> None:
    dataset = simulate(
        Scenario.simplified(kind="pose", rate_rpm=RICH_RPM, epochs=60, noise=ProcessNoise(1e-14, 1e-14))
    )
    streams = tuple(replace(stream, covariance=None) for stream in dataset.log.streams)
    dataset = replace(dataset, log=MeasurementLog(streams), options=replace(dataset.options, torque_psd=None))
    document = summary(smoothed(dataset, Settings()))
    noise = document["estimators"]["smoother"]["noise"]["torque_psd"]
    assert noise["source"] == "prior"
    assert noise["std"] is None
    assert noise["upper"] > noise["value"]
    assert any("torque below" in sentence for sentence in document["conditions"]["sentences"])


def test_a_white_gyro_s_noise_is_identified_with_the_torque() -> None:
    noise_std = 5e-3
    scenario = Scenario.simplified(
        kind="gyro", rate_rpm=RICH_RPM, gyro_std=noise_std, noise=ProcessNoise(1e-6, 2e-6)
    )
    dataset = simulate(scenario)
    options = replace(dataset.options, force_psd=None, torque_psd=None, sensor_noise={})
    (evaluation,) = smoothed(replace(dataset, options=options), Settings()).evaluations
    history = evaluation.history
    found = {each.name: each for each in history.noise}
    assert abs(np.log(found["gyro_noise_std"].value / noise_std)) < 1.5 * found["gyro_noise_std"].log_std
    assert found["torque_psd"].upper > 2e-6


@pytest.mark.parametrize("seed", [7, 10])
def test_levels_of_which_one_takes_what_the_other_leaves_settle(seed: int) -> None:
    true = {"gyro_noise_std": 2.4e-4, "torque_psd": 1.2e-7}
    noise = ProcessNoise(torque_psd=true["torque_psd"])
    scenario = Scenario.simplified(
        kind="gyro", rate_rpm=RICH_RPM, seed=seed, gyro_std=true["gyro_noise_std"], noise=noise
    )
    found = {each.name: each for each in prepare(without_noise(simulate(scenario)), Settings()).identified}
    for name, half in (("gyro_noise_std", 0.5), ("torque_psd", 1.0)):
        assert abs(np.log(found[name].value / true[name])) < 4 * half * found[name].log_std


def test_a_torque_six_decades_below_what_is_assumed_is_found_to_be_small(
    shared_data: Callable[[str], Path],
) -> None:
    dataset = read_dataset(shared_data("suchai3_gyro") / "20230904_1693839903")
    found = {each.name: each for each in prepare(dataset, Settings()).identified}
    assert found["gyro_noise_std"].value == pytest.approx(0.0015, rel=0.15)
    assert found["torque_psd"].upper < 1e-7


@pytest.mark.parametrize("by_settings", [True, False])
def test_a_stated_level_of_a_gyro_is_used_as_it_is(by_settings: bool) -> None:
    dataset = without_noise(
        simulate(Scenario.simplified(kind="gyro", rate_rpm=RICH_RPM, epochs=60, gyro_std=0.002))
    )
    if by_settings:
        settings = Settings(sensors=SensorSettings(gyro_noise_std=0.007))
    else:
        dataset = replace(dataset, options=replace(dataset.options, sensor_noise={"gyro_noise_std": 0.007}))
        settings = Settings()
    setup = prepare(dataset, settings)
    assert setup.noise.gyro_noise_std == 0.007
    assert setup.gyro_noise is None
    assert {each.name for each in setup.identified} == {"torque_psd"}
