"""Chi-square tests of a filter's noise: clean runs pass, wrong levels are told by their ratio."""

import re
from dataclasses import replace
from functools import cache
from unittest.mock import patch

import numpy as np
import pytest
from plain_comparison import plainly_compared

from experiments.honest_cases import RecordingCase, recordings
from spinfilters.campaigns.calibration_draws import drawn_scenario
from spinfilters.evaluation.filter_noise_tests import MEASUREMENTS, FilterTests, NoiseTest, filter_tests
from spinfilters.filters.noise_levels import VarianceComponent
from spinfilters.inference.identified_noise import GyroNoise, smallest_level
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.models.process import ProcessNoise
from spinfilters.models.status import Finding
from spinfilters.run.estimation import Comparison
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_noise
from spinfilters.verdict import filter_diagnostics as noise_diagnostics
from spinfilters.verdict import filter_diagnostics as stated_levels
from spinfilters.verdict import model_tests as model_errors
from spinfilters.verdict.checks import base_name
from spinfilters.verdict.filter_diagnostics import (
    LARGEST_RATIO,
    LARGEST_SCORE,
    expected_nis,
    filter_noise_diagnostics,
    noise_doubts,
    stated_level_diagnostics,
)
from spinfilters.verdict.tested_models import NO_CORRELATION

SETTINGS = Settings(estimators=("mekf", "smoother"))
FILTER = Settings(estimators=("mekf",))
POSE = RecordingCase("pose of noise tests", kind="pose", epochs=150)


@cache
def compared(density: float = 1.0, deviation: float = 1.0) -> Comparison:
    """MEKF and smoother where the stated densities and deviations are so many times the true ones."""
    dataset = recordings(POSE, 1)[0].dataset
    told = dataset.options
    stated = replace(
        told,
        torque_psd=density * POSE.psd,
        force_psd=density * POSE.psd,
        pose_position_std=deviation * 0.5 * POSE.noise_std,
        pose_rotation_std=deviation * POSE.noise_std,
    )
    setup = prepare(replace(dataset, options=stated), SETTINGS)
    with patch.object(
        model_errors, "possible_correlation", lambda *_: NO_CORRELATION
    ):  # as the filters had them
        return plainly_compared(setup, SETTINGS)


def found_by(run: Comparison) -> FilterTests:
    """Of the MEKF."""
    return filter_tests(run.evaluations[0].history, run.setup.process)


def reasons(found: list[Finding]) -> list[str]:
    """Sentences with their cures."""
    return [each.reason for each in found]


def doubts(run: Comparison) -> list[list[str]]:
    """Of the filter's updates, and of all levels at the smoother's states and at the filter's."""
    mekf, smoother = run.evaluations
    return [
        reasons(filter_noise_diagnostics(mekf.history, run.setup, SETTINGS)),
        reasons(stated_level_diagnostics(run.setup, SETTINGS, [smoother.history])),
        reasons(stated_level_diagnostics(run.setup, SETTINGS, [mekf.history])),
    ]


def test_true_levels_pass_every_test() -> None:
    found = found_by(compared())
    assert set(found.noise) == {MEASUREMENTS, "torque", "force"}
    assert max(abs(test.score) for test in found.noise.values()) < 4
    assert abs(found.whiteness_score) < 4
    assert doubts(compared()) == [[], [], []]
    assert compared().evaluations[0].history.status.verdict == "ok"


@pytest.mark.parametrize("deviation", [1 / 1.5, 1.5, 3.0])
def test_a_deviation_wrong_by_half_is_doubted_with_the_number(deviation: float) -> None:
    run = compared(deviation=deviation)
    ratio = found_by(run).noise[MEASUREMENTS].ratio
    assert np.sqrt(ratio) * deviation == pytest.approx(1.0, abs=0.2)
    of_filter, *of_levels = doubts(run)
    assert "measurements have" in of_filter[0]
    for own in of_levels:
        assert re.search(
            r"^sensors\.pose_\w+_std is .*the data have [\d.]+ \+- .*deviations of chance", own[0]
        )
        found = float(re.findall(r"the data have ([\d.]+)", own[0])[0])
        true = POSE.noise_std * (0.5 if "position" in own[0] else 1.0)
        assert found == pytest.approx(true, rel=0.15)
        assert len(own[0]) < 300
    assert all(evaluation.history.status.verdict != "ok" for evaluation in run.evaluations)


def test_densities_stated_too_small_are_doubted() -> None:
    run = compared(density=0.04)
    assert all("process." in own[0] or "correlated" in own[0] for own in doubts(run))


