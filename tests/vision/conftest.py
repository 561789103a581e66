"""A rendered sequence and synthetic stereo points that tests of the front end share."""

from pathlib import Path

import pytest

from spinfilters.simulation.image_sequence import ImageScenario, Imaging, render
from spinfilters.simulation.scenario_record import Scenario


@pytest.fixture(scope="session")
def rendered_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six pairs of 320 x 240 of a box at 10 rpm, 0.25 s apart, 0.4 m away."""
    folder = tmp_path_factory.mktemp("images")
    scenario = ImageScenario(
        Scenario(radius_m=0.13, epochs=6, interval=0.25),
        shape="box",
        size=(320, 240),
        imaging=Imaging(oversampling=1, stars=10),
    )
    render(scenario, folder)
    return folder
