"""Strength of an acceleration of several segments together."""

from typing import Any

import numpy as np
import pytest

from spinfilters.run.segment_runs import pooled_acceleration, strength_of

GRAVITY = 9.81


def estimate(strength: float, random: float = 0.2, status: str = "degraded") -> dict[str, Any]:
    """An entry of summary.json; lengths are known to 1 %."""
    parts = {"random": [0.1, 0.1, random], "calibration": [0.0, 0.0, 0.01 * strength]}
    return {
        "status": status,
        "acceleration": [0.0, 0.0, -strength],
        "deviation_parts": {"acceleration": parts},
    }


def test_what_chance_leaves_is_averaged_and_what_the_lengths_leave_is_not() -> None:
    generator = np.random.default_rng(8)
    pools = [
        pooled_acceleration([estimate(GRAVITY + 0.2 * generator.standard_normal()) for _ in range(4)])
        for _ in range(400)
    ]
    found = [pool for pool in pools if pool is not None]
    assert np.std([pool.strength.value for pool in found]) == pytest.approx(0.1, rel=0.1)
    assert found[0].strength.random == pytest.approx(0.1)
    assert found[0].strength.calibration == pytest.approx(0.0981, rel=0.05)
    assert np.mean([pool.chi_square for pool in found]) == pytest.approx(3.0, abs=0.4)


def test_a_segment_far_off_is_left_out_and_counted() -> None:
    pool = pooled_acceleration([*(estimate(GRAVITY + shift) for shift in (-0.1, 0.0, 0.1)), estimate(2.0)])
    assert pool is not None
    assert pool.strength.value == pytest.approx(GRAVITY)
    assert pool.left_out == 1
    assert pool.sentence.endswith("; left out as far off: 1")


def test_flights_that_disagree_widen_the_deviation() -> None:
    pool = pooled_acceleration([estimate(GRAVITY), estimate(GRAVITY + 3)])
    assert pool is not None
    assert pool.probability < 1e-6
    assert pool.strength.random > 1
    assert "chi-square" in pool.sentence


def test_estimates_that_failed_or_have_no_acceleration_do_not_count() -> None:
    assert strength_of(estimate(GRAVITY, status="failed")) is None
    assert strength_of({"status": "ok", "acceleration": None, "deviation_parts": {}}) is None
    assert pooled_acceleration([estimate(np.nan)]) is None
