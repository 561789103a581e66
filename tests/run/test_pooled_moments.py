"""Inertia ratios of several segments together."""

from typing import Any

import numpy as np
import pytest

from spinfilters.run.segment_runs import pooled_moments

TRUE = np.array([0.2, 0.8])
STD = np.array([0.003, 0.004])


def estimate(ratios: np.ndarray, status: str = "ok") -> dict[str, Any]:
    """An entry of summary.json."""
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = np.diag(STD**2)
    return {
        "status": status,
        "principal_moments": [*ratios.tolist(), 1.0],
        "principal_moments_cov": covariance.tolist(),
    }


def test_the_chi_square_of_segments_that_agree_has_its_mean_and_the_pool_its_deviation() -> None:
    generator = np.random.default_rng(6)
    pools = [
        pooled_moments([estimate(TRUE + STD * generator.standard_normal(2)) for _ in range(5)], 5)
        for _ in range(400)
    ]
    found = [pool for pool in pools if pool is not None]
    assert np.mean([pool.chi_square for pool in found]) == pytest.approx(8.0, abs=0.6)
    error = np.array([(pool.ratios - TRUE) / np.sqrt(np.diag(pool.covariance)) for pool in found])
    assert np.mean(error**2) == pytest.approx(1.0, abs=0.15)
    assert np.mean([pool.widening > 1 for pool in found]) < 0.03


def test_segments_that_disagree_widen_the_deviations_and_say_so() -> None:
    pool = pooled_moments([estimate(TRUE), estimate(TRUE + 10 * STD)], 3)
    assert pool is not None
    assert pool.probability < 1e-6
    assert (pool.std > 5 * np.sqrt(np.diag(pool.covariance))).all()
    assert "the segments disagree beyond their deviations" in pool.sentence
    assert pool.document["segments_ok"] == 2
    assert pool.document["segments"] == 3


def test_only_segments_that_are_ok_and_finite_count() -> None:
    empty = estimate(TRUE)
    empty["principal_moments_cov"] = [[None] * 3] * 3
    assert pooled_moments([estimate(TRUE, "degraded"), empty], 2) is None
    pool = pooled_moments([estimate(TRUE), empty], 2)
    assert pool is not None
    assert pool.probability == 1.0
    assert "chi-square" not in pool.sentence
