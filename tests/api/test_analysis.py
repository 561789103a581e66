"""``spinfilters.observe``: the command's answer as an object."""

import json
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

import spinfilters
from observability.cases import Levels
from spinfilters.api.analysis import KnownInputs
from spinfilters.cli.main import main
from spinfilters.simulation.scenario_record import Scenario


def test_it_answers_as_the_command_does(tmp_path: Path) -> None:
    arguments = ["--sensor", "gyro", "--torque", "x", "--frames", "6", "-o", str(tmp_path / "command")]
    assert main(["observe", *arguments]) == 0
    found = spinfilters.observe("gyro", known=KnownInputs(torque="x"), frames=6)
    folder = found.save(tmp_path / "python")
    for name in ("observe.txt", "observe.json"):
        assert (folder / name).read_bytes() == (tmp_path / "command" / name).read_bytes()
    assert json.loads((folder / "observe.json").read_text())["rank"] == found.document["rank"] == 6


def test_it_prints_its_text_and_draws_its_figure() -> None:
    found = spinfilters.observe(["attitude", "gyro"], frames=6)
    assert "11 of 11 unknowns are determined" in str(found)
    assert repr(found) == str(found)
    assert found._repr_html_().startswith("<pre>")
    assert isinstance(found.figure(), Figure)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"sensors": "radar"}, "sensor 'radar' is unknown"),
        ({"sensors": []}, "at least one"),
        ({"landmarks": 0}, "landmarks is 0; give a whole number from 1"),
        ({"frames": 5001}, "frames is 5001; give 1 to 5000"),
        ({"interval": 1e5}, "at most 100 revolutions between epochs"),
        ({"moments": (1, 1)}, "give three numbers"),
        ({"known": KnownInputs(torque=("u",))}, "axis 'u' is unknown; use x, y or z"),
        ({"chart": "sea"}, "chart 'sea' is unknown"),
    ],
)
def test_a_question_that_cannot_be_asked_is_refused_in_one_line(arguments: dict[str, Any], says: str) -> None:
    with pytest.raises(spinfilters.InputError) as refusal:
        spinfilters.observe(**{"sensors": "gyro", **arguments})
    assert says in str(refusal.value)


def test_settings_state_noise_disturbances_and_priors() -> None:
    settings = {"sensors": {"gyro_noise_std": 1e-3}, "process": {"torque_psd": 1e-8}}
    found = spinfilters.observe("gyro", frames=6, settings=settings)
    assert found.document["assumed"][:2] == [
        "noise: gyro 0.001 rad/s",
        "process noise: 1e-08 (rad/s^2)^2/Hz",
    ]
    default = spinfilters.observe("gyro", frames=6)
    assert found.report.final["body rate", "rad/s"] < default.report.final["body rate", "rad/s"]


def test_disturbances_are_those_of_the_bundled_example() -> None:
    assert Levels().process == Scenario().noise


def test_the_bias_of_a_gyro_is_one_more_unknown_where_its_prior_is_stated() -> None:
    found = spinfilters.observe("gyro", frames=6, settings={"initialisation": {"gyro_bias_std": 0.01}})
    assert found.document["dimension"] == 14
    assert "gyro bias [rad/s]" in found.document["bound"]
    assert "the gyro has no bias" not in str(found)
    spin = spinfilters.observe(
        "gyro", frames=6, rate_rpm=(0, 10, 0), settings={"initialisation": {"gyro_bias_std": 0.01}}
    )
    assert "bias of the gyro against the rate (3)" in str(spin)
    assert spin.document["unnamed"] == 0


def test_a_sensor_is_known_by_the_kind_of_its_data_sets_and_by_its_former_name() -> None:
    old, new = (spinfilters.observe(name, frames=3).document for name in ("monocular", "mono-tracks"))
    assert old == new
    old, new = (spinfilters.observe(name, frames=3).document for name in ("lidar", "lidar-points"))
    assert old == new
    assert spinfilters.simulate("stereo", frames=5).kind == "stereo-tracks"


def test_inputs_over_time_come_from_a_table(tmp_path: Path) -> None:
    table = tmp_path / "inputs.csv"
    table.write_text("time_s,torque_x,acceleration_y,torque_z\n0,0.1,0,0\n5,0.1,0.01,0\n10,-0.1,0,0\n")
    found = spinfilters.observe("mono-tracks", frames=6, known=KnownInputs(table=table))
    assert [each.axis for each in found.report.case.recorded] == list(found.report.case.inputs)
    assert found.document["rank"] == 29
    assert "torque about x: 3 rows from 0 to 10 s, -0.1 to 0.1 N m" in found.document["assumed"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("time_s,thrust\n0,1\n1,1\n", "column 'thrust' is no known input"),
        ("torque_x,torque_y\n0,1\n1,1\n", "has no column time_s"),
        ("time_s,torque_x\n0,0\n1,0\n", "no input but zeros"),
        ("time_s,torque_x\n1,1\n0,1\n", "ascending times"),
    ],
)
def test_a_table_that_holds_no_inputs_is_refused(tmp_path: Path, text: str, says: str) -> None:
    table = tmp_path / "inputs.csv"
    table.write_text(text)
    with pytest.raises(spinfilters.InputError, match=says):
        spinfilters.observe("gyro", frames=6, known=KnownInputs(table=table))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"settings": {"process": {"drag": True}}}, "process.drag is no part of this analysis"),
        ({"sensors": "pose", "settings": {"process": {"gravity": True}}}, "process.gravity is no part"),
        ({"sensors": "pose", "settings": {"initialisation": {"gyro_bias_std": 0.1}}}, "--chart filter"),
    ],
)
def test_settings_that_the_analyser_does_not_know_are_refused(arguments: dict[str, Any], says: str) -> None:
    with pytest.raises(spinfilters.InputError, match=says):
        spinfilters.observe(**{"sensors": "gyro", "frames": 6, **arguments})
