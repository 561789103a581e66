"""The stretch move leaves a density unchanged, also a curved one."""

from collections.abc import Callable

import numpy as np
import pytest

from spinfilters.core.posterior_sampling import Ensemble, stretch_step

WALKERS, STEPS, SETTLING = 40, 1500, 200


def samples(log_density: Callable[[np.ndarray], float], dimension: int) -> np.ndarray:
    """Points of an ensemble that began at unit normal ones."""
    generator = np.random.default_rng(5)
    evaluate = lambda x: (log_density(x), None)  # noqa: E731
    points = generator.standard_normal((WALKERS, dimension))
    ensemble = Ensemble(points, np.array([log_density(x) for x in points]), (None,) * WALKERS)
    found = []
    for step in range(STEPS):
        ensemble = stretch_step(ensemble, evaluate, generator)
        if step >= SETTLING:
            found.append(ensemble.points)
    return np.concatenate(found)


def test_an_ill_scaled_gaussian_has_its_moments() -> None:
    L = np.array([[1.0, 0.0, 0.0], [0.9, 1e-2, 0.0], [-0.5, 3e-3, 2e-2]])
    inverse = np.linalg.inv(L)
    found = samples(lambda x: -0.5 * float(np.square(inverse @ x).sum()), 3)
    whitened = found @ inverse.T
    assert np.abs(whitened.mean(axis=0)).max() < 0.1
    assert np.cov(whitened.T) == pytest.approx(np.eye(3), abs=0.1)


def test_a_curved_density_has_its_moments() -> None:
    # x1 is N(0, 1) and x2 given x1 is N(x1^2, 0.2^2)
    found = samples(lambda x: -0.5 * float(x[0] ** 2 + (x[1] - x[0] ** 2) ** 2 / 0.04), 2)
    assert found[:, 0].std() == pytest.approx(1.0, abs=0.1)
    assert found[:, 1].mean() == pytest.approx(1.0, abs=0.15)
    assert (found[:, 1] - found[:, 0] ** 2).std() == pytest.approx(0.2, abs=0.02)


def test_points_without_a_density_are_never_taken() -> None:
    generator = np.random.default_rng(0)
    points = generator.random((8, 1)) + 0.1
    ensemble = Ensemble(points, np.zeros(8), (None,) * 8)
    for _ in range(200):
        ensemble = stretch_step(ensemble, lambda x: (0.0 if x[0] > 0 else -np.inf, None), generator)
    assert (ensemble.points > 0).all()
