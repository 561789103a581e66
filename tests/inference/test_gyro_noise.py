"""The gyro's error out of its residuals."""

from dataclasses import dataclass

import numpy as np
import pytest
from jaxtyping import Float

from spinfilters.inference.identified_noise import GyroNoise, identify_gyro_noise
from spinfilters.io.measurement_log import MeasurementStream

COUNT = 4000


@dataclass(frozen=True)
class Layout:
    """A state of nothing but rates."""

    def mean_slice(self, _: str) -> slice:
        """Where the rates are."""
        return slice(0, 3)


@dataclass(frozen=True)
class Fitted:
    """What the identification reads of an initial estimate."""

    mean: Float[np.ndarray, "n 3"]
    layout: Layout


def identified(relative_error: Float[np.ndarray, "n 3"]) -> GyroNoise:
    """What is found for a gyro with this error relative to |w|, on a rate that grows from 5 to 25 rad/s."""
    size = np.linspace(5.0, 25.0, len(relative_error))[:, np.newaxis]
    rate = size * np.array([0.6, 0.0, 0.8])
    gyro = MeasurementStream("gyro", 0.01 * np.arange(len(rate)), rate + size * relative_error)
    return identify_gyro_noise(gyro, Fitted(rate, Layout()))  # pyright: ignore[reportArgumentType]


def autoregressive(rho: float, generator: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    """Noise of unit variance with correlation rho from sample to sample."""
    noise = generator.standard_normal((COUNT, 3))
    for k in range(1, COUNT):
        noise[k] = rho * noise[k - 1] + np.sqrt(1 - rho**2) * noise[k]
    return noise


def test_white_noise_has_its_size_and_no_correlation() -> None:
    noise = identified(0.01 * np.random.default_rng(0).standard_normal((COUNT, 3)))
    assert noise.relative_error == pytest.approx(0.01, rel=0.03)
    assert noise.correlation_time == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("rho", [0.5, 0.8, 0.9])
def test_autoregressive_noise_has_the_correlation_time_of_its_formula(rho: float) -> None:
    noise = identified(0.02 * autoregressive(rho, np.random.default_rng(1)))
    expected = (1 + rho) / (1 - rho)
    assert noise.relative_error == pytest.approx(0.02, rel=0.1)
    assert noise.correlation_time == pytest.approx(expected, rel=0.2)
    assert noise.scale_std == pytest.approx(0.02 * np.sqrt(expected), rel=0.2)


def test_a_gyro_without_error_still_gets_some_noise() -> None:
    noise = identified(np.zeros((COUNT, 3)))
    assert noise.correlation_time == 1.0
    assert 0 < noise.scale_std <= 1e-4
