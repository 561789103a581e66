"""Histories of many epochs are computed and read by stretches: the same bits as at once, in memory and in a file."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.core import large_arrays
from spinfilters.filters import history as histories
from spinfilters.filters.history import EstimateHistory, GrowingHistory, history_at
from spinfilters.models.state_layout import ROTATION_BLOCKS, Gaussian, StateLayout
from spinfilters.models.state_mixture import ErrorMixture
from spinfilters.models.status import EstimatorStatus

LAYOUT, EPOCHS = StateLayout(ROTATION_BLOCKS), 7


def recorded() -> EstimateHistory:
    """Epochs of random covariances, one of which is not finite."""
    rows, random = GrowingHistory(LAYOUT, 0.0), np.random.default_rng(1)
    for epoch in range(EPOCHS):
        factor = np.tril(random.normal(size=(LAYOUT.error_dim,) * 2))
        factor[0, 0] = np.nan if epoch == 4 else 1.0
        rows.append(float(epoch), Gaussian(LAYOUT, LAYOUT.origin(), factor), [], 1e-3)
    return rows.ended("mekf", EstimatorStatus())


def derived(history: EstimateHistory) -> list[np.ndarray]:
    """Whatever is computed by stretches."""
    random = np.random.default_rng(2)
    widening = np.eye(LAYOUT.error_dim) + 0.1 * random.normal(size=(3, LAYOUT.error_dim, LAYOUT.error_dim))
    errors = random.normal(size=(EPOCHS, LAYOUT.error_dim, 2))
    some = history_at(history, np.array([0, 2, 6]))
    return [history.widened(widening).factor, history.considering(errors).factor, some.factor, some.mean]


@pytest.mark.parametrize("largest_in_memory", [large_arrays.LARGEST_IN_MEMORY, 100])
def test_stretches_give_the_same_bits(largest_in_memory: int, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = derived(recorded())
    monkeypatch.setattr(histories, "RELEASED", 2)
    monkeypatch.setattr(histories, "FEWEST_EPOCHS", 2)
    monkeypatch.setattr(large_arrays, "LARGEST_IN_MEMORY", largest_in_memory)
    for found, at_once in zip(derived(recorded()), wanted, strict=True):
        np.testing.assert_array_equal(found, at_once)


def test_what_a_history_is_widened_by_does_not_hang_on_the_signs_of_its_factors() -> None:
    history = recorded()
    generator = np.random.default_rng(8)
    signs = generator.choice([-1.0, 1.0], (len(history.time), 1, history.factor.shape[2]))
    other = replace(history, factor=history.factor * signs)
    n = history.factor.shape[2]
    widening = np.eye(n) + generator.standard_normal((5, n, n)) / 10
    mixture = ErrorMixture(np.ones(2) / 2, np.eye(n) + generator.standard_normal((2, n, n)) / 10)
    for of in (
        lambda each: each.widened(widening).covariance[np.isfinite(history.factor).all(axis=(1, 2))],
        lambda each: np.array([f @ f.T for f in each.last_mixture(mixture, None).factors]),
    ):
        np.testing.assert_allclose(of(other), of(history), rtol=1e-9, atol=1e-12)
