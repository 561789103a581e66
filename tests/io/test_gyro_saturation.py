"""Clipped gyro samples beside peaks that are flat by chance or by resolution."""

import numpy as np
import pytest

from spinfilters.models.sensors.gyro import saturated


def noisy_spin(seed: int, noise: float) -> np.ndarray:
    """115 samples of a smooth rate (rad/s) with white noise."""
    generator, time = np.random.default_rng(seed), 0.5 * np.arange(115)
    turns = generator.uniform(0.1, 1.0, 3)
    rate = np.sin(turns * time[:, None] + generator.uniform(0, 6, 3))
    return rate + noise * generator.standard_normal(rate.shape)


def test_noise_does_not_clip() -> None:
    found = [saturated(noisy_spin(seed, 10.0 ** -(2 + seed % 3))).any() for seed in range(300)]
    assert sum(found) <= 1


@pytest.mark.parametrize("bits", [6, 8, 12])
def test_a_coarse_resolution_does_not_clip(bits: int) -> None:
    step = 4.36 / 2 ** (bits - 1)
    found = [saturated(step * np.round(noisy_spin(seed, 0.003) / step)).any() for seed in range(100)]
    assert sum(found) <= 1


@pytest.mark.parametrize("bits", [8, 16])
def test_a_clipped_spin_of_any_resolution_is_found(bits: int) -> None:
    limit = 0.7
    step = limit / 2 ** (bits - 1)
    rate = np.clip(step * np.round(noisy_spin(1, 0.003) / step), -limit, limit)
    assert saturated(rate).any()


def test_a_rate_that_is_zero_is_not_clipped() -> None:
    assert not saturated(np.zeros((50, 3))).any()
