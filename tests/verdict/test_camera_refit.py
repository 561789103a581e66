"""A camera that moves without known poses is fitted as fully as a flywheel is, so that their evidence can be compared."""

from dataclasses import replace

import pytest

from spinfilters.models.process import ProcessNoise
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map
from spinfilters.verdict import model_tests
from spinfilters.verdict.model_errors.alternatives import table
from spinfilters.verdict.model_tests import jumps
from spinfilters.verdict.refits import DoubtedMotion, fitted_camera

AT_REST = Scenario.simplified(
    rate_rpm=RICH_RPM, epochs=60, landmarks=100, noise=ProcessNoise(1e-6, 1e-6), seed=0
)
SETTINGS = Settings(
    initialisation={"share": 1.0},  # pyright: ignore[reportArgumentType]
    process={"gravity": False},  # pyright: ignore[reportArgumentType]
)


def test_a_camera_that_sways_explains_far_more_than_its_score_promises() -> None:
    scenario = replace(AT_REST, inspector="sway", inspector_errors=(("missing", 1.0),))
    setup = prepare(without_map(simulate(scenario)), SETTINGS)
    models = model_tests.tested_about(setup, setup.initial.mean, table().values(), jumps)
    score = next(each for each in models.tests if each.error.name == "inspector-missing")
    found = fitted_camera(DoubtedMotion(setup, setup.initial.mean))
    assert found.gain - 2 * found.numbers > 2 * max(score.merit, 30.0)
    assert found.farthest < 0.1 + 4 * found.std


@pytest.mark.parametrize("seed", [0, 1])
def test_a_camera_at_rest_has_no_path(seed: int) -> None:
    setup = prepare(without_map(simulate(replace(AT_REST, seed=seed))), SETTINGS)
    found = fitted_camera(DoubtedMotion(setup, setup.initial.mean))
    assert found.gain - 2 * found.numbers < 0
