"""How long an initialisation is: until a filter from it lies where the smoother of the same measurements does."""

from dataclasses import replace

import numpy as np
import pytest
from plain_comparison import plainly_compared

from experiments.honest_cases import CASES, recordings
from spinfilters.pipeline import initialisation_length
from spinfilters.pipeline.diagnostics import filter_diagnostics
from spinfilters.pipeline.initialisation_length import LARGEST_DEPARTURE, departure_of
from spinfilters.pipeline.setup import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.state.status import Verdict

BY_NAME = {case.name: case for case in CASES}
FILTERS = Settings(estimators=("mekf", "ukf"))


def test_filters_that_never_come_to_the_smoother_are_degraded() -> None:
    for recording in recordings(BY_NAME["pose flip"], 2):
        setup = prepare(recording.dataset, FILTERS)
        for evaluation in plainly_compared(setup, FILTERS).evaluations:
            assert evaluation.history.status.verdict is not Verdict.OK


@pytest.mark.parametrize("kind", ["gyro", "pose"])
def test_a_rich_motion_keeps_its_sixty_epochs_and_tries_no_filter(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(initialisation_length, "departure_of", lambda *_: np.inf)
    setup = prepare(simulate(Scenario(kind=kind, rate_rpm=RICH_RPM)), FILTERS)
    assert len(setup.initial.mean) == 60
    assert setup.initial.departure == 0
    assert not filter_diagnostics(setup)


def test_a_filter_from_a_well_known_motion_lies_at_the_smoother() -> None:
    dataset = simulate(Scenario(kind="gyro", rate_rpm=RICH_RPM))
    short, long = (
        prepare(dataset, replace(FILTERS, initialisation=replace(FILTERS.initialisation, epochs=epochs)))
        for epochs in (30, 60)
    )
    away = departure_of(short.process, short.timeline, short.initial, long.initial)
    assert 0 < away < LARGEST_DEPARTURE
