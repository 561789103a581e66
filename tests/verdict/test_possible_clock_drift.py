"""A drift of the clock that measurements hardly show is counted in the deviations where nobody states the clock."""

from dataclasses import replace

import numpy as np
import pytest
from plain_comparison import plain_comparison

from experiments.named_causes import drawn, outcome, recorded
from spinfilters.campaigns.row_columns import result_columns
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR
from spinfilters.models.state_blocks import RATE
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.smoother.motion_factors import STRETCH
from spinfilters.verdict import model_tests
from spinfilters.verdict.calibration_errors import stated_deviation


@pytest.mark.parametrize(("sensor", "seed"), [("gyro", 0), ("gyro", 5), ("gyro", 18), ("tracks", 102)])
def test_a_clock_that_drifts_unseen_leaves_no_error_beyond_four_deviations(sensor: str, seed: int) -> None:
    found = outcome(sensor, "clock-drift", seed)
    assert found.verdict != "ok" or found.error < LARGEST_STATED_ERROR


@pytest.mark.parametrize("seed", [0, 5, 18])
def test_a_drift_is_counted_over_more_epochs_than_are_tested(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(model_tests, "MOST_EPOCHS", 40)
    found = outcome("gyro", "clock-drift", seed)
    assert found.verdict != "ok" or found.error < LARGEST_STATED_ERROR


def test_a_clock_that_is_stated_as_exact_has_no_drift() -> None:
    recording = simulate(Scenario.simplified(kind="gyro", rate_rpm=RICH_RPM, epochs=60))
    compared = plain_comparison(recording, Settings(estimators=("smoother",)))
    assert compared.models.clock_drift is None


def test_a_drift_within_a_stated_clock_is_counted() -> None:
    """Poses of a slow body hardly show that the clock is 2.2 % off at both ends, which a stated 2 % says."""
    scenario, fault, size, _ = drawn("pose", "clock-drift", 706)
    recording = recorded(scenario, fault, size, stated=False)
    recording = replace(recording, options=replace(recording.options, calibration={"clock_scale_std": 0.02}))
    (found,) = plain_comparison(recording, Settings(estimators=("smoother",))).evaluations
    assert float(result_columns(found)["worst_error"]) < LARGEST_STATED_ERROR


@pytest.mark.parametrize(
    ("size", "std", "deviation"), [(0.0, np.inf, 0.2), (0.0, 0.2, 0.2 / np.sqrt(2)), (9.0, 1e-3, 9.0)]
)
def test_a_stated_deviation_and_residuals_together(size: float, std: float, deviation: float) -> None:
    assert stated_deviation(size, std, 0.2) == pytest.approx(deviation, rel=1e-4)


def test_poses_that_would_show_a_drift_hardly_widen_the_deviations() -> None:
    recording = simulate(Scenario.simplified(kind="pose", rate_rpm=RICH_RPM, epochs=60))
    recording = replace(recording, options=replace(recording.options, calibration={}))
    compared = plain_comparison(recording, Settings(estimators=("smoother",)))
    (history,) = (each.history for each in compared.evaluations)
    drift, rates = compared.models.clock_drift, history.layout.slice(RATE.name)
    assert drift is not None
    chance = np.linalg.norm(history.factor[:, rates], axis=2) ** 2 - drift[:, rates] ** 2
    assert (drift[:, rates] ** 2 < chance).all()


def test_a_recording_longer_than_a_smoother_keeps_in_memory_counts_a_drift() -> None:
    """Twenty seconds of a phone at 105 Hz: the rows of all epochs are there when the drift is tested."""
    scenario = Scenario.simplified(kind="gyro", rate_rpm=RICH_RPM, epochs=STRETCH + 52, interval=0.01)
    recording = simulate(scenario)
    recording = replace(recording, options=replace(recording.options, calibration={}))
    compared = plain_comparison(recording, Settings(estimators=("mekf",)))
    assert compared.models.clock_drift is not None
    assert len(compared.models.clock_drift) == STRETCH + 52
