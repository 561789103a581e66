"""How long an initialisation is: until a filter from it lies where the smoother of the same measurements does."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from plain_comparison import plainly_compared

from experiments.captured_throws import drawn, with_densities
from experiments.honest_cases import CASES, recordings
from experiments.honest_verdicts import outcome_of
from spinfilters.core.chi_square import chi_square_tail
from spinfilters.core.linear_algebra import normalised_square
from spinfilters.evaluation.consistency import true_states
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.timeline import run
from spinfilters.inference import first_epochs as initialisation_length
from spinfilters.inference.first_epochs import (
    LARGEST_DEPARTURE,
    beyond_share,
    departure_of,
    long_enough_initialisation,
)
from spinfilters.inference.initial_estimate import InitialEstimate
from spinfilters.inference.setup import Setup
from spinfilters.io.dataset import Dataset
from spinfilters.models.status import Verdict
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import InitialisationOptions, Settings
from spinfilters.simulation.measurement_faults import GrossError, with_faults
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.smoother import mass_posterior
from spinfilters.verdict.doubts import filter_diagnostics

BY_NAME = {case.name: case for case in CASES}
FILTERS = Settings(estimators=("mekf", "ukf"))


def test_a_filter_of_a_flip_is_doubted(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, number in (("SAMPLES", 64), ("TRIED", 24)):  # errors of moments are far within their deviations
        monkeypatch.setattr(mass_posterior, name, number)
    case, settings = BY_NAME["pose flip"], replace(FILTERS, estimators=("mekf",))
    (recording,) = recordings(case, 1)
    (found,) = plainly_compared(prepare(recording.dataset, settings), settings).evaluations
    outcome = outcome_of(case, 0, found, recording)
    assert outcome.verdict is not Verdict.OK
    assert not outcome.is_dishonest


@pytest.mark.parametrize("kind", ["gyro", "pose"])
def test_a_rich_motion_keeps_its_sixty_epochs_and_tries_no_filter(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(initialisation_length, "departure_of", lambda *_: np.inf)
    setup = prepare(simulate(Scenario.simplified(kind=kind, rate_rpm=RICH_RPM)), FILTERS)
    assert len(setup.initial.mean) == 60
    assert setup.initial.departure == 0
    assert not filter_diagnostics(setup)


@cache
def rich_gyro() -> Dataset:
    """Rates of a rich motion."""
    return simulate(Scenario.simplified(kind="gyro", rate_rpm=RICH_RPM))


@cache
def rich_setup(epochs: int) -> Setup:
    """Begun with so many of its epochs."""
    return prepare(rich_gyro(), beginning_with(epochs))


def beginning_with(epochs: int) -> Settings:
    """Of filters."""
    return replace(FILTERS, initialisation=replace(FILTERS.initialisation, epochs=epochs))


def test_an_initialisation_takes_its_time_in_its_last_epoch() -> None:
    setup = rich_setup(60)
    assert setup.initial_runtime[-1] == setup.initial_seconds > 0
    assert not setup.initial_runtime[:-1].any()


def test_a_filter_from_a_well_known_motion_lies_at_the_smoother() -> None:
    short, long = rich_setup(30), rich_setup(60)
    away = departure_of(short.process, short.timeline, short.initial, long.initial)
    assert 0 < away < LARGEST_DEPARTURE


def test_a_gross_error_behind_the_start_is_no_linearisation_that_a_filter_fails_on() -> None:
    faulty = with_faults(rich_gyro(), [GrossError("flipped", 45)], 0)
    start, away = rich_setup(30), []
    for later in (rich_setup(60), prepare(faulty, beginning_with(60))):
        away.append(departure_of(start.process, later.timeline, start.initial, later.initial))
    assert away[1] < max(2 * away[0], 0.1)


@pytest.mark.parametrize(("enough", "length"), [(30, 60), (61, 69), (80, 92), (100, 69)])
def test_a_third_beyond_the_share_is_taken_where_that_and_no_fewer_is_enough(
    enough: int, length: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    setup = rich_setup(60)
    monkeypatch.setattr(initialisation_length, "_is_enough", lambda found: len(found.mean) >= enough)

    def of_length(options: InitialisationOptions) -> InitialEstimate:
        count = options.count(setup.timeline)
        return InitialEstimate.failed(setup.process.layout, count, "for a test")

    monkeypatch.setattr(initialisation_length, "_is_better", lambda beyond, _: len(beyond.mean) >= enough)
    monkeypatch.setattr(initialisation_length, "_check_moments", lambda *given: given[2](given[3]))
    models = (setup.process, setup.timeline, of_length, InitialisationOptions())
    found = long_enough_initialisation(*models)
    longer = beyond_share(*models, found)
    assert (len(setup.timeline), len((longer or found).mean)) == (115, length)
    assert (longer is None) == (length <= 69)


def test_a_filter_without_disturbances_begins_as_wide_as_the_posterior_bends() -> None:
    recording = with_densities(simulate(drawn(2, 0.0)), 0.0)
    setup = prepare(recording, replace(FILTERS, estimators=("mekf",)))
    assert setup.initial.departure > LARGEST_DEPARTURE
    assert recording.truth is not None
    truth, chances = true_states(recording.truth, setup.process.layout)[-1], []
    for belief in (setup.initial.belief, setup.belief):
        estimator = MultiplicativeEkf(setup.process)
        estimator.start(belief)
        history = run(estimator, setup.end_of_initialisation, setup.timeline[len(setup.initial.mean) :])
        error = setup.process.layout.local(history.mean[-1], truth)
        square = float(normalised_square(error[np.newaxis], history.factor[-1:])[0])
        chances.append(float(chi_square_tail(square, len(error))))
    assert chances[0] < 1e-6
    assert 0.01 < chances[1] < 0.99
