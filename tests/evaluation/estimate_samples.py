"""Truths and estimates whose errors are drawn from their own covariance."""

import numpy as np
from jaxtyping import Float

from spinfilters.core.mass_distribution import from_inertia
from spinfilters.evaluation.consistency import true_states
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.truth import Truth
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.models.status import EstimatorStatus

FULL = StateLayout(FULL_BLOCKS)
MOMENTS = np.array([0.6, 0.85, 1.0])
AXES = np.linalg.qr(np.random.default_rng(7).standard_normal((3, 3)))[0]
AXES = AXES * np.sign(np.linalg.det(AXES))
"""Principal moments and axes (rows, in g) of the body of every sample."""


def sample_truth(generator: np.random.Generator, count: int) -> Truth:
    """Random motion, each row on its own, of a known body; times are seconds from 0."""
    q = generator.standard_normal((count, 4))
    return Truth(
        time=np.arange(count, dtype=float),
        center_of_mass=generator.standard_normal((count, 3)),
        q_ig=q / np.linalg.norm(q, axis=1, keepdims=True),
        velocity=generator.standard_normal((count, 3)),
        rate_i=generator.standard_normal((count, 3)),
        principal_moments=MOMENTS,
        principal_axes_g=AXES,
        center_of_mass_g=np.array([0.3, -0.2, 0.4]),
    )


def sample_point(generator: np.random.Generator, layout: StateLayout = FULL) -> Float[np.ndarray, " m"]:
    """A random point of a layout with the body of `MOMENTS` and `AXES`."""
    x = generator.standard_normal(layout.mean_dim)
    q = x[layout.mean_slice("a")]
    x[layout.mean_slice("a")] = q / np.linalg.norm(q)
    x[layout.mean_slice("s")] = from_inertia(AXES.T @ np.diag(MOMENTS) @ AXES)
    return x


def sample_factor(generator: np.random.Generator, size: int, scale: float) -> Float[np.ndarray, "n n"]:
    """A full (correlated) covariance factor with standard deviations about ``scale``."""
    return scale * generator.standard_normal((size, size)) / np.sqrt(size)


def history_of(
    mean: Float[np.ndarray, "n m"], factor: Float[np.ndarray, "n e e"], layout: StateLayout = FULL
) -> EstimateHistory:
    """A history with these beliefs at 0, 1, 2 .. s, and innovations that are as large as promised."""
    count = len(mean)
    return EstimateHistory(
        name="mekf",
        layout=layout,
        time=np.arange(count, dtype=float),
        mean=mean,
        factor=factor,
        nis=np.full(count, 6.0),
        dof=np.full(count, 6),
        log_likelihood=np.zeros(count),
        accepted=np.full(count, 2),
        rejected=np.zeros(count, dtype=int),
        runtime=np.full(count, 1e-3),
        status=EstimatorStatus(),
    )


def consistent_history(truth: Truth, generator: np.random.Generator, scale: float = 1e-4) -> EstimateHistory:
    """Estimates of a truth whose errors are drawn from their covariance, small enough to be linear."""
    states = true_states(truth, FULL)
    factor = np.array([sample_factor(generator, FULL.error_dim, scale) for _ in states])
    error = np.einsum("nij,nj->ni", factor, generator.standard_normal((len(states), FULL.error_dim)))
    return history_of(FULL.retract(states, -error), factor)
