"""Help texts and pages that list the kinds of data sets name every one of them."""

import re
from pathlib import Path

import pytest

from observability.system import analysed_sensors
from spinfilters.api.arguments import ObserveArguments
from spinfilters.io.argument_fields import given_fields
from spinfilters.io.sensor_format import dataset_kinds, sensor_format
from spinfilters.simulation.scenario_record import Scenario

DOCS = Path(__file__).parents[2] / "docs"
KINDS = sorted(dataset_kinds())


def words(text: str) -> set[str]:
    """Words of a text, hyphens included."""
    return set(re.findall(r"[a-z]+(?:-[a-z]+)*", text))


@pytest.mark.parametrize("kind", KINDS)
def test_the_page_of_data_sets_has_a_row_for_every_kind(kind: str) -> None:
    page = (DOCS / "how-to" / "data-sets.md").read_text()
    assert re.search(rf"^\| `{kind}` \| `\S+\.\w+`", page, re.MULTILINE)


@pytest.mark.parametrize("kind", KINDS)
def test_the_help_of_simulate_names_every_kind(kind: str) -> None:
    (field,) = (each for each in given_fields(Scenario) if each.flag == "--kind")
    assert kind in words(field.help)


@pytest.mark.parametrize("sensor", analysed_sensors())
def test_the_help_of_observe_and_its_page_name_every_sensor_that_it_analyses(sensor: str) -> None:
    kind = sensor_format(sensor).kind
    (field,) = (each for each in given_fields(ObserveArguments) if each.flag == "--sensor")
    assert kind in words(field.help)
    assert f"`{kind}`" in (DOCS / "theory" / "observability.md").read_text()
