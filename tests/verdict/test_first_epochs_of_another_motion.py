"""First epochs that do not settle on a motion, where later ones do, are told with the time to begin at."""

from dataclasses import replace
from functools import cache

import pytest

from spinfilters.inference.setup import Setup
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.verdict import tested_models
from spinfilters.verdict.refits import with_later_begin
from spinfilters.verdict.tested_models import NOT_TESTED, model_findings

SETTINGS = Settings(process={"gravity": False, "drag": False})  # pyright: ignore[reportArgumentType]


@cache
def prepared() -> Setup:
    """Poses of a rich motion, of 40 epochs at 0.5 s."""
    return prepare(simulate(Scenario.simplified(kind="pose", rate_rpm=RICH_RPM, epochs=40, seed=1)), SETTINGS)


def after(setup: Setup, times_its_noise: float, converged: bool) -> tested_models.TestedModels:
    """What is said where the initialisation left so many times its noise."""
    first = setup.initial
    initial = replace(first, converged=converged, cost=times_its_noise**2 * first.dof)
    return with_later_begin(NOT_TESTED, replace(setup, initial=initial), SETTINGS)


def test_first_epochs_of_another_motion_are_named_with_the_time_to_begin_at() -> None:
    models = after(prepared(), 6.0, converged=False)
    assert models.names == ("contact-at-begin",)
    (found,) = model_findings(models, None)
    assert found.check == "first-epochs"
    assert "they leave 6 times their noise, those from t = 4.000 s on" in found.sentence
    assert found.cure.endswith("(--segment 4.000:)")


@pytest.mark.parametrize(("times", "converged"), [(6.0, True), (1.2, False)])
def test_first_epochs_that_settle_or_fit_are_not_tried_again(times: float, converged: bool) -> None:
    assert after(prepared(), times, converged) is NOT_TESTED


def test_nothing_is_said_where_the_later_epochs_are_too_few() -> None:
    setup = prepared()
    short = replace(setup, timeline=setup.timeline[:4], log=setup.log.slice(0.0, 1.5))
    assert after(short, 6.0, converged=False) is NOT_TESTED
