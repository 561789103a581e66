"""A drift of the clock that a gyro hardly shows is counted in the deviations where nobody states the clock."""

import pytest

from experiments.named_causes import outcome
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR
from spinfilters.run.comparison_run import compare_dataset
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate


@pytest.mark.parametrize("seed", [0, 5, 18])
def test_a_gyro_s_clock_that_drifts_unseen_leaves_no_error_beyond_four_deviations(seed: int) -> None:
    found = outcome("gyro", "clock-drift", seed)
    assert found.verdict != "ok" or found.error < LARGEST_STATED_ERROR


def test_a_clock_that_is_stated_has_no_drift() -> None:
    recording = simulate(Scenario.simplified(kind="gyro", rate_rpm=RICH_RPM, epochs=60))
    compared = compare_dataset(recording, Settings(estimators=("smoother",)))
    assert compared.models.clock_drift is None


def test_poses_show_a_drift_by_themselves() -> None:
    settings = Settings(
        estimators=("smoother",),
        calibration={"clock_scale_std": "auto"},  # pyright: ignore[reportArgumentType]
    )
    recording = simulate(Scenario.simplified(kind="pose", rate_rpm=RICH_RPM, epochs=60))
    assert compare_dataset(recording, settings).models.clock_drift is None
