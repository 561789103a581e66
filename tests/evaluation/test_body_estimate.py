"""Principal moments, axes and ratios of a belief, and their covariance against sampling."""

from functools import cache

import numpy as np
import pytest

from spinfilters.core.mass_distribution import inertia_matrix
from spinfilters.evaluation.estimated_motion import body_history
from spinfilters.models.body import UNDETERMINED_STD, body_estimate
from spinfilters.models.state_layout import ROTATION_BLOCKS, Gaussian, StateLayout
from tests.evaluation.estimate_samples import AXES, FULL, MOMENTS, history_of, sample_factor, sample_point

SAMPLES = 4000
SAMPLING = 4 / np.sqrt(2 * SAMPLES)
"""Relative error of a sampled standard deviation, four standard deviations of it."""


def belief(seed: int, scale: float = 2e-3) -> Gaussian:
    generator = np.random.default_rng(seed)
    return Gaussian(FULL, sample_point(generator), sample_factor(generator, FULL.error_dim, scale))


@cache
def eigen_of_samples(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Moments (largest 1) and small rotations of the axes of samples, without the code under test."""
    errors = np.random.default_rng(11).standard_normal((SAMPLES, FULL.error_dim)) @ belief(seed).factor.T
    points = FULL.retract(belief(seed).mean, errors)
    reference = body_estimate(belief(seed)).principal_axes_g
    moments, turns = [], []
    for s in points[:, FULL.mean_slice("s")]:
        values, vectors = np.linalg.eigh(inertia_matrix(s))
        relative = reference @ vectors
        relative = relative * np.sign(np.diag(relative))
        moments.append(values / values[2])
        turns.append([relative[2, 1], relative[0, 2], relative[1, 0]])
    return np.array(moments), np.array(turns)


def test_moments_axes_and_ratios_of_a_known_body_are_recovered() -> None:
    body = body_estimate(belief(0))
    np.testing.assert_allclose(body.principal_moments, MOMENTS, rtol=1e-12)
    np.testing.assert_allclose(np.abs(np.sum(body.principal_axes_g * AXES, axis=1)), 1.0, rtol=1e-12)
    assert np.linalg.det(body.principal_axes_g) == pytest.approx(1.0)
    assert (body.k1, body.k2) == pytest.approx((np.log(1 / 0.85), np.log(0.85 / 0.6)))


def test_standard_deviations_of_moments_and_ratios_are_those_of_samples() -> None:
    moments, _ = eigen_of_samples(1)
    body = body_estimate(belief(1))
    np.testing.assert_allclose(body.principal_moments_std[:2], moments.std(axis=0)[:2], rtol=SAMPLING)
    assert body.k1_std == pytest.approx(np.log(moments[:, 2] / moments[:, 1]).std(), rel=SAMPLING)
    assert body.k2_std == pytest.approx(np.log(moments[:, 1] / moments[:, 0]).std(), rel=SAMPLING)
    correlation = body.principal_moments_cov[0, 1] / np.prod(body.principal_moments_std[:2])
    assert correlation == pytest.approx(np.corrcoef(moments[:, :2].T)[0, 1], abs=0.06)


def test_covariance_of_the_principal_axes_is_that_of_samples() -> None:
    _, turns = eigen_of_samples(1)
    body = body_estimate(belief(1))
    np.testing.assert_allclose(body.principal_axes_std, turns.std(axis=0), rtol=1.5 * SAMPLING)
    normalised = body.principal_axes_cov / np.outer(body.principal_axes_std, body.principal_axes_std)
    np.testing.assert_allclose(normalised, np.corrcoef(turns.T), atol=0.07)


def test_the_scale_is_a_choice_so_that_the_largest_moment_is_certain() -> None:
    body = body_estimate(belief(3))
    assert body.principal_moments[2] == 1.0
    assert body.principal_moments_std[2] == 0.0


def test_axes_of_a_sphere_are_undetermined_and_everything_stays_finite() -> None:
    sphere = Gaussian(FULL, FULL.origin(), 0.01 * np.eye(FULL.error_dim))
    body = body_estimate(sphere)
    np.testing.assert_allclose(body.principal_axes_std, UNDETERMINED_STD)
    np.testing.assert_allclose(body.principal_moments, 1.0)
    numbers = [body.principal_moments_cov, body.principal_axes_cov, body.principal_axes_g]
    assert all(np.isfinite(array).all() for array in numbers)
    assert 0 < body.k1_std < 1


def test_a_symmetric_body_has_one_axis_that_is_determined() -> None:
    x = FULL.origin()
    x[FULL.mean_slice("s")] = [0.4, -0.2, 0.0, 0.0, 0.0]
    body = body_estimate(Gaussian(FULL, x, 1e-4 * np.eye(FULL.error_dim)))
    std = body.principal_axes_std
    assert std[2] < 1e-2 or std[0] < 1e-2
    assert std.max() == pytest.approx(UNDETERMINED_STD)


def test_a_history_holds_the_body_of_every_belief() -> None:
    beliefs = [belief(seed) for seed in range(4)]
    history = history_of(np.array([b.mean for b in beliefs]), np.array([b.factor for b in beliefs]))
    bodies = body_history(history)
    for index, single in enumerate(map(body_estimate, beliefs)):
        np.testing.assert_allclose(bodies.at(index).principal_moments_std, single.principal_moments_std)
        np.testing.assert_allclose(bodies.at(index).principal_axes_g, single.principal_axes_g)
        assert bodies.at(index).k2_std == pytest.approx(single.k2_std)


def test_centre_of_mass_and_drag_are_given_where_the_state_has_them() -> None:
    layout = StateLayout(("a", "w", "s", "d"))
    factor = np.diag(np.linspace(0.1, 0.2, layout.error_dim))
    x = sample_point(np.random.default_rng(5), layout)
    rotating = body_estimate(Gaussian(layout, x, factor))
    assert rotating.center_of_mass_g is None
    assert (rotating.drag, rotating.drag_std) == pytest.approx((x[-1], 0.2))
    full = body_estimate(belief(6))
    assert full.drag is None
    assert full.center_of_mass_std is not None
    np.testing.assert_allclose(full.center_of_mass_std, belief(6).std[FULL.slice("c")])


def test_moments_of_a_needle_beyond_rounding_are_positive() -> None:
    layout = StateLayout(ROTATION_BLOCKS)
    for turn in range(20):
        mean = layout.origin()
        s = np.array([20.0, -10.0, 3.0 * turn, 1.0, -2.0]) if turn else np.array([25.0, -12.0, 0.0, 0.0, 0.0])
        mean[layout.mean_slice("s")] = s
        body = body_estimate(Gaussian(layout, mean, 1e-3 * np.eye(layout.error_dim)))
        assert (body.principal_moments > 0).all()
        assert np.isfinite([body.k1, body.k2]).all()
