"""Errors of the calibration in what a run says: which are considered, what they add, and how it is told."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.errors import InputError
from spinfilters.evaluation.comparison_table import comparison_cells
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.filters.history import EPOCH_ARRAYS
from spinfilters.inference.noise_choice import considered_deviations
from spinfilters.io.dataset import Dataset, DatasetOptions
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.models.process import ProcessNoise
from spinfilters.models.state_blocks import GYRO_SCALE
from spinfilters.models.state_layout import ROTATION_BLOCKS, StateLayout
from spinfilters.models.status import Verdict
from spinfilters.run.array_files import read_history, write_history
from spinfilters.run.comparison_run import compare_dataset
from spinfilters.run.conditions import conditions_of
from spinfilters.run.estimation import Comparison
from spinfilters.run.estimators import estimator_entries
from spinfilters.run.preparation import prepare
from spinfilters.run.run_summary import summary
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate, without_map
from spinfilters.verdict.calibration_errors import UNKNOWN, CalibrationErrors

CLOCK = 0.01


@cache
def poses() -> Dataset:
    """A rich motion."""
    return simulate(replace(Scenario.rich(), kind="pose", epochs=50))


def settings(*estimators: str, **deviations: float) -> Settings:
    """That state the calibration."""
    return Settings(estimators=estimators or ("mekf",), calibration=deviations)  # pyright: ignore[reportArgumentType]


@cache
def compared() -> Comparison:
    """A filter and the smoother, the clock being wrong by a percent."""
    return compare_dataset(poses(), settings("mekf", "smoother", clock_scale_std=CLOCK))


def by_name(name: str) -> Evaluation:
    """Of that comparison."""
    return next(each for each in compared().evaluations if each.name == name)


@pytest.mark.parametrize("name", ["mekf", "smoother"])
def test_a_wrong_clock_adds_its_share_of_rates(name: str) -> None:
    history = by_name(name).history
    assert history.calibration is not None
    rates = history.layout.slice("w")
    value = history.mean[-1, history.layout.mean_slice("w")]
    np.testing.assert_allclose(history.calibration[-1, rates, 0], -CLOCK * value, rtol=0.1)


def test_a_filter_and_the_smoother_agree_in_the_last_epoch() -> None:
    mekf, smoother = (by_name(name).history.calibration for name in ("mekf", "smoother"))
    assert mekf is not None
    assert smoother is not None
    deviation = np.linalg.norm(by_name("smoother").history.factor[-1], axis=1)
    np.testing.assert_allclose(mekf[-1, :, 0] / deviation, smoother[-1, :, 0] / deviation, atol=0.2)


def test_a_smoother_too_long_for_memory_says_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    chosen = settings("smoother", clock_scale_std=CLOCK)
    errors = CalibrationErrors(prepare(poses(), chosen), chosen, estimator_entries()["mekf"])
    at_once = by_name("smoother").history
    monkeypatch.setattr("spinfilters.verdict.calibration_errors.STRETCH", 10)
    again = errors.counted(replace(at_once, factor=at_once.random_factor()), estimator_entries()["smoother"])
    assert at_once.calibration is not None
    assert again.calibration is not None
    deviation = np.linalg.norm(at_once.factor, axis=2)[1:]
    away = again.calibration[1:, :, 0] - at_once.calibration[1:, :, 0]
    assert np.abs(away / deviation).max() < 0.05


def test_a_smoother_that_lets_go_of_epochs_scales_with_the_baseline(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario, chosen = (
        replace(Scenario.rich(), epochs=26, landmarks=50),
        settings("smoother", baseline_std=0.01),
    )
    setup = prepare(without_map(simulate(scenario)), chosen)
    monkeypatch.setattr("spinfilters.verdict.calibration_errors.MOST_EPOCHS_WITH_MAP", 10)
    whole = by_name("smoother").history
    first = {name: getattr(whole, name)[: scenario.epochs] for name in EPOCH_ARRAYS}
    history = replace(whole, calibration=None, observations=None, **first)
    found = (
        CalibrationErrors(setup, chosen, estimator_entries()["mekf"])
        .counted(history, estimator_entries()["smoother"])
        .calibration
    )
    assert found is not None
    layout, count = setup.process.layout, len(setup.initial.mean)
    ahead = setup.process.step(setup.initial.mean[-1], scenario.interval)  # the filter's first epoch
    mean = np.vstack([setup.initial.mean, ahead])
    t, R = mean[:, layout.mean_slice("t")], matrix_from_quaternion(mean[:, layout.mean_slice("a")])
    expected = 0.01 * (t - R @ (R[0].T @ t[0]))  # the first pose defines frame g
    np.testing.assert_allclose(found[: count + 1, layout.slice("t"), 0], expected, atol=2e-4)


def test_an_exact_calibration_changes_nothing() -> None:
    setup = prepare(poses(), settings())
    exact = CalibrationErrors(setup, settings(), estimator_entries()["mekf"])
    history = by_name("mekf").history
    assert exact.considered == ()
    assert exact.counted(history, estimator_entries()["mekf"]) is history


def test_the_random_part_is_that_of_an_exact_calibration() -> None:
    alone = compare_dataset(poses(), settings("mekf")).evaluations[0].history
    assert alone.calibration is None
    total = by_name("mekf").history
    random = total.random_factor()
    np.testing.assert_allclose(random @ np.swapaxes(random, 1, 2), alone.covariance, atol=1e-10)


def test_the_random_part_is_unknown_where_the_whole_is() -> None:
    total = by_name("mekf").history
    factor = total.factor.copy()
    factor[-1, 0, 0] = np.nan
    random = replace(total, factor=factor).random_factor()
    np.testing.assert_array_equal(random[:-1], total.random_factor()[:-1])
    assert np.isnan(random[-1]).all()


def test_parts_add_up_and_are_told_in_summary_and_table() -> None:
    document = summary(compared())
    told = document["estimators"]["mekf"]["deviation_parts"]
    total = by_name("mekf").trajectory.std_rate[-1]
    np.testing.assert_allclose(
        np.hypot(told["rate_rad_s"]["random"], told["rate_rad_s"]["calibration"]), total
    )
    assert max(told["rate_rad_s"]["calibration"]) > max(told["rate_rad_s"]["random"])
    assert document["conditions"]["calibration"] == {
        "length_scale_std": {"value": 0.0, "unit": "1", "source": "stated"},
        "clock_scale_std": {"value": CLOCK, "unit": "1", "source": "stated"},
    }
    assert any("scale of the clock 1 %" in line for line in document["conditions"]["sentences"])
    rows = [row[0] for section in comparison_cells(compared().evaluations).sections for row in section]
    assert "rate in i: random / calibration [deg/s]" in rows


def test_a_data_set_that_is_silent_is_not_taken_for_exact() -> None:
    silent = replace(poses(), options=replace(poses().options, calibration={}))
    setup = prepare(silent, settings())
    assert {each.parameter.name for each in setup.calibration} == {"length_scale_std", "clock_scale_std"}
    for each in setup.calibration:
        assert (each.source, each.std) == ("prior", each.parameter.default)
    sentences = conditions_of(setup).sentences
    assert any("(assumed)" in line for line in sentences)
    assert any("state [calibration] length_scale_std = 0, clock_scale_std = 0" in line for line in sentences)
    settled = prepare(silent, settings(clock_scale_std=0.0, length_scale_std=0.0))
    assert not CalibrationErrors(settled, settings(), estimator_entries()["mekf"]).considered


def test_what_a_state_estimates_is_not_considered() -> None:
    gyro = simulate(replace(Scenario.rich(), kind="gyro", epochs=5))
    silent = replace(gyro, options=DatasetOptions(gyro_noise_std=0.002))
    for blocks, names in (
        (ROTATION_BLOCKS, {"gyro_scale_std", "clock_scale_std"}),
        ((*ROTATION_BLOCKS, GYRO_SCALE.name), {"clock_scale_std"}),
    ):
        found = considered_deviations(silent, settings(), StateLayout(blocks))
        assert {each.parameter.name for each in found} == names


def test_a_filter_that_does_not_stand_the_error_is_degraded(monkeypatch: pytest.MonkeyPatch) -> None:
    setup = prepare(poses(), settings(clock_scale_std=CLOCK))
    errors = CalibrationErrors(setup, settings(), estimator_entries()["mekf"])
    monkeypatch.setattr(CalibrationErrors, "_run", lambda *_: None)
    history = replace(by_name("mekf").history, calibration=None)
    status = errors.counted(history, estimator_entries()["mekf"]).status
    assert status.verdict is Verdict.DEGRADED
    assert UNKNOWN in status.reasons


def test_a_history_file_keeps_the_parts(tmp_path: Path) -> None:
    history = by_name("mekf").history
    write_history(tmp_path / "history.npz", history)
    read = read_history(tmp_path / "history.npz")
    assert read.calibration is not None
    assert history.calibration is not None
    np.testing.assert_array_equal(read.calibration, history.calibration)
    thinned = history.thinned(3)
    assert thinned.calibration is not None
    assert len(thinned.calibration) == len(thinned.time)


@pytest.mark.parametrize("value", [-0.001, float("nan"), 0.5, "much", True])
def test_a_setting_that_is_no_deviation_is_one_line(value: float) -> None:
    with pytest.raises(
        InputError, match=r"calibration\.focal_std is .*from 0 to 0.1 of the focal length"
    ) as refused:
        settings(focal_std=value)
    assert "\n" not in str(refused.value)


def test_a_left_handed_gyro_shows_another_body_as_well_as_the_right_one() -> None:
    body = replace(Scenario.rich(), kind="gyro", principal_moments=(1.0, 0.8, 0.55), epochs=80)
    dataset = simulate(replace(body, gyro_std=1e-4, noise=ProcessNoise(1e-9, 1e-9)))
    rates = dataset.log.stream("gyro")
    mirrored = MeasurementLog((replace(rates, values=rates.values * [1.0, 1.0, -1.0]),))
    (left,) = compare_dataset(replace(dataset, log=mirrored, truth=None), settings()).evaluations
    assert left.history.status.verdict is Verdict.OK
    np.testing.assert_allclose(left.body.principal_moments, [0.5091, 0.8727, 1.0], atol=2e-3)
