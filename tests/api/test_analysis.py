"""``spinfilters.observe``: the command's answer as an object."""

import json
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

import spinfilters
from spinfilters.api.analysis import KnownInputs
from spinfilters.cli.main import main


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
