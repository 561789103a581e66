"""Measurements that are refused at the ends of a recording: contact where it explains them, else gross errors."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from plain_comparison import plain_comparison, plainly_compared

from experiments.what_holds import drawn
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR, quantity_errors
from spinfilters.io.dataset import Dataset
from spinfilters.run.estimation import Comparison
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.measurement_faults import GrossError, with_faults
from spinfilters.simulation.model_faults import faulty_recording, model_faults
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.smoother import mass_posterior
from spinfilters.verdict.model_errors.hypotheses import among_inliers, solved_near
from spinfilters.verdict.model_tests import linear_problem

SETTINGS = Settings(estimators=("smoother",), process={"gravity": False})  # pyright: ignore[reportArgumentType]
SCENARIO = Scenario.simplified(
    kind="pose", principal_moments=(1.0, 0.8, 0.55), rate_rpm=RICH_RPM, interval=0.4, epochs=60, seed=2
)


def compared(dataset: Dataset) -> Comparison:
    """By the smoother, which refuses one epoch."""
    found = plain_comparison(dataset, SETTINGS)
    assert found.evaluations[0].history.rejected.sum() == 1
    return found


@pytest.mark.parametrize("name", ["contact-at-begin", "contact-at-end"])
def test_a_contact_whose_last_epoch_alone_is_refused_is_named(name: str) -> None:
    sequences = tuple(np.random.SeedSequence(SCENARIO.seed).spawn(3))
    models = compared(faulty_recording(SCENARIO, model_faults()[name], 0.08, sequences)).models
    assert models.named[0].error.name == name
    assert models.named[0].statistic > 40


@cache
def with_a_turned_pose(epoch: int) -> Comparison:
    """Of a recording of which one pose is a gross error."""
    return compared(with_faults(simulate(SCENARIO), [GrossError("turned", epoch)], 0))


@pytest.mark.parametrize("epoch", [0, -1])
def test_a_gross_error_at_an_end_is_no_contact(epoch: int) -> None:
    assert with_a_turned_pose(epoch).models.names == ()


@pytest.mark.parametrize(("number", "end"), [(52003, 0), (52023, -1)])
def test_a_contact_that_may_be_a_gross_error_is_counted_in_the_deviations(
    number: int, end: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One refused pose tells neither from the other: an estimate that goes on to that end was 40 to 88 deviations off in rate."""
    for few in ("SAMPLES", "TRIED"):  # of a mass distribution, at which nobody looks here
        monkeypatch.setattr(mass_posterior, few, 40)
    (found,) = plain_comparison(drawn(number).dataset, SETTINGS).evaluations
    assert found.history.rejected[end] == 1
    errors = quantity_errors(found)
    assert errors["attitude"][end] < LARGEST_STATED_ERROR
    assert errors["velocity"][end] < LARGEST_STATED_ERROR
    assert errors["rate"][end] < LARGEST_STATED_ERROR


@pytest.mark.parametrize("epoch", [0, -1])
def test_a_turn_that_no_touch_makes_leaves_the_deviations(epoch: int) -> None:
    assert with_a_turned_pose(epoch).models.possible_contacts == ()


def test_measurements_that_count_are_known_again_in_the_whole_recording() -> None:
    dataset = with_faults(simulate(replace(SCENARIO, kind="gyro")), [GrossError("flipped", 30)], 0)
    setup = prepare(dataset, SETTINGS)
    problem = linear_problem(setup, setup.timeline)
    comparison = plainly_compared(setup, SETTINGS)
    solved = solved_near(problem, comparison.evaluations[0].history.mean, np.zeros((0, 3)))
    assert solved is not None
    (counted,) = solved.counted
    assert list(np.flatnonzero(~counted)) == [30]
    some = among_inliers(problem, solved)
    assert some is not None
    again = among_inliers(problem, some)  # of a problem with one row less than the recording
    assert again is not None
    assert [len(rows) for rows in (*some.sensor_rows, *again.sensor_rows)] == [59, 59]
    assert np.allclose(again.here.trajectory, some.here.trajectory, atol=1e-9)
