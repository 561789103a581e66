"""Draws of simulation-based calibration: made once, read again, and reported."""

import json
from pathlib import Path

import pytest

from spinfilters.campaigns.calibration_draws import DRAWS_FILE, drawn_scenario, read_draws
from spinfilters.campaigns.calibration_report import RESULT_FILE
from spinfilters.cli.main import main
from spinfilters.core.errors import InputError


def test_a_seed_always_draws_the_same_scenario() -> None:
    assert drawn_scenario("gyro", 3) == drawn_scenario("gyro", 3)
    assert drawn_scenario("gyro", 3) != drawn_scenario("gyro", 4)


def test_a_sensor_without_a_prior_is_refused() -> None:
    with pytest.raises(InputError, match="no prior"):
        drawn_scenario("lidar-scans", 0)


def test_an_interrupted_call_goes_on_where_it_ended(tmp_path: Path) -> None:
    command = ["calibration", "gyro", "--estimators", "mekf", "-o", str(tmp_path / "out"), "--draws"]
    assert main([*command, "1"]) == 0
    path = tmp_path / "out" / DRAWS_FILE
    first = path.read_text()
    path.write_text(first + '{"seed": 1, "dra')  # a call that was killed while it wrote
    assert main([*command, "2"]) == 0
    assert path.read_text().startswith(first)
    draws = read_draws(tmp_path / "out")
    assert [draw.seed for draw in draws] == [0, 1]
    assert set(draws[0].quantities) == {"rate", "moments", "axes"}
    result = json.loads((tmp_path / "out" / RESULT_FILE).read_text())
    assert result["estimators"]["mekf"]["draws"] == 2
    assert main(["calibration", "gyro", "--estimators", "ukf", "-o", str(tmp_path / "out")]) == 2