@pytest.mark.parametrize("factor", [1 / 1.5, 1.0, 1.5])
def test_deviations_that_rows_state_are_tested_too(factor: float) -> None:
    dataset = simulate(replace(Scenario.common_workload(RICH_RPM, 1), kind="pose"))
    streams = tuple(
        replace(stream, covariance=None if stream.covariance is None else factor**2 * stream.covariance)
        for stream in dataset.log.streams
    )
    assert streams[0].covariance is not None
    setup = prepare(replace(dataset, log=MeasurementLog(streams)), SETTINGS)
    history = plainly_compared(setup, replace(SETTINGS, estimators=("mekf",)))
    found = reasons(stated_level_diagnostics(setup, SETTINGS, [history.evaluations[0].history]))
    if factor == 1.0:
        assert found == []
    else:
        times = float(
            re.findall(r"the data have ([\d.]+) .* times the deviations that the rows state", found[0])[0]
        )
        assert times * factor == pytest.approx(1.0, rel=0.15)


@pytest.mark.parametrize("density", [0.1, 10.0])
def test_densities_of_a_gyro_wrong_by_ten_are_doubted_with_the_number(density: float) -> None:
    scenario = replace(Scenario.common_workload(RICH_RPM, 0), kind="gyro")
    dataset = simulate(scenario)
    stated = replace(dataset.options, torque_psd=density * scenario.noise.torque_psd)
    setup = prepare(replace(dataset, options=stated), SETTINGS)
    run = plainly_compared(setup, SETTINGS)
    (doubt,) = reasons(stated_level_diagnostics(setup, SETTINGS, [run.evaluations[0].history]))
    assert doubt.startswith(f"process.torque_psd is {density * scenario.noise.torque_psd:.3g}, the data have")
    found = float(re.findall(r"the data have (\S+)", doubt)[0])
    assert abs(np.log(found / scenario.noise.torque_psd)) < 1
    assert all(doubt in evaluation.history.status.reasons for evaluation in run.evaluations)


def test_the_correlation_of_corrections_tells_densities_stated_too_small() -> None:
    run = compared(density=0.04)
    assert found_by(run).whiteness_score > LARGEST_SCORE


def test_white_noise_of_a_long_gyro_log_is_no_disturbance() -> None:
    """Nothing disturbs the motion; the noise that 60 of 1200 epochs identify is too small, as it may be by chance."""
    scenario = Scenario.simplified(
        kind="gyro",
        principal_moments=(1.0, 0.72, 0.45),
        rate_rpm=(4.8, 11.5, 3.3),
        gyro_std=0.0052,
        epochs=1200,
        interval=0.05,
        noise=ProcessNoise(0.0, 0.0),
        seed=2,
    )
    setup = prepare(without_noise(simulate(scenario)), FILTER)
    history = plainly_compared(setup, FILTER).evaluations[0].history
    raw = filter_tests(history, setup.process).noise["torque"]
    assert raw.score > LARGEST_SCORE
    assert raw.ratio > LARGEST_RATIO
    assert filter_noise_diagnostics(history, setup, FILTER) == []


def test_disturbances_are_doubted_beside_the_noise_that_is_seen() -> None:
    torque, larger = NoiseTest(120.0, 100.0, 8.0, 4.0, 90.0), NoiseTest(1200.0, 1000.0, 2000.0, 1000.0)
    beside = torque.beside(larger)
    assert torque.score > LARGEST_SCORE
    assert beside.expected == pytest.approx(100 + 90 * 0.2)
    assert beside.variance == pytest.approx(8 + 90**2 * 2e-3)
    smaller = replace(larger, seen=800.0)
    assert torque.beside(smaller).expected == torque.expected
    assert torque.beside(NoiseTest()) == torque


def test_a_level_that_nobody_states_may_be_too_large() -> None:
    run = compared()
    small = {"force_psd": NoiseTest(10.0, 100.0, 200.0, 100.0)}
    silent = replace(run.setup, unstated=frozenset({"force_psd"}))
    assert noise_doubts(small, run.setup)
    assert noise_doubts(small, silent) == []
    large = {"force_psd": NoiseTest(300.0, 100.0, 200.0, 100.0)}
    assert noise_doubts(large, silent)


def test_neither_a_small_ratio_nor_a_small_score_is_a_doubt() -> None:
    setup = compared().setup
    certain = NoiseTest(LARGEST_RATIO * 1e4 - 100, 1e4, 1.0, 1e4)
    assert noise_doubts({MEASUREMENTS: certain}, setup) == []
    chance = NoiseTest(100.0 + LARGEST_SCORE * 0.99 * 30.0, 100.0, 900.0, 100.0)
    assert noise_doubts({MEASUREMENTS: chance}, setup) == []


