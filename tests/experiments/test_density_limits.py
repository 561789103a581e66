"""The study of what throws can tell of densities: its priors, and mixtures under them."""

import numpy as np
import pytest

from experiments.density_limits import DECADES, PRIORS, TRUE, DensityPairs, lines_of, prior_of


@pytest.fixture(name="pairs")
def wide_at_large_densities() -> DensityPairs:
    """One state without error, whose variance is the density of force; the data tell nothing."""
    count = len(DECADES)
    covariances = np.broadcast_to((10.0**DECADES)[:, None, None, None], (count, count, 1, 1))
    return DensityPairs(0.01, np.zeros((count, count)), np.ones((count, count, 1)), covariances)


def test_a_flat_prior_weighs_decades_by_their_deviations() -> None:
    flat = prior_of("flat")
    np.testing.assert_allclose(flat[2:] / flat[1:-1], np.sqrt(10.0))
    assert flat[0] == pytest.approx(10 ** ((DECADES[0] + 0.5) / 2))  # all below the least with it


def test_a_shrunk_prior_weighs_decades_alike_above_its_scale() -> None:
    shrunk = prior_of("shrunk")
    assert shrunk[-1] / shrunk[-2] == pytest.approx(1.0, abs=0.01)
    assert shrunk[1] / shrunk[2] < 0.5


def test_what_is_known_are_the_three_densities() -> None:
    known = prior_of("known 5")
    assert {int(k) for k in DECADES[known > 0]} == set(TRUE.values())
    assert known[0] == 5 * known.max(where=known < 5, initial=0.0)


def test_a_mixture_has_the_mean_variance_of_its_levels(pairs: DensityPairs) -> None:
    prior = prior_of("known 2")
    variance = prior @ 10.0**DECADES / prior.sum()
    nees, largest = pairs.mixed(prior)
    assert nees == pytest.approx(1 / variance)
    assert largest == pytest.approx(1 / np.sqrt(variance))
    assert pairs.at(-2)[0] == pytest.approx(100.0)
    assert pairs.between(-8, -3) == pytest.approx((0.0, 1e5))


def test_throws_that_do_not_determine_the_moments_are_not_counted(pairs: DensityPairs) -> None:
    beliefs = {name: pairs.mixed(prior_of(name)) for name in PRIORS} | {"true": pairs.at(-8)}
    row = {"density": 0.0, "dof": 1, "beliefs": beliefs, "between": (1.0, 2.0), "moments_std": 0.05}
    lines = list(lines_of([row, row | {"moments_std": 0.3}]))
    assert lines[0].startswith("1 of 2 ")
    assert any(line.startswith("band of 1 throws") for line in lines)
