"""One inertia from several recordings: in common axes the prior counts once, and disagreement widens."""

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.evaluation.fused_inertia import fuse_inertias
from spinfilters.models.state_layout import Gaussian, StateLayout

LAYOUT = StateLayout(("s",))
PRIOR_STD = 0.01
"""Small, so that errors of the mass distribution add and a linear problem is the oracle."""


def belief_of(measured: np.ndarray, information: np.ndarray) -> Gaussian:
    """Posterior of one recording, which measures s with an information."""
    whole = information + np.eye(5) / PRIOR_STD**2
    mean = np.linalg.solve(whole, information @ measured)
    return Gaussian.from_covariance(LAYOUT, LAYOUT.retract(np.zeros(5), mean), np.linalg.inv(whole))


def test_a_prior_of_several_recordings_counts_once() -> None:
    generator = np.random.default_rng(1)
    # each shows directions of its own
    shown = [
        np.diag([2.5e7, 2.5e7, 0, 0, 0.0]),
        np.diag([0, 2.5e7, 2.5e7, 2.5e7, 0.0]),
        np.diag([0, 0, 0, 2.5e7, 250.0]),
    ]
    true = 0.004 * generator.standard_normal(5)
    measured = [true + 2e-4 * generator.standard_normal(5) for _ in shown]
    fused = fuse_inertias([belief_of(*each) for each in zip(measured, shown, strict=True)], PRIOR_STD)
    whole = np.eye(5) / PRIOR_STD**2 + sum(shown)
    mean = np.linalg.solve(whole, sum(W @ m for W, m in zip(shown, measured, strict=True)))
    std = np.sqrt(np.diag(np.linalg.inv(whole)))
    off = LAYOUT.local(np.zeros(5), fused.belief.mean) - mean
    assert (np.abs(off) < 0.3 * std).all()
    assert np.linalg.norm(fused.belief.factor, axis=1) == pytest.approx(std, rel=0.05)
    assert fused.degrees == 2
    assert fused.widening == 1.0


def test_recordings_that_contradict_one_another_widen_the_deviations() -> None:
    exact = 2.5e7 * np.eye(5)
    beliefs = [belief_of(np.full(5, value), exact) for value in (0.0, 0.004)]
    fused = fuse_inertias(beliefs, PRIOR_STD)
    assert fused.degrees == 5
    assert fused.probability < 1e-6
    assert fused.widening == pytest.approx(np.sqrt(fused.chi_square / 5))
    with pytest.raises(InputError, match="no recording"):
        fuse_inertias([], PRIOR_STD)
