"""The marginal posterior of the mass distribution: where it is asked for, and what it says of a weak motion."""

from collections.abc import Callable

import numpy as np
import pytest
from jaxtyping import Float
from scipy.special import ndtr, ndtri

from spinfilters import compare, simulate
from spinfilters.core.importance_weights import smoothed_weights
from spinfilters.core.mass_distribution import exponential
from spinfilters.models.body import MassSamples
from spinfilters.smoother.mass_posterior import (
    SAMPLES,
    even_points,
    log_volume_ratio,
    shares_of_nodes,
    traceless_part,
)

WEAK_RPM = (2.0, 6.0, 1.0)
STEP = 0.7


def _stated_deviations(
    log_density: Callable[[np.ndarray], np.ndarray], fallen: float, count: int
) -> Float[np.ndarray, " c"]:
    """Deviation about zero that samples of a density along a straight ridge state, by seed."""
    nodes = STEP * np.arange(-30, 31)
    nodes = nodes[log_density(nodes) > -fallen]
    share, stated = shares_of_nodes(log_density(nodes)), []
    for seed in range(count):
        uniform = even_points(SAMPLES, 2, seed)
        chosen = np.minimum(np.searchsorted(np.cumsum(share), uniform[:, 0]), len(nodes) - 1)
        x = nodes[chosen] + ndtri(uniform[:, 1])
        proposed = np.logaddexp.reduce(np.log(share) - (x[:, np.newaxis] - nodes) ** 2 / 2, axis=1)
        weights = smoothed_weights(log_density(x) - proposed).weights
        stated.append(MassSamples(np.zeros((SAMPLES, 5)), weights, 0.0, 0.0).deviation(x, 0.0))
    return np.array(stated)


def test_samples_of_a_normal_ridge_state_its_deviation_and_hardly_more() -> None:
    stated = _stated_deviations(lambda x: -(x**2) / 2, 12.0, 40)
    assert stated.min() > 0.98
    assert np.median(stated) < 1.04
    assert stated.max() < 1.10


def test_samples_of_a_ridge_with_long_tails_state_its_four_deviations() -> None:
    def log_density(x: np.ndarray) -> np.ndarray:
        return -np.hypot(1.0, 1.3 * x)

    grid = np.linspace(-30.0, 30.0, 200_001)
    reached = np.cumsum(np.exp(log_density(grid)))
    far = float(np.interp(1 - ndtr(-4.0), reached / reached[-1], grid))
    stated = _stated_deviations(log_density, 12.0, 40)
    assert np.median(stated) == pytest.approx(far / 4, rel=0.02)
    assert stated == pytest.approx(np.full(40, far / 4), rel=0.06)


def test_the_volume_ratio_is_that_of_the_exponential_map() -> None:
    d = np.array([0.7, -0.2, 0.4, 0.1, -0.5])
    D, h = traceless_part(d), 1e-5
    root = np.linalg.cholesky(np.array(exponential(D)))
    columns = []
    for k in range(5):
        ends = [np.array(exponential(traceless_part(d + sign * h * np.eye(5)[k]))) for sign in (1, -1)]
        change = np.linalg.solve(root, np.linalg.solve(root, (ends[0] - ends[1]).T / (2 * h)).T)
        columns.append([change[0, 0], change[1, 1], change[1, 0], change[2, 0], change[2, 1]])
    assert np.linalg.slogdet(np.array(columns))[1] == pytest.approx(log_volume_ratio(D), abs=1e-6)
    assert log_volume_ratio(np.zeros((3, 3))) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("name", ["smoother", "mekf"])
def test_a_weak_motion_publishes_the_marginal_posterior_and_not_its_mode(name: str) -> None:
    data = simulate("pose", rate_rpm=WEAK_RPM, frames=100, seed=1)
    assert data.truth is not None
    assert data.truth.principal_moments is not None
    truth = np.sort(data.truth.principal_moments)
    found = compare(data, [name], verdict="filter").summary["estimators"][name]
    away = np.array(found["principal_moments"]) - truth / truth[-1]
    assert (np.abs(away[:2]) < 2.5 * np.array(found["principal_moments_std"])[:2]).all()
    low, high = np.array(found["principal_moments_interval"]).T
    assert (low[:2] <= (truth / truth[-1])[:2]).all()
    assert ((truth / truth[-1])[:2] <= high[:2]).all()


def test_filters_share_the_samples_of_the_smoother_and_baselines_keep_their_own_moments() -> None:
    data = simulate("pose", rate_rpm=WEAK_RPM, frames=100, seed=1)
    found = compare(data, ["mekf", "smoother", "ekf-joint"], verdict="filter").summary["estimators"]
    assert found["mekf"]["principal_moments"] == found["smoother"]["principal_moments"]
    assert found["ekf-joint"]["principal_moments_interval"] is None


def test_a_rich_motion_is_not_sampled() -> None:
    run = compare(simulate("pose", frames=115), ["smoother"], verdict="filter")
    assert run.summary["estimators"]["smoother"]["principal_moments_interval"] is None


def test_a_gaussian_that_misses_most_of_the_posterior_is_told() -> None:
    # the samples lie along a ridge of which the Gaussian about the mode follows the tangent
    data = simulate("pose", rate_rpm=WEAK_RPM, frames=100, seed=3)
    reasons = compare(data, ["smoother"]).summary["estimators"]["smoother"]["reasons"]
    assert any("not Gaussian" in each for each in reasons)