def test_a_filter_that_adapts_its_noise_is_not_tested_for_what_it_was_told() -> None:
    run = compared(deviation=3.0)
    adapting = replace(SETTINGS, adaptation=replace(SETTINGS.adaptation, measurement=50.0))
    history = run.evaluations[0].history
    assert filter_noise_diagnostics(history, run.setup, adapting) == []
    assert stated_level_diagnostics(run.setup, adapting, [history]) == []


def test_a_test_of_nothing_says_nothing() -> None:
    assert NoiseTest().score == 0
    assert NoiseTest().ratio == 1
    assert FilterTests().whiteness_score == 0
    assert FilterTests().autocorrelation == 0


def test_noise_that_cannot_be_tested_is_a_doubt(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise np.linalg.LinAlgError("no factor")

    run = compared()
    mekf, smoother = run.evaluations
    monkeypatch.setattr(noise_diagnostics, "filter_tests", broken)
    monkeypatch.setattr(stated_levels, "level_tests", broken)
    (of_filter,) = filter_noise_diagnostics(mekf.history, run.setup, SETTINGS)
    (of_levels,) = stated_level_diagnostics(run.setup, SETTINGS, [smoother.history])
    for doubt in reasons([of_filter, of_levels]):
        assert doubt == "the noise could not be tested (no factor): check the data set and its noise"


def test_a_level_that_nobody_states_is_not_said_to_be_stated() -> None:
    run = compared(density=0.04)
    silent = replace(run.setup, unstated=frozenset({"torque_psd", "force_psd"}))
    large = {"torque_psd": NoiseTest(300.0, 100.0, 200.0, 100.0)}
    doubts = [
        *noise_doubts(large, silent),
        *stated_level_diagnostics(silent, SETTINGS, [run.evaluations[1].history]),
    ]
    assert len(doubts) == 2
    for doubt in reasons(doubts):
        assert "torque_psd" in doubt or "force_psd" in doubt
        assert "state another" not in doubt
        assert "is stated" not in doubt
        assert len(doubt) < 300


@pytest.mark.parametrize("beside", [(), ("smoother",)])
def test_a_filter_whose_first_epochs_understate_a_density_is_doubted_in_any_company(
    beside: tuple[str, ...],
) -> None:
    settings = Settings(estimators=("mekf", *beside))
    data = without_noise(simulate(drawn_scenario("pose", 96)))
    # the first epochs show a fifth of the torque's density, and a rate of the filter is 4.4 of its deviations wrong
    found = {
        each.name: each.history.status
        for each in plainly_compared(prepare(data, settings), settings).evaluations
    }
    assert [base_name(each.check) for each in found.pop("mekf").findings] == ["identified-noise"]
    assert not any(each.findings for each in found.values())


def test_small_innovations_are_expected_of_correlated_or_inflated_noise_and_where_none_is_seen() -> None:
    setup = compared().setup
    assert len(setup.timeline) == 150
    assert expected_nis(setup) == 1.0
    assert expected_nis(replace(setup, gyro_noise=GyroNoise(0.01, 5.0))) == pytest.approx(0.2)
    # over 60 of 150 samples an error is as good as constant
    assert expected_nis(replace(setup, gyro_noise=GyroNoise(0.01, 60.0))) == pytest.approx(1 / 15)
    assert expected_nis(replace(setup, inflation={"pose_position_std": 4.0})) == pytest.approx(0.25)
    name = "pose_position_std"
    absent = VarianceComponent(name, smallest_level(name), 2.0, 1.0)
    assert expected_nis(replace(setup, identified=(absent,))) == 0.0


def test_noise_that_two_numbers_state_together_is_not_blamed_on_one() -> None:
    rates = Scenario.simplified(kind="gyro", rate_rpm=RICH_RPM, epochs=60, interval=0.25, seed=4)
    settings = replace(
        FILTER,
        sensors=replace(FILTER.sensors, gyro_scale_std=0.01),
        process=replace(FILTER.process, drag=False),
    )
    run = plainly_compared(prepare(simulate(rates), settings), replace(settings, verdict="filter"))
    (found,) = stated_level_diagnostics(run.setup, settings, [run.evaluations[0].history])
    assert found.sentence.startswith("sensors.gyro_noise_std and sensors.gyro_scale_std: the data have 0.1")
    assert "times the deviations that they state" in found.sentence
