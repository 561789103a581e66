"""Estimates called ok lie within four of their standard deviations, on the cases where they once did not."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.honest_cases import CASES, RecordingCase
from experiments.honest_verdicts import SweepExtent, VerdictOutcome, figure, outcomes_of, row_of
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR
from spinfilters.models.status import Verdict

BY_NAME = {case.name: case for case in CASES}
ONCE_WRONG = ("pose near-spherical", "pose 50 epochs")


@pytest.mark.parametrize("name", ONCE_WRONG)
def test_what_is_called_ok_is_within_four_standard_deviations(name: str) -> None:
    outcomes = list(outcomes_of(BY_NAME[name], SweepExtent(2)))
    assert len(outcomes) == 6
    assert not [(o.seed, o.estimator, o.worst) for o in outcomes if o.is_dishonest]


def test_a_well_determined_motion_is_called_ok() -> None:
    outcomes = list(outcomes_of(replace(BY_NAME["gyro rich"], epochs=100), SweepExtent(2)))
    assert {o.verdict for o in outcomes} == {Verdict.OK}


def test_an_error_beyond_four_or_not_a_number_belies_ok_alone() -> None:
    def outcome(verdict: Verdict, size: float) -> VerdictOutcome:
        return VerdictOutcome(
            "gyro rich", 0, "mekf", verdict, {"w": size, "moments": 0.1}, {"w": 1.0, "s": 1.0}
        )

    assert not outcome(Verdict.OK, LARGEST_STATED_ERROR).is_dishonest
    assert outcome(Verdict.OK, 1.01 * LARGEST_STATED_ERROR).is_dishonest
    assert outcome(Verdict.OK, np.inf).is_dishonest
    assert not outcome(Verdict.DEGRADED, 2 * LARGEST_STATED_ERROR).is_dishonest
    assert "beyond 4" in row_of(RecordingCase("gyro rich"), [outcome(Verdict.OK, 5.0)])
    drawn = figure([RecordingCase("gyro rich")], [outcome(Verdict.OK, 5.0)])
    assert drawn.axes[0].get_yticklabels()[0].get_text() == "gyro rich"
