"""Deviations of moments, log ratios and axes that hold for errors of four of them."""

import numpy as np
import pytest
from jaxtyping import Float

from spinfilters.core.mass_distribution import from_inertia, inertia_matrix
from spinfilters.models import body_spread as spread
from spinfilters.models.body import BodyEstimate, body_estimate
from spinfilters.models.body_spread import REACH, widest_departures
from spinfilters.models.state_layout import ROTATION_BLOCKS, Gaussian, StateLayout

LAYOUT = StateLayout(ROTATION_BLOCKS)
BODIES = {
    "thesis": (0.8328, 0.9688, 1.0),
    "needle": (0.03, 0.99, 1.0),
    "plate": (0.4, 0.61, 1.0),
    "near a sphere": (0.97, 0.985, 1.0),
    "axially symmetric": (0.6, 0.999, 1.0),
}
DRAWS = 20_000


def thin(seed: int, largest: float) -> Float[np.ndarray, "5 5"]:
    """A factor of a covariance in random directions, one of them known far worse than the others."""
    directions = np.linalg.qr(np.random.default_rng(seed).standard_normal((5, 5)))[0]
    return directions * (largest * np.array([1.0, 0.3, 0.1, 0.03, 0.01]))


def belief(moments: tuple[float, ...], steps: Float[np.ndarray, "5 5"]) -> Gaussian:
    """About a body along the axes g."""
    mean, factor = LAYOUT.origin(), 1e-3 * np.eye(LAYOUT.error_dim)
    mean[LAYOUT.mean_slice("s")] = from_inertia(np.diag(moments))
    factor[LAYOUT.slice("s"), LAYOUT.slice("s")] = steps
    return Gaussian(LAYOUT, mean, factor)


