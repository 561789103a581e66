"""The marginal posterior of the mass distribution: where it is asked for, and what it says of a weak motion."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from jaxtyping import Float
from scipy.special import ndtr, ndtri

from spinfilters import compare, simulate
from spinfilters.core.mass_distribution import exponential
from spinfilters.core.posterior_sampling import smoothed_weights
from spinfilters.evaluation.stated_errors import quantity_errors
from spinfilters.inference import smoother_run
from spinfilters.inference.smoother_run import LARGEST_SAMPLED_NEES, NOT_GAUSSIAN
from spinfilters.io.dataset import Dataset
from spinfilters.models.body import MassSamples, body_estimate, turn_of_axes
from spinfilters.models.state_layout import Gaussian, StateLayout
from spinfilters.smoother import mass_posterior
from spinfilters.smoother.mass_posterior import (
    SAMPLES,
    SampledMass,
    even_points,
    log_volume_ratio,
    motion_widening,
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


@cache
def weak_run() -> tuple[Dataset, dict[str, Any]]:
    """Poses of a motion that tells the moments badly, and what both and a baseline state of it."""
    data = simulate("pose", rate_rpm=WEAK_RPM, frames=100, seed=1)
    estimators = ["mekf", "smoother", "ekf-joint"]
    return data, compare(data, estimators, verdict="filter").summary["estimators"]


@pytest.mark.parametrize("name", ["smoother", "mekf"])
def test_a_weak_motion_publishes_the_marginal_posterior_and_not_its_mode(name: str) -> None:
    data, run = weak_run()
    assert data.truth is not None
    assert data.truth.principal_moments is not None
    truth, found = np.sort(data.truth.principal_moments), run[name]
    away = np.array(found["principal_moments"]) - truth / truth[-1]
    assert (np.abs(away[:2]) < 2.5 * np.array(found["principal_moments_std"])[:2]).all()
    low, high = np.array(found["principal_moments_interval"]).T
    assert (low[:2] <= (truth / truth[-1])[:2]).all()
    assert ((truth / truth[-1])[:2] <= high[:2]).all()


def test_filters_share_the_samples_of_the_smoother_and_baselines_keep_their_own_moments() -> None:
    _, found = weak_run()
    assert found["mekf"]["principal_moments"] == found["smoother"]["principal_moments"]
    assert found["ekf-joint"]["principal_moments_interval"] is None


def test_a_rich_motion_is_not_sampled() -> None:
    run = compare(simulate("pose", frames=115), ["smoother"], verdict="filter")
    assert run.summary["estimators"]["smoother"]["principal_moments_interval"] is None


def test_samples_of_a_gaussian_belief_state_its_axes_and_their_deviations() -> None:
    layout, random = StateLayout(("s",)), np.random.default_rng(1)
    belief = Gaussian(layout, np.array([0.3, -0.2, 0.1, 0.05, -0.1]), 0.01 * np.eye(5))
    points = layout.retract(np.tile(belief.mean, (4000, 1)), 0.01 * random.standard_normal((4000, 5)))
    of_belief = body_estimate(belief)
    found = MassSamples(points, np.full(4000, 1 / 4000), 0.0, 0.0).body(of_belief)
    assert found.principal_axes_std == pytest.approx(of_belief.principal_axes_std, rel=0.15)
    turn = turn_of_axes(of_belief.principal_axes_g, found.principal_axes_g)
    assert (np.abs(turn) < 0.1 * of_belief.principal_axes_std).all()


def test_axes_do_not_depend_on_the_belief_that_is_given_samples() -> None:
    random = np.random.default_rng(2)
    points = np.array([0.3, -0.2, 0.1, 0.05, -0.1]) + 0.1 * random.standard_normal((300, 5))
    mass = MassSamples(points, np.full(300, 1 / 300), 0.0, 0.0)
    layout = StateLayout(("s",))
    bodies = [mass.body(body_estimate(Gaussian(layout, mean, 0.1 * np.eye(5)))) for mean in points[:2]]
    np.testing.assert_array_equal(bodies[0].principal_axes_g, bodies[1].principal_axes_g)
    assert (mass.weights @ mass.turns(mass.principal_axes)) == pytest.approx(np.zeros(3), abs=1e-5)


def test_axes_whose_moments_are_equal_are_stated_as_undetermined() -> None:
    # a sphere to within the samples: their axes point anywhere
    points = 1e-3 * np.random.default_rng(3).standard_normal((1000, 5))
    body = MassSamples(points, np.full(1000, 1e-3), 0.0, 0.0).body(
        body_estimate(Gaussian(StateLayout(("s",)), np.zeros(5), 1e-3 * np.eye(5)))
    )
    assert (body.principal_axes_std > 0.5).all()


def test_a_gaussian_that_misses_most_of_the_posterior_does_not_state_the_axes() -> None:
    # the samples lie along a ridge of which the Gaussian about the mode follows the tangent
    data = simulate("pose", rate_rpm=WEAK_RPM, frames=100, seed=3)
    run = compare(data, ["mekf", "smoother"], verdict="filter")
    smoother, mekf = (run[name].evaluation for name in ("smoother", "mekf"))
    assert smoother.history.mass is not None
    assert smoother.history.mass.gaussian_nees > LARGEST_SAMPLED_NEES
    np.testing.assert_array_equal(mekf.body.principal_axes_g, smoother.body.principal_axes_g)
    assert NOT_GAUSSIAN not in run["smoother"].checks
    for name in ("smoother", "mekf"):
        errors = quantity_errors(run[name].evaluation)
        assert max(float(each[-1]) for each in errors.values()) < 3.5, name


@pytest.mark.parametrize(("gaussian", "told"), [(0.9, True), (0.3, False)])
def test_samples_that_cannot_be_relied_upon_are_told_where_a_gaussian_does_not_do(
    gaussian: float, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = simulate("pose", rate_rpm=WEAK_RPM, frames=60, seed=3)
    made = smoother_run.sampled_mass
    for few in ("SAMPLES", "TRIED", "MOST_NODES"):  # which they are, nobody asks
        monkeypatch.setattr(mass_posterior, few, 40)

    def unreliable(*arguments: Any) -> SampledMass | None:
        """Samples with weights of an infinite variance."""
        found = made(*arguments)
        assert found is not None
        mass = replace(found.mass, shape=0.8, gaussian_shape=gaussian, gaussian_nees=1.0)
        return replace(found, mass=mass)

    monkeypatch.setattr(smoother_run, "sampled_mass", unreliable)
    run = compare(data, ["mekf", "smoother"], verdict="filter")
    for name in ("mekf", "smoother"):
        assert run[name].evaluation.history.mass is None
        assert (NOT_GAUSSIAN in run[name].checks) == told, name


def test_deviations_of_the_motion_cover_the_samples_of_the_mass_distribution() -> None:
    # the rate follows one number with a slope of 2; the Gaussian knows that to 0.01, its samples are 0.03 wide
    layout = StateLayout(("w", "s"))
    factor = np.zeros((8, 8))
    factor[:3, :3] = 0.1 * np.eye(3)
    s = layout.slice("s")
    factor[s, s] = 0.01 * np.eye(5)
    factor[0, s.start] = 0.02
    random = np.random.default_rng(4)
    d = np.zeros((2000, 8))
    d[:, s.start] = 0.03 * random.standard_normal(2000)
    d[:, 0] = 2 * d[:, s.start]
    mean = np.zeros((1, layout.mean_dim))
    trajectories = layout.retract(np.repeat(mean, 2000, axis=0), d)[:, np.newaxis]
    times = motion_widening(layout, mean, factor[np.newaxis], trajectories, np.full(2000, 1 / 2000))[0]
    expected = np.sqrt((0.1**2 + 0.06**2) / (0.1**2 + 0.02**2))
    assert times[0] == pytest.approx(expected, rel=0.02)
    np.testing.assert_array_equal(times[1:], np.ones(7))
