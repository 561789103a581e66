"""What a narrower prior of a block makes of a belief and of the evidence."""

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.models.state_layout import Gaussian, StateLayout
from spinfilters.run.preparation import with_narrower_prior
from spinfilters.smoother.priors import FirstStatePrior

LAYOUT = StateLayout(("t", "v", "c"))
WIDE, NARROW = 1.0, 0.03


def linear_fit(std: float) -> tuple[FirstStatePrior, Gaussian, float]:
    """Prior, posterior and -2 ln evidence of six measurements of nine unknowns."""
    generator = np.random.default_rng(5)
    H, y = generator.standard_normal((6, 9)), generator.standard_normal(6)
    prior = FirstStatePrior(np.linspace(-0.1, 0.1, 9), np.array([3.0] * 6 + [std] * 3))
    P = np.diag(prior.std**2)
    S = H @ P @ H.T + np.eye(6)
    gain, rest = P @ H.T @ np.linalg.inv(S), y - H @ prior.mean
    belief = Gaussian.from_covariance(LAYOUT, prior.mean + gain @ rest, P - gain @ H @ P)
    return prior, belief, float(rest @ np.linalg.solve(S, rest) + np.linalg.slogdet(S)[1])


def test_a_narrower_prior_gives_the_belief_and_the_evidence_of_a_fit_with_it() -> None:
    prior, wide, cost = linear_fit(WIDE)
    _, narrow, least = linear_fit(NARROW)
    belief, more = with_narrower_prior(wide, prior, "c", NARROW)
    assert cost + more == pytest.approx(least, rel=1e-9)
    np.testing.assert_allclose(belief.mean, narrow.mean, atol=1e-9)
    np.testing.assert_allclose(belief.factor @ belief.factor.T, narrow.factor @ narrow.factor.T, atol=1e-9)


def test_the_same_prior_changes_nothing() -> None:
    prior, wide, _ = linear_fit(WIDE)
    assert with_narrower_prior(wide, prior, "c", WIDE) == (wide, 0.0)


def test_a_wider_prior_is_refused() -> None:
    prior, narrow, _ = linear_fit(NARROW)
    with pytest.raises(InputError, match=r"at most 0\.03"):
        with_narrower_prior(narrow, prior, "c", WIDE)
