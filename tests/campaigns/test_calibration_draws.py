"""Draws of simulation-based calibration: a seed gives one scenario, and a draw is whole or none."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from spinfilters.campaigns import calibration_draws
from spinfilters.campaigns.calibration_draws import MASS_STD, drawn_scenario, made_draws, scenario_of_prior
from spinfilters.core.errors import InputError
from spinfilters.evaluation.consistency import true_states
from spinfilters.models.state_layout import ROTATION_BLOCKS, StateLayout
from spinfilters.simulation.scenario import simulate


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


def test_bodies_are_drawn_from_the_prior_that_estimators_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    layout = StateLayout(ROTATION_BLOCKS)
    errors = []
    for seed in range(200):
        truth = simulate(replace(scenario_of_prior("gyro", seed), epochs=2)).truth
        assert truth is not None
        errors.append(layout.local(layout.origin(), true_states(truth, layout)[0])[layout.slice("s")])
    mean, std = np.mean(errors, axis=0), np.std(errors, axis=0)
    assert (np.abs(mean) < 4 * MASS_STD / np.sqrt(200)).all()
    assert (np.abs(std / MASS_STD - 1) < 4 / np.sqrt(400)).all()

    told: list[float] = []
    monkeypatch.setattr(
        calibration_draws, "prepare", lambda data, settings: told.append(settings.initialisation.mass_std)
    )
    monkeypatch.setattr(
        calibration_draws, "compare_estimators", lambda *_, **__: pytest.fail("the prior alone is asked")
    )
    with pytest.raises(pytest.fail.Exception):
        made_draws("gyro", 0, ("mekf",), stated=True)
    assert told == [MASS_STD]


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
        calibration_draws, "scenario_of_prior", lambda *of: replace(scenario_of_prior(*of), epochs=40)
    )
    with pytest.raises(KeyboardInterrupt):
        made_draws("gyro", 0, ("mekf", "ukf"), stated=True)
