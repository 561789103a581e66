"""Draws of simulation-based calibration: a seed gives one scenario, and a draw is whole or none."""

from dataclasses import replace
from typing import Any

import pytest

from spinfilters.campaigns import calibration_draws
from spinfilters.campaigns.calibration_draws import drawn_scenario, made_draws
from spinfilters.core.errors import InputError


def test_a_seed_always_draws_the_same_scenario() -> None:
    assert drawn_scenario("gyro", 3) == drawn_scenario("gyro", 3)
    assert drawn_scenario("gyro", 3) != drawn_scenario("gyro", 4)


def test_noise_that_is_no_field_of_a_scenario_is_an_option_of_its_sensor() -> None:
    scenario, levels = drawn_scenario("lidar-points", 1), calibration_draws.LEVELS["lidar-points"]
    assert set(dict(scenario.sensor_noise)) == set(levels)
    assert all(low <= scenario.level(name) <= high for name, (low, high) in levels.items())
    assert drawn_scenario("pose", 1).sensor_noise == ()


def test_a_sensor_without_a_prior_is_refused() -> None:
    with pytest.raises(InputError, match="no prior"):
        drawn_scenario("lidar-scans", 0)


def test_a_draw_that_was_interrupted_within_an_estimator_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    compare = calibration_draws.compare_estimators

    def pressed(setup: Any, settings: Any, _: Any, **rest: Any) -> Any:
        """Ctrl-C at an epoch in the middle of the second filter, which keeps what it has."""

        def press(name: str, done: int, every: int) -> None:
            if name == "ukf" and done >= every // 2:
                raise KeyboardInterrupt

        found = compare(setup, settings, press, **rest)
        assert found.interrupted
        return found

    monkeypatch.setattr(calibration_draws, "compare_estimators", pressed)
    monkeypatch.setattr(
        calibration_draws, "drawn_scenario", lambda *of: replace(drawn_scenario(*of), epochs=40)
    )
    with pytest.raises(KeyboardInterrupt):
        made_draws("gyro", 0, ("mekf", "ukf"), stated=True)
