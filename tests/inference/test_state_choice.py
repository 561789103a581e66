"""Which constants the settings add to a state."""

from typing import Any

import pytest

from spinfilters.inference.setup import layout_of
from spinfilters.models.state_blocks import BLOCKS
from spinfilters.settings.run_settings import ProcessSettings, Settings
from spinfilters.simulation.scenario import Scenario, simulate


@pytest.mark.parametrize(
    ("options", "added"),
    [
        ({}, ""),
        ({"drag": True}, "d"),
        ({"drag": "quadratic"}, "d"),
        ({"drag": "auto"}, "d"),
        ({"drag": "linear"}, "l"),
        ({"gravity": True}, "f"),
        ({"body_torque": True, "rotor": True}, "mh"),
    ],
)
@pytest.mark.parametrize("kind", ["gyro", "pose"])
def test_a_switch_adds_its_block_where_the_state_can_have_it(
    kind: str, options: dict[str, Any], added: str
) -> None:
    log = simulate(Scenario.simplified(kind=kind, epochs=3)).log
    plain, switched = (
        layout_of(log, Settings(process=each)) for each in (ProcessSettings(), ProcessSettings(**options))
    )
    wanted = {name for name in added if plain.translates or not BLOCKS[name].translational}
    assert {block.name for block in switched.constant} - {block.name for block in plain.constant} == wanted


def test_every_switch_is_a_key_of_the_process() -> None:
    switches = {block.switch for block in BLOCKS.values()} - {""}
    assert all(hasattr(ProcessSettings(), name) for name in switches)
