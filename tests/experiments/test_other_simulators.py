"""Motions of other simulators agree with ours."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.other_simulators import NOTHING, brick_recording, drake_recording, mujoco_recording
from spinfilters.campaigns.calibration_draws import drawn_scenario
from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.simulation.scenario import Scenario, simulate


@pytest.mark.parametrize(
    ("program", "recorded"), [("mujoco", mujoco_recording), ("pydrake", drake_recording)]
)
def test_a_motion_of_another_simulator_is_ours(program: str, recorded: Callable[[Scenario], Dataset]) -> None:
    pytest.importorskip(program)
    scenario = replace(drawn_scenario("pose", 1), epochs=20, noise=NOTHING)
    ours, other = simulate(scenario).truth, recorded(scenario).truth
    assert ours is not None
    assert other is not None
    assert other.center_of_mass == pytest.approx(ours.center_of_mass, abs=1e-7)
    assert other.rate_i == pytest.approx(ours.rate_i, abs=1e-7)
    assert np.abs(np.einsum("ki,ki->k", other.q_ig, ours.q_ig)) == pytest.approx(1.0, abs=1e-9)


def test_epochs_that_a_check_case_does_not_have_are_named(tmp_path: Path) -> None:
    file = tmp_path / "brick.csv"
    rows = np.column_stack([0.1 * np.arange(12), np.tile([0.1, 0.2, 0.3], (12, 1))])
    np.savetxt(file, rows, delimiter=",", header="time_s,wx,wy,wz", comments="")
    assert len(brick_recording(file, 2, 10, 0.002, 0).log.streams[0].time) == 10
    with pytest.raises(InputError, match="no 10 epochs"):
        brick_recording(file, 3, 10, 0.002, 0)
