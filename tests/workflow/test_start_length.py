"""How long an initialisation is: until a filter from it lies where the smoother of the same measurements does."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.honest_cases import CASES, recordings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.state.status import Verdict
from spinfilters.workflow import start_length
from spinfilters.workflow.estimation import compare_estimators
from spinfilters.workflow.preparation import prepare
from spinfilters.workflow.quality import filter_doubts
from spinfilters.workflow.settings import Settings
from spinfilters.workflow.start_length import LARGEST_DEPARTURE, departure_of

BY_NAME = {case.name: case for case in CASES}
FILTERS = Settings(estimators=("mekf", "ukf"))


def test_filters_that_never_come_to_the_smoother_are_degraded() -> None:
    for recording in recordings(BY_NAME["pose flip"], 2):
        prepared = prepare(recording.dataset, FILTERS)
        for evaluation in compare_estimators(prepared, FILTERS, lambda *_: None).evaluations:
            assert evaluation.history.status.verdict is not Verdict.OK


def test_the_distance_from_the_smoother_is_told_of_filters() -> None:
    prepared = prepare(simulate(Scenario(kind="gyro", rate_rpm=RICH_RPM)), FILTERS)
    assert filter_doubts(replace(prepared, start=replace(prepared.start, departure=LARGEST_DEPARTURE))) == []
    (doubt,) = filter_doubts(replace(prepared, start=replace(prepared.start, departure=3.14)))
    assert "3.1 standard deviations" in doubt
    assert len(doubt) < 300


@pytest.mark.parametrize("kind", ["gyro", "pose"])
def test_a_rich_motion_keeps_its_sixty_frames_and_tries_no_filter(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(start_length, "departure_of", lambda *_: np.inf)
    prepared = prepare(simulate(Scenario(kind=kind, rate_rpm=RICH_RPM)), FILTERS)
    assert len(prepared.start.mean) == 60
    assert prepared.start.departure == 0
    assert not filter_doubts(prepared)


def test_a_filter_from_a_well_known_motion_lies_at_the_smoother() -> None:
    dataset = simulate(Scenario(kind="gyro", rate_rpm=RICH_RPM))
    short, long = (
        prepare(dataset, replace(FILTERS, start=replace(FILTERS.start, frames=frames))) for frames in (30, 60)
    )
    away = departure_of(short.process, short.timeline, short.start, long.start)
    assert 0 < away < LARGEST_DEPARTURE