def bodies_of(
    about: Gaussian, errors: Float[np.ndarray, "n 5"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
    """Logarithms of the principal moments, ascending, and axes (columns) at errors of the mass distribution."""
    whole = np.zeros((len(errors), LAYOUT.error_dim))
    whole[:, LAYOUT.slice("s")] = errors
    s = LAYOUT.retract(about.mean, whole)[:, LAYOUT.mean_slice("s")]
    L = np.zeros((len(s), 3, 3))
    L[:, [0, 1, 2], [0, 1, 2]] = np.exp(np.stack([s[:, 0], s[:, 1], -s[:, 0] - s[:, 1]], axis=1))
    L[:, [1, 2, 2], [0, 0, 1]] = s[:, 2:]
    second, axes = np.linalg.eigh(L @ np.swapaxes(L, 1, 2))
    return np.log((second.sum(axis=1, keepdims=True) - second)[:, ::-1]), axes[:, :, ::-1]


def logs_of(about: Gaussian, errors: Float[np.ndarray, "n 5"]) -> Float[np.ndarray, "n 3"]:
    """Logarithms alone."""
    return bodies_of(about, errors)[0]


def axis_sizes(axes: Float[np.ndarray, "n 3 3"], body: BodyEstimate) -> Float[np.ndarray, "n 3"]:
    """Angles between axes and those published, in stated standard deviations: an axis moves by the turns about the others."""
    along = np.einsum("kg,ngk->nk", body.principal_axes_g, axes)
    turns = np.diag(body.principal_axes_cov)
    return np.arccos(np.minimum(np.abs(along), 1.0)) / np.sqrt(turns.sum() - turns)


def sizes(logs: Float[np.ndarray, "n 3"], body: BodyEstimate) -> Float[np.ndarray, "n 4"]:
    """Departures of J_min / J_max, J_mid / J_max, k1, k2 from those published, in stated standard deviations."""
    moments = np.exp(logs[:, :2] - logs[:, 2:]) - body.principal_moments[:2]
    ratios = logs[:, [2, 1]] - logs[:, [1, 0]] - [body.k1, body.k2]
    std = [*body.principal_moments_std[:2], body.k1_std, body.k2_std]
    return np.abs(np.concatenate([moments, ratios], axis=1)) / std


@pytest.mark.parametrize("largest", [0.03, 0.15])
@pytest.mark.parametrize("moments", BODIES.values(), ids=BODIES)
def test_errors_beyond_four_deviations_are_as_rare_as_those_of_a_gaussian(
    moments: tuple[float, float, float], largest: float
) -> None:
    about = belief(moments, thin(len(BODIES), largest))
    steps = about.factor[LAYOUT.slice("s"), LAYOUT.slice("s")]
    drawn = np.random.default_rng(0).standard_normal((DRAWS, 5)) @ steps.T
    logs, axes = bodies_of(about, drawn)
    body = body_estimate(about)
    each = np.concatenate([sizes(logs, body), axis_sizes(axes, body)], axis=1)
    beyond = (each > REACH).mean(axis=0)
    assert beyond.max() < 5e-4  # of a Gaussian 6e-5, of the length of two such numbers 3.4e-4


@pytest.mark.parametrize(("moments", "largest"), [("thesis", 0.15), ("near a sphere", 0.03)])
def test_mean_squares_alone_promise_what_they_do_not_keep(moments: str, largest: float) -> None:
    about = belief(BODIES[moments], thin(len(BODIES), largest))
    steps = about.factor[LAYOUT.slice("s"), LAYOUT.slice("s")]
    logs, axes = bodies_of(about, np.random.default_rng(0).standard_normal((DRAWS, 5)) @ steps.T)
    body = body_estimate(about, intervals=False)
    each = [(size > REACH).mean(axis=0).max() for size in (sizes(logs, body), axis_sizes(axes, body))]
    assert max(each) > 1.5e-3
    assert moments == "thesis" or each[1] > 1e-3


@pytest.mark.parametrize("seed", range(4))
def test_deviations_are_the_largest_departure_over_its_distance_of_many_points(seed: int) -> None:
    about, generator = belief(BODIES["near a sphere"], thin(seed, 0.1)), np.random.default_rng(seed)
    steps = about.factor[LAYOUT.slice("s"), LAYOUT.slice("s")]
    u = generator.standard_normal((DRAWS, 5))
    distance = generator.uniform(1.0, REACH, size=(DRAWS, 1))
    distance[::2] = REACH
    logs = logs_of(about, distance * u / np.linalg.norm(u, axis=1, keepdims=True) @ steps.T)
    own = logs_of(about, np.zeros((1, 5)))
    s, axes = about.mean[np.newaxis, LAYOUT.mean_slice("s")], body_estimate(about).principal_axes_g.T
    moments, ratios, _ = widest_departures(s, steps[np.newaxis], axes[np.newaxis])
    there = (np.abs(np.exp(logs - logs[:, 2:]) - np.exp(own - own[:, 2:])) / distance).max(axis=0)[:2]
    np.testing.assert_array_less(0.85 * there, moments[0, :2])  # searched for at the ends, looked at inside
    np.testing.assert_array_less(moments[0, :2], 1.1 * there)
    apart = (np.abs((logs - own)[:, [2, 1]] - (logs - own)[:, [1, 0]]) / distance).max(axis=0)
    np.testing.assert_array_less(0.85 * apart, ratios[0])


@pytest.mark.parametrize("moments", [(1.0, 1.0, 1.0), (0.97, 0.985, 1.0)], ids=["sphere", "near a sphere"])
def test_no_moment_of_a_near_sphere_that_counts_as_determined_is_three_deviations_off(
    moments: tuple[float, float, float],
) -> None:
    """Estimates lie outwards of it, and their quarter of the way back was 0.1 where that way was 3.6 deviations long."""
    steps, generator, determined = thin(3, 0.15), np.random.default_rng(1), 0
    truth = belief(moments, steps)
    for _ in range(400):
        error = np.zeros(LAYOUT.error_dim)
        error[LAYOUT.slice("s")] = steps @ generator.standard_normal(5)
        about_estimate = LAYOUT.reset_jacobian(error) @ truth.factor
        body = body_estimate(Gaussian(LAYOUT, LAYOUT.retract(truth.mean, error), about_estimate))
        if body.principal_moments_std.max() > 0.1:
            continue
        away = np.abs(body.principal_moments - moments)[:2] / body.principal_moments_std[:2]
        determined += 1
        assert away.max() < 3.0
    assert determined > 20


def test_correlations_of_moments_stay() -> None:
    about = belief(BODIES["thesis"], thin(1, 0.15))
    wide, narrow = (
        body_estimate(about, intervals).principal_moments_cov[:2, :2] for intervals in (True, False)
    )
    correlations = [cov[0, 1] / np.sqrt(cov[0, 0] * cov[1, 1]) for cov in (wide, narrow)]
    assert correlations[0] == pytest.approx(correlations[1])
    assert np.all(np.diag(wide) >= np.diag(narrow))
    assert np.any(np.diag(wide) > 1.2 * np.diag(narrow))


def test_no_uncertainty_reaches_nowhere() -> None:
    s = from_inertia(np.diag([0.5, 0.75, 1.0]))[np.newaxis]
    for departure in widest_departures(s, np.zeros((1, 5, 5)), np.eye(3)[np.newaxis]):
        np.testing.assert_allclose(departure, 0.0, atol=1e-14)


NEEDLE = np.array([6.5, -2.5, 3050.0, -3240.0, -1.5])
"""A mass distribution with a smallest moment of 5e-8, oblique: its numbers that are no logarithms are large."""


def needle_moments_std(std: float) -> Float[np.ndarray, "3"]:
    """Of the needle's moments, all numbers of its mass distribution being known to a deviation."""
    mean, factor = LAYOUT.origin(), 1e-3 * np.eye(LAYOUT.error_dim)
    mean[LAYOUT.mean_slice("s")] = NEEDLE
    factor[LAYOUT.slice("s"), LAYOUT.slice("s")] = std * np.eye(5)
    body = body_estimate(Gaussian(LAYOUT, mean, factor))
    assert body.principal_moments[0] < 1e-7
    return body.principal_moments_std


@pytest.mark.parametrize("std", [10.0, 1e3, 1e8])
def test_a_needle_of_which_nothing_is_known_may_be_a_sphere_or_a_disc(std: float) -> None:
    np.testing.assert_allclose(needle_moments_std(std) * REACH, [1.0, 0.5, 0.0], atol=1e-3)


def test_a_needle_that_is_known_to_be_one_stays_one() -> None:
    assert np.all(needle_moments_std(0.5)[:2] < 1e-6)


@pytest.mark.parametrize("largest", [0.01, 0.1])
def test_compiled_and_numpy_find_the_same_spread(monkeypatch: pytest.MonkeyPatch, largest: float) -> None:
    generator, moments = np.random.default_rng(2), np.diag([0.6, 0.8, 1.0])
    turns = np.linalg.qr(generator.standard_normal((20, 3, 3)))[0]
    s = np.array([from_inertia(turn @ moments @ turn.T) for turn in turns])
    axes = np.array([np.linalg.eigh(inertia_matrix(each))[1] for each in s])
    axes[..., 0] *= np.linalg.det(axes)[:, np.newaxis]  # right-handed
    factor = np.array([thin(seed, largest) for seed in range(len(s))])
    found = (*spread.body_spread(s, factor, axes), *widest_departures(s, factor, axes))
    monkeypatch.setattr(spread, "_library", lambda: None)
    expected = (*spread.body_spread(s, factor, axes), *widest_departures(s, factor, axes))
    for compiled, plain in zip(found, expected, strict=True):
        np.testing.assert_allclose(compiled, plain, rtol=1e-9, atol=1e-9 * plain.max())
