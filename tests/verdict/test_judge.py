"""The verdict on an estimate, and what holds of it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from plain_comparison import plain_comparison

from experiments.honest_cases import RecordingCase, recordings
from spinfilters.evaluation.metrics import held_text
from spinfilters.models.status import (
    ALL,
    MOMENTS,
    NOTHING,
    QUANTITIES,
    TRANSLATION,
    EstimatorStatus,
    Finding,
    Holds,
    Verdict,
)
from spinfilters.run.estimation import Comparison
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM
from spinfilters.verdict.checks import CHECKS, Evidence, Needs, finding
from spinfilters.verdict.filter_diagnostics import over_confident_quantities
from spinfilters.verdict.judge import judge, moved_quantities, unmoved_quantities
from spinfilters.verdict.model_errors.alternatives import table
from spinfilters.verdict.model_errors.score_tests import ScoreTest

SETTINGS = Settings(estimators=("mekf",))


@cache
def compared(kind: str, steady: bool = False) -> Comparison:
    """A recording whose stated noise is true."""
    rate = (9.0, 0.0, 0.0) if steady else RICH_RPM
    case = RecordingCase(
        f"{kind} of the verdict", kind, moments=(1.0, 0.8, 0.55), rate_rpm=rate, epochs=60, psd=1e-9
    )
    settings = replace(SETTINGS, estimators=("mekf", "smoother"))
    return plain_comparison(recordings(case, 1)[0].dataset, settings)


def evidence(*found: Finding) -> Evidence:
    """Of poses of a rich motion of which these checks failed."""
    evaluation = compared("pose").evaluations[0]
    clean = replace(evaluation.history, status=EstimatorStatus())
    return Evidence(evaluation.with_fields(history=clean), found=found)


def test_an_estimate_of_which_nothing_was_found_is_ok_and_holds() -> None:
    status = judge(evidence())
    assert status.verdict is Verdict.OK
    assert status.reasons == ()
    assert dict(status.holds) == dict.fromkeys(QUANTITIES, Holds.OK)


def test_findings_are_told_in_the_order_of_the_list() -> None:
    late = finding("vague-initialisation", {"epochs": 10, "std": 0.2})
    early = finding("models-not-tested", {"text": "no factor"})
    own = Finding("of-a-plug-in", "its battery is low")
    status = judge(evidence(own, late, early))
    assert [each.check for each in status.findings] == [
        "models-not-tested",
        "vague-initialisation",
        "of-a-plug-in",
    ]
    names = [check.name for check in CHECKS]
    assert names.index("models-not-tested") < names.index("vague-initialisation")


SLIP = finding("front-end-slip", {"text": "the attitude jumps by 179 deg", "cure": "cut the recording"})


def test_a_certain_cause_is_told_first_and_what_follows_from_it_without_a_cure() -> None:
    given = evidence(
        finding("initialisation-unsettled", {}),
        finding("vague-initialisation", {"epochs": 10, "std": 0.2}),
        SLIP,
        finding("sensor-data", {}),
    )
    history = given.evaluation.history
    failed = replace(history, status=EstimatorStatus().failed("it stopped being finite at epoch 5"))
    findings = judge(replace(given, evaluation=given.evaluation.with_fields(history=failed))).findings
    assert [(each.check, bool(each.cure)) for each in findings] == [
        ("front-end-slip", True),
        ("not-finite", False),
        ("initialisation-unsettled", False),
        ("sensor-data", True),
        ("vague-initialisation", False),
    ]


def test_innovations_beside_a_slip_do_not_ask_for_larger_disturbances() -> None:
    slip, innovations = judge(too_large(evidence(SLIP))).findings
    assert (slip.check, innovations.check) == ("front-end-slip", "innovations-too-large")
    assert "process" not in innovations.reason
    (alone,) = judge(too_large(evidence())).findings
    assert "raise process.force_psd" in alone.reason


def too_large(given: Evidence) -> Evidence:
    """With innovations 13 times as large as they were."""
    return with_innovations(given, 13.0)


def with_innovations(given: Evidence, times: float) -> Evidence:
    """With innovations so many times as large as they were."""
    history = given.evaluation.history
    changed = replace(history, nis=times**2 * history.nis)
    return replace(given, evaluation=given.evaluation.with_fields(history=changed))


def test_innovations_far_within_the_noise_are_said_and_everything_holds() -> None:
    status = judge(with_innovations(evidence(), 0.05))
    (found,) = status.findings
    assert found.check == "innovations-too-small"
    assert "19 times smaller" in found.sentence
    assert "identified" in found.cure
    assert dict(status.holds) == dict.fromkeys(QUANTITIES, Holds.OK)


@pytest.mark.parametrize(("times", "expected"), [(0.8, 1.0), (0.3, 0.1), (0.05, 0.0)])
def test_innovations_that_the_noise_is_meant_to_leave_so_small_are_no_doubt(
    times: float, expected: float
) -> None:
    status = judge(replace(with_innovations(evidence(), times), expected_nis=expected))
    assert status.verdict is Verdict.OK


def test_small_innovations_of_few_epochs_may_be_chance() -> None:
    given = with_innovations(evidence(), 0.5)
    history = given.evaluation.history
    few = np.arange(len(history.time)) >= len(history.time) - 2
    few_epochs = replace(history, nis=history.nis * few, dof=history.dof * few)
    assert judge(given).findings[0].check == "innovations-too-small"
    assert not judge(replace(given, evaluation=given.evaluation.with_fields(history=few_epochs))).findings


def test_noise_that_a_check_names_is_not_said_to_be_too_large_again() -> None:
    stated = {"name": "sensors.x", "stated": 1.0, "seen": "0.1", "score": 9.0, "cure": "state another"}
    found = judge(with_innovations(evidence(finding("stated-noise", stated, NOTHING)), 0.05)).findings
    assert [each.check for each in found] == ["stated-noise"]


def test_a_wrong_unit_leaves_the_cures_of_what_it_does_not_reach() -> None:
    numbers = {"text": "the clock counts in ms", "cure": "give --clock"}
    unit = finding("wrong-unit", numbers, frozenset({"rate", "velocity"}), "clock-unit")
    first, vague = judge(evidence(finding("vague-initialisation", {"epochs": 10, "std": 0.2}), unit)).findings
    assert first.check == "wrong-unit:clock-unit"
    assert vague.cure


def test_a_check_whose_evidence_is_missing_is_not_made() -> None:
    given = evidence()
    assert {Needs.RECORDING, Needs.ESTIMATE, Needs.FILTER} == given.present
    other = compared("pose").evaluations[1]
    assert Needs.PEERS in replace(given, others=[given.evaluation, other]).present
    assert Needs.PEERS not in replace(given, others=[given.evaluation]).present
    assert Needs.FILTER not in Evidence(other).present  # a smoother has no innovations
    status = judge(replace(given, evaluation=other))
    assert status.verdict is Verdict.OK


def test_a_check_about_the_moments_leaves_the_rest() -> None:
    numbers = {"epochs": 40, "evidence": 2.0, "limit": 30.0, "why": "a steady spin shows its axis only"}
    holds = judge(evidence(finding("motion-shows-no-moments", numbers))).holds
    assert holds[MOMENTS] is Holds.NOT_DETERMINED
    assert all(holds[name] is Holds.OK for name in (*TRANSLATION, "rate", "attitude"))


def test_what_a_finding_is_about_goes_before_what_its_check_is_about() -> None:
    every, rate = (
        finding("models-not-tested", {"text": "no factor"}, about) for about in (None, frozenset({"rate"}))
    )
    assert set(judge(evidence(every)).holds.values()) == {Holds.DOUBTFUL}
    assert [name for name, state in judge(evidence(rate)).holds.items() if state is not Holds.OK] == ["rate"]


def test_words_that_were_written_elsewhere_get_the_cure_of_their_check() -> None:
    (reason,) = judge(evidence(Finding("sensor-data", "3 gyro samples are saturated"))).reasons
    assert reason == "3 gyro samples are saturated: choose a larger range of the sensor, or cut the recording"


def test_nothing_of_a_failed_estimate_holds() -> None:
    given = evidence()
    failed = replace(given.evaluation.history, status=EstimatorStatus().failed("no factor"))
    status = judge(replace(given, evaluation=given.evaluation.with_fields(history=failed)))
    assert status.verdict is Verdict.FAILED
    assert set(status.holds.values()) == {Holds.NOT_DETERMINED}


@pytest.mark.parametrize(("share", "state"), [(0.1, Holds.OK), (2.0, Holds.NOT_DETERMINED)])
def test_a_rate_is_determined_where_its_deviation_is_smaller_than_itself(share: float, state: Holds) -> None:
    given = evidence()
    history = given.evaluation.history
    factor, rate = history.factor.copy(), history.layout.slice("w")
    size = np.linalg.norm(history.mean[:, history.layout.mean_slice("w")], axis=1).mean()
    factor[:, rate] = 0.0
    factor[:, rate, rate] = share * size * np.eye(3)
    wide = given.evaluation.with_fields(history=replace(history, factor=factor))
    assert judge(replace(given, evaluation=wide)).holds["rate"] is state


def test_a_gyro_sees_no_position() -> None:
    evaluation = compared("gyro").evaluations[0]
    holds = evaluation.history.status.holds
    assert {name for name, state in holds.items() if state is Holds.NOT_DETERMINED} == TRANSLATION
    assert held_text(evaluation) == "all"


def test_a_steady_spin_shows_rate_and_attitude_but_no_moments() -> None:
    evaluation = compared("pose", steady=True).evaluations[-1]
    status = evaluation.history.status
    assert status.verdict is Verdict.DEGRADED
    assert status.holds[MOMENTS] is Holds.NOT_DETERMINED
    assert {status.holds[name] for name in ("rate", "velocity", "attitude")} == {Holds.OK}


def test_a_steady_spin_does_not_show_the_centre_of_mass_along_its_axis() -> None:
    for evaluation in compared("pose", steady=True).evaluations:
        holds = evaluation.history.status.holds
        assert holds["center_of_mass"] is not Holds.OK
        assert holds["position"] is Holds.DOUBTFUL


@pytest.mark.parametrize(
    ("held", "text"),
    [
        (QUANTITIES, "all"),
        (QUANTITIES[:5], "all but axes, centre of mass"),
        (("position", "rate"), "only position, rate"),
        ((), "nothing"),
    ],
)
def test_what_holds_is_told_in_the_fewest_words(held: tuple[str, ...], text: str) -> None:
    evaluation = compared("pose").evaluations[0]
    holds = {name: Holds.OK if name in held else Holds.DOUBTFUL for name in QUANTITIES}
    status = EstimatorStatus(Verdict.DEGRADED, (), holds)
    assert held_text(evaluation.with_status(status)) == text
    assert held_text(evaluation.with_status(EstimatorStatus())) == ""


def test_a_filter_is_doubted_in_what_it_states_too_small_beside_the_smoother() -> None:
    mekf, smoother = (each.history for each in compared("pose").evaluations)
    assert "rate" not in over_confident_quantities(mekf, smoother)
    factor = mekf.factor.copy()
    for block in ("a", "w"):  # both are in the deviations of rates in axes i
        factor[:, mekf.layout.slice(block)] /= 4.0
    found = over_confident_quantities(replace(mekf, factor=factor), smoother)
    assert {"rate", "attitude"} <= found
    assert "moments" not in found


def test_an_error_of_the_models_leaves_quantities_that_it_does_not_move() -> None:
    history = compared("pose").evaluations[-1].history
    std = np.linalg.norm(history.factor, axis=2)
    shift, velocity = np.zeros_like(std), history.layout.slice("v")
    shift[:, velocity] = 3.0 * std[:, velocity]
    moved = moved_quantities(history, shift)
    assert moved["velocity"] == pytest.approx(3.0, rel=1e-6)
    assert all(size < 1e-6 for name, size in moved.items() if name != "velocity")


def test_of_a_recording_that_is_longer_than_what_was_tested_an_error_leaves_nothing() -> None:
    history = compared("pose").evaluations[-1].history
    one, shift = np.ones(1), np.zeros(history.factor.shape[:2])
    test = ScoreTest(table()["drag"], one, 0.1 * one, 100.0, 1.0, 100.0, 0.0, shift)
    assert unmoved_quantities(history, test) == ALL
    assert unmoved_quantities(history, replace(test, shift=shift[:-1])) == NOTHING


def test_an_error_whose_removal_leads_to_no_state_leaves_nothing() -> None:
    history = compared("pose").evaluations[-1].history
    one, shift = np.ones(1), np.full(history.factor.shape[:2], 1e200)
    test = ScoreTest(table()["drag"], one, 0.1 * one, 100.0, 1.0, 100.0, 0.0, shift)
    assert unmoved_quantities(history, test) == NOTHING
