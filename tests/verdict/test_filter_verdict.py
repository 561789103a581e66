"""A filter that is judged by its own checks alone."""

from dataclasses import replace
from functools import cache
from typing import NoReturn

import pytest

from experiments.what_holds import drawn
from spinfilters.evaluation.stated_errors import quantity_errors
from spinfilters.models.status import QUANTITIES, EstimatorStatus, Holds, Verdict
from spinfilters.run.estimation import Comparison, compare_estimators
from spinfilters.run.estimators import estimator_entries
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.verdict import doubts
from spinfilters.verdict import filter_diagnostics as agreement_tests
from spinfilters.verdict.checks import Evidence, finding

FULL = Settings(estimators=("mekf",))
FILTER = replace(FULL, verdict="filter")
WRONG_SCALE = 25
"""A gyro whose scale is wrong: its filter's innovations are as they should be, and its rate 20 deviations off."""
RIGHT = 2


@cache
def judged(number: int, settings: Settings) -> Comparison:
    """The MEKF on a recording of the experiment's sample."""
    return compare_estimators(prepare(drawn(number).dataset, settings), settings, lambda *_: None)


def test_an_error_that_a_filter_absorbs_is_not_called_ok_without_the_smoothed_checks() -> None:
    (full,), (alone,) = (judged(WRONG_SCALE, own).evaluations for own in (FULL, FILTER))
    assert quantity_errors(alone)["rate"][-1] > 4
    assert [each.check for each in full.history.status.findings] == ["model-error:gyro-scale"]
    assert [each.check for each in alone.history.status.findings] == ["smoothed-checks-left-out"]


@pytest.mark.parametrize("number", [WRONG_SCALE, RIGHT])
def test_the_filters_own_checks_leave_no_quantity_that_holds(number: int) -> None:
    status = judged(number, FILTER).evaluations[0].history.status
    assert status.verdict is Verdict.DEGRADED
    assert Holds.OK not in {status.holds[name] for name in QUANTITIES}
    assert "--verdict full" in status.reasons[0]


def test_nothing_is_smoothed_behind_the_initialisation(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> NoReturn:
        raise AssertionError("asks for a smoothed motion")

    setup = prepare(drawn(RIGHT).dataset, FILTER)
    setup = replace(
        setup, initial=replace(setup.initial, departure=5.0)
    )  # vague: a full verdict smooths everything
    for module, name in (
        (doubts, "tested_models"),
        (doubts, "stated_level_diagnostics"),
        (agreement_tests, "smooth_at_once"),
    ):
        monkeypatch.setattr(module, name, refuse)
    (found,) = compare_estimators(setup, FILTER, lambda *_: None).evaluations
    assert found.history.status.verdict is Verdict.DEGRADED


def test_what_the_recording_shows_is_still_found() -> None:
    setup = prepare(drawn(RIGHT).dataset, FILTER)
    (gyro,) = setup.dataset.log.streams
    faster = replace(gyro, values=200.0 * gyro.values)
    log = replace(setup.dataset.log, streams=(faster,))
    models = doubts.models_of_recording(replace(setup, dataset=replace(setup.dataset, log=log)))
    assert [each.name for each in models.units] == ["gyro-unit"]


def test_a_filter_is_still_compared_with_a_smoother_among_the_estimators() -> None:
    both = replace(FILTER, estimators=("mekf", "smoother"))
    run = judged(RIGHT, both)
    found = doubts.doubts_of(run.evaluations, run.setup, both)
    assert found.smoother is not None
    assert found.smoother.name == "smoother"


def test_a_filter_whose_covariances_show_no_wrong_noise_is_not_tested_for_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run, entries = judged(RIGHT, FILTER), estimator_entries()
    named = finding("noise-not-tested", {"text": "for a test"})
    monkeypatch.setattr(doubts, "filter_noise_diagnostics", lambda *_: [named])
    evaluation, entry = run.evaluations[0], entries["mekf"]
    asked, left_out = (
        doubts.doubts_of(run.evaluations, run.setup, FILTER, untested=names).of(evaluation, entry)
        for names in ((), ("mekf",))
    )
    assert named in asked
    assert named not in left_out


def test_a_check_of_an_estimate_sees_what_it_was_made_from(monkeypatch: pytest.MonkeyPatch) -> None:
    run, seen = judged(RIGHT, FILTER), list[Evidence]()
    monkeypatch.setattr(doubts, "judge", lambda evidence: seen.append(evidence) or EstimatorStatus())
    found = doubts.doubts_of(run.evaluations, run.setup, FILTER)
    doubts.with_verdicts(found, FILTER, estimator_entries())
    assert seen[0].streams == run.setup.log.streams
