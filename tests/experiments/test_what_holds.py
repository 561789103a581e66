"""The study of what is said to hold: its sample and its counts."""

from typing import Any

import numpy as np

from experiments.what_holds import NO_MAP, JudgedQuantity, drawn, lines_of


def row(verdict: str, holds: str, last: float, beyond: int, fault: str = "") -> dict[str, Any]:
    """Of an estimate with 40 own epochs that publishes its rate alone."""
    rate = {
        "holds": holds,
        "epochs": 40,
        "beyond": beyond,
        "largest": max(last, 5.0 * (beyond > 0)),
        "last": last,
        "rms": 1.0,
    }
    told = {"run": 1, "kind": "gyro", "motion": "rich", "fault": fault, "size": 1.0, "stated": True}
    checks = [] if verdict == "ok" else ["model-error:drag"]
    return {**told, "estimator": "mekf", "verdict": verdict, "checks": checks, "quantities": {"rate": rate}}


def test_one_epoch_beyond_is_chance_and_many_or_the_last_are_not() -> None:
    wrong = [
        JudgedQuantity(row("ok", "ok", last, beyond), "rate").is_wrong
        for last, beyond in ((1, 1), (1, 8), (6, 1))
    ]
    assert wrong == [False, True, True]


def test_what_is_wrong_and_said_to_hold_is_counted_and_listed() -> None:
    rows = [
        row("degraded", "doubtful", 9.0, 20, "drag"),
        row("degraded", "ok", 9.0, 20, "drag"),
        row("ok", "ok", 1.0, 0),
    ]
    text = "\n".join(lines_of(rows))
    assert "wrong: 2 of 3, of these said to hold 1" in text
    assert "beyond 4: 20 of 80 (epoch, quantity) 25.00%" in text
    assert text.count("run 1, mekf, gyro, rich, drag x 1") == 1


def test_epochs_beyond_are_counted_beside_what_chance_explains() -> None:
    """120 values exceed four deviations with 6.3e-5 each."""
    rows = [row("ok", "ok", 1.0, 1), row("ok", "ok", 1.0, 0), row("ok", "ok", 1.0, 9, "drag")]
    (line,) = (each for each in lines_of(rows) if each.startswith("ok without fault"))
    assert "1 of 2 estimates have an epoch beyond 4 50.0%" in line
    assert "normal errors 0.008 values each and at most 0.8%" in line


def test_of_degraded_estimates_that_are_right_those_are_counted_that_hold() -> None:
    rows = [row("degraded", "doubtful", 1.0, 0), row("degraded", "ok", 1.0, 0)]
    (line,) = (each for each in lines_of(rows) if "degraded, rate" in each)
    assert line.split() == [
        "degraded,",
        "rate",
        "2",
        "runs,",
        "right",
        "in",
        "2,",
        "of",
        "these",
        "said",
        "to",
        "hold",
        "1",
    ]


def test_every_second_draw_has_a_fault_and_a_number_draws_the_same_twice() -> None:
    some = [drawn(number) for number in range(6)]
    assert [bool(each.fault) for each in some] == [False, True] * 3
    assert all((each.dataset.known_map is None) == (each.kind in (NO_MAP, "gyro", "pose")) for each in some)
    np.testing.assert_array_equal(
        drawn(1).dataset.log.streams[0].values, some[1].dataset.log.streams[0].values
    )
