"""Which tests of model errors a verdict names."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.verdict import tested_models
from spinfilters.verdict.model_errors.alternatives import table
from spinfilters.verdict.model_errors.score_tests import ScoreTest
from spinfilters.verdict.recording_tests import Slip
from spinfilters.verdict.tested_models import model_findings


def reasons(models: tested_models.TestedModels) -> list[str]:
    """Sentences of the verdict."""
    return [each.reason for each in model_findings(models, None)]


@pytest.mark.parametrize(
    ("size", "level", "contradicted", "names"),
    [
        (1.5, 0.1, False, ()),
        (1.5, 0.1, True, ("torque",)),
        (1.5, 0.3, False, ("torque",)),
        (1.9, 0.1, False, ("torque",)),
        (2.1, 0.1, False, ("torque",)),
    ],
)
def test_an_error_beyond_chance_is_named_where_it_moves_a_state_or_a_noise_level(
    size: float, level: float, contradicted: bool, names: tuple[str, ...]
) -> None:
    std = np.full((3, 2), 0.1)
    shift = np.array([[0.0, 0.0], [0.01, -0.1 * size], [0.0, 0.02]])
    one = np.ones(1)
    test = ScoreTest(table()["torque"], one, one, 40.0, 1.0, 40.0, 1e-8, shift, level=level)
    assert tested_models.TestedModels((test,), contradicted, std=std).names == names


@pytest.mark.parametrize(
    ("statistic", "slow", "names"), [(6.0, False, ()), (7.0, False, ("torque",)), (7.0, True, ())]
)
def test_what_only_lets_noise_levels_fall_is_not_named(
    statistic: float, slow: bool, names: tuple[str, ...]
) -> None:
    one, std = np.ones(1), np.full((1, 1), 0.1)
    test = ScoreTest(table()["torque"], one, one, statistic, 1.0, 40.0, 1e-8, 5 * std, level=0.1)
    tests = (test, replace(test, error=table()["drag"], p_value=1.0))
    assert tested_models.TestedModels(tests, std=std, score_inflation=np.inf if slow else None).names == names


@pytest.mark.parametrize(
    ("size", "p_value", "slow", "named"),
    [
        (5.0, 1.9e-3, False, True),
        (5.0, 2.1e-3, False, False),
        (3.0, 1.9e-3, False, False),
        (5.0, 1.9e-3, True, False),
    ],
)
def test_an_error_that_alone_makes_estimates_wrong_is_named_sooner(
    size: float, p_value: float, slow: bool, named: bool
) -> None:
    one, std = np.ones(1), np.full((1, 1), 0.1)
    test = ScoreTest(table()["torque"], one, one, 40.0, 1.0, 40.0, p_value, size * std, level=0.1)
    others = tuple(replace(test, error=error, p_value=1.0) for error in list(table().values())[:9])
    assert (
        bool(
            tested_models.TestedModels(
                (test, *others), std=std, score_inflation=np.inf if slow else None
            ).names
        )
        == named
    )


@pytest.mark.parametrize(("wider", "named"), [(1.0, True), (1.2, True), (1.3, False)])
def test_an_error_that_the_stated_deviations_cover_is_one_of_many(wider: float, named: bool) -> None:
    """A focal length that may be a percent off is in the deviations of a calibration that nobody states."""
    one, std = np.ones(1), np.full((1, 1), 0.1)
    test = ScoreTest(table()["focal-length"], one, one, 10.0, 1.0, 10.0, 1e-3, 5 * std, level=0.1)
    others = tuple(replace(test, error=error, p_value=1.0) for error in list(table().values())[5:20])
    models = tested_models.TestedModels((test, *others), std=std, stated_std=wider * std)
    assert bool(models.names) == named


@pytest.mark.parametrize(
    ("name", "deviation"),
    [
        ("focal-length", "focal_std"),
        ("clock-drift", "clock_scale_std"),
        ("inspector-lever", "inspector_lever_std"),
    ],
)
def test_of_a_calibration_that_is_stated_a_test_is_one_of_many(name: str, deviation: str) -> None:
    one, std = np.ones(1), np.full((1, 1), 0.1)
    test = ScoreTest(table()[name], one, one, 10.0, 1.0, 10.0, 1e-3, 5 * std, level=0.1)
    others = tuple(
        replace(test, error=table()[each], p_value=1.0) for each in list(table())[:20] if each != name
    )
    models = tested_models.TestedModels((test, *others), std=std)
    assert models.names == (name,)
    assert replace(models, known_calibration=frozenset({deviation})).names == ()
    certain = replace(test, p_value=1e-4)
    known = replace(models, tests=(certain, *others), known_calibration=frozenset({deviation}))
    assert known.names == (name,)


def test_an_error_that_moves_no_estimate_is_named_where_it_explains_more_than_one_that_does() -> None:
    """Jitter of time stamps looks like a jump of the clock at its largest error."""
    one, std = np.ones(1), np.full((1, 1), 0.1)
    jitter = ScoreTest(
        table()["clock-jitter"], one, one, 29.0, 1.0, 120.0, 1e-6, 0.5 * std, np.array([1.0, 0.0])
    )
    jump = ScoreTest(table()["torque"], one, one, 24.0, 1.0, 24.0, 1e-4, 7 * std, np.array([0.0, 1.0]))
    assert tested_models.TestedModels((jitter, jump), std=std).names == ("clock-jitter", "torque")
    assert tested_models.TestedModels((jitter,), std=std).names == ()


@pytest.mark.parametrize(
    ("name", "contradicted", "p_value", "named"),
    [
        ("clock-jitter", True, 9e-3, True),
        ("clock-jitter", True, 2e-2, False),
        ("clock-jitter", False, 9e-3, False),
        ("torque", True, 9e-3, False),
    ],
)
def test_beside_too_small_a_noise_few_errors_are_drawn_at_every_epoch(
    name: str, contradicted: bool, p_value: float, named: bool
) -> None:
    one, std = np.ones(1), np.full((1, 1), 0.1)
    test = ScoreTest(table()[name], one, one, 15.0, 1.0, 60.0, p_value, 0.5 * std)
    others = tuple(replace(test, error=table()[each], p_value=1.0) for each in ("drag", "hinge", "rotor"))
    assert bool(tested_models.TestedModels((test, *others), contradicted, std=std).names) == named


def test_beside_slow_noise_an_error_must_move_states_by_twice_as_much() -> None:
    one, std = np.ones(1), np.full((1, 1), 0.1)
    test = ScoreTest(table()["torque"], one, one, 40.0, 1.0, 40.0, 1e-8)
    for effect, slow, names in ((1.5, False, ("torque",)), (1.5, True, ()), (2.5, True, ("torque",))):
        own = replace(test, shift=effect * std)
        assert (
            tested_models.TestedModels((own,), std=std, score_inflation=np.inf if slow else None).names
            == names
        )


@pytest.mark.parametrize(
    ("statistic", "inflation", "names"),
    [(50.0, 5.0, ("torque",)), (45.0, 5.0, ()), (50.0, 6.0, ()), (50.0, np.inf, ())],
)
def test_a_score_beyond_what_slow_noise_feigns_is_named_as_without_it(
    statistic: float, inflation: float, names: tuple[str, ...]
) -> None:
    one, std = np.ones(1), np.full((9, 1), 0.1)
    shift = np.array([[0.25], *[[0.0]] * 8])  # between the limits at one epoch, and below them over all
    test = ScoreTest(table()["torque"], one, one, statistic, 1.0, 40.0, 1e-8, shift)
    tested = tested_models.TestedModels((test,), std=std, score_inflation=inflation)
    assert tested.names == names


def test_errors_that_explain_the_same_residuals_are_named_as_one() -> None:
    one, alike, other = np.ones(1), np.array([1.0, 0.1, 0.0]), np.array([0.0, 1.0, 0.0])
    tests = tuple(
        ScoreTest(table()[name], one, one, gain, 1.0, gain, 1e-9, None, explained)
        for name, gain, explained in (
            ("drag", 60.0, np.array([2.0, 0.0, 0.0])),
            ("energy-loss", 55.0, alike),
            ("torque", 50.0, other),
            ("hinge", 45.0, other),
            ("rotor", 40.0, np.array([0.0, 0.0, 1.0])),
        )
    )
    models = tested_models.TestedModels(tests)
    assert models.names == ("drag/energy-loss", "torque/hinge")
    assert [each.error.name for each in models.named] == ["drag", "energy-loss", "torque", "hinge"]
    (reason,) = reasons(models)
    assert reason.startswith(
        'the residuals are most like drag of the rotation (1 +- 1 1/rad, chi-square 60): set process.drag = "auto"'
    )
    cause, possible = reason.split(". Also possible: ")
    assert "looks alike" not in cause
    assert possible == (
        "a loss of energy within the body (explains 91% as much), a constant body torque (explains 83% as much), "
        "parts that move inside (a hinge, an elbow) (explains 74% as much)"
    )
    assert len(cause) < 160


@pytest.mark.parametrize(("gain", "is_possible"), [(12.0, False), (25.0, True)])
def test_an_error_of_an_inspector_is_possible_beside_a_cause_from_a_comparable_share_on(
    gain: float, is_possible: bool
) -> None:
    one, std = np.ones(1), np.full((1, 1), 0.1)
    torque = ScoreTest(table()["torque"], one, one, 40.0, 1.0, 40.0, 1e-8, 5 * std)
    late = ScoreTest(table()["inspector-delay"], one, one, gain, 1.0, gain, 0.01)
    models = tested_models.TestedModels((torque, late), std=std)
    assert models.names == ("torque",)
    assert ("poses of the inspector that are late" in models.causes) == is_possible


@pytest.mark.parametrize("name", ["camera-shake", "clock-jitter"])
def test_the_cure_of_shaking_images_speaks_of_the_poses_where_they_are_given(name: str) -> None:
    one, std = np.ones(1), np.full((1, 1), 0.1)
    shake = ScoreTest(table()[name], one, one, 40.0, 1.0, 40.0, 1e-8, 5 * std)
    at_rest = tested_models.TestedModels((shake,), std=std)
    moving = replace(at_rest, has_inspector=True)
    accurate = "known to what a pixel is (inspector.tum)"
    assert accurate in moving.causes
    assert accurate not in at_rest.causes
    assert "give its motion" not in moving.causes


def test_what_is_impossible_is_not_named_but_doubted() -> None:
    one, std = np.ones(1), np.full((1, 1), 0.1)
    jitter = ScoreTest(table()["clock-jitter"], one, one, 90.0, 1.0, 90.0, 1e-9, std, is_possible=False)
    alone = tested_models.TestedModels((jitter,), std=std)
    assert alone.names == ()
    assert "no tested error explains them" in reasons(alone)[0]
    touch = replace(jitter, error=table()["contact-at-end"], is_possible=True)
    beside = tested_models.TestedModels((jitter, touch), std=std)
    assert beside.names == ("contact-at-end",)
    assert len(reasons(beside)) == 1


@pytest.mark.parametrize(
    ("left", "names"), [(3.0, ("slow-change",)), (40.0, ("slow-change", "contact-at-end"))]
)
def test_beside_slow_changes_an_error_is_named_by_what_they_leave(
    left: float, names: tuple[str, ...]
) -> None:
    one, std = np.ones(1), np.full((1, 1), 0.1)
    drag = ScoreTest(table()["drag"], one, one, 90.0, 1.0, 90.0, 1e-9, std, slow=0.99, beside_slow=0.1)
    touch = replace(drag, error=table()["contact-at-end"], slow=0.5, beside_slow=left)
    assert tested_models.TestedModels((drag, touch), std=std).names == names


def test_beside_a_slip_neither_causes_nor_slow_changes_are_named() -> None:
    one, std = np.ones(1), np.full((1, 1), 0.1)
    drag = ScoreTest(table()["drag"], one, one, 90.0, 1.0, 90.0, 1e-9, std, slow=0.99, beside_slow=0.1)
    touch = replace(drag, error=table()["contact-at-end"], slow=0.5, beside_slow=40.0)
    models = tested_models.TestedModels((drag, touch), std=std, slips=(Slip("pose", 3.0, 0.0, np.pi, 1),))
    assert models.names == ("slip",)
    assert len(reasons(models)) == 1


def test_a_cause_is_the_likeliest_of_several_and_others_have_their_share() -> None:
    one = np.ones(1)
    tests = tuple(
        ScoreTest(table()[name], one, one, gain, 1.0, gain, 1e-9)
        for name, gain in (("rotor", 102.0), ("hinge", 72.0), ("clock-drift", 52.0))
    )
    models = tested_models.TestedModels(tests)
    (reason,) = reasons(models)
    assert models.names == ("rotor", "hinge")
    assert reason.startswith("the residuals are most like a flywheel turning inside (1 +- 1 rad/s")
    assert reason.endswith("explains 70% as much)")
    assert "Also possible: parts that move inside" in reason


@pytest.mark.parametrize(("inflation", "names"), [(1.0, ("right-camera-turned",)), (5.0, ()), (2.0, ())])
def test_a_score_that_lasting_errors_of_landmarks_feign_is_not_named(
    inflation: float, names: tuple[str, ...]
) -> None:
    one = np.ones(1)
    test = ScoreTest(table()["right-camera-turned"], one, one, 20.0, 1.0, 20.0, 1e-5)
    others = tuple(replace(test, error=error, p_value=1.0) for error in list(table().values())[:9])
    correlated = replace(tested_models.NO_CORRELATION, score_inflation=inflation)
    assert tested_models.TestedModels((test, *others), correlated=correlated).names == names


@pytest.mark.parametrize(("left", "names"), [(3.0, ("map-error",)), (40.0, ("point-drift",))])
def test_beside_errors_of_a_map_an_error_is_named_by_what_they_leave(
    left: float, names: tuple[str, ...]
) -> None:
    one, std = np.ones(1), np.full((1, 1), 0.1)
    drift = ScoreTest(table()["point-drift"], one, one, 90.0, 1.0, 90.0, 1e-9, std, beside_map=left)
    models = tested_models.TestedModels((replace(drift, map_share=0.88),), std=std)
    assert models.names == names
    reason, of_map = reasons(models)[0], names == ("map-error",)
    assert ("errors of the map" in reason and "explain 88% of it" in reason) == of_map
    assert (drift.error.phrase in reason) != of_map  # what the map explains is no evidence for it
