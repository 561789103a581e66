"""The gyro's error out of its residuals."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float

from spinfilters.core.mass_distribution import from_inertia
from spinfilters.filters.timeline import SensorNoise
from spinfilters.inference.identified_noise import (
    GyroNoise,
    identify_gyro_noise,
    recorded_gyro_noise,
    white_level,
)
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.models.process import THESIS_NOISE, TorqueFreeProcess
from spinfilters.models.state_blocks import GYRO_BIAS
from spinfilters.models.state_layout import ROTATION_BLOCKS, StateLayout
from spinfilters.settings.run_settings import Settings

COUNT = 4000


def identified(relative_error: Float[np.ndarray, "n 3"]) -> GyroNoise:
    """What is found for a gyro with this error relative to |w|, on a rate that grows from 5 to 25 rad/s."""
    size = np.linspace(5.0, 25.0, len(relative_error))[:, np.newaxis]
    rate = size * np.array([0.6, 0.0, 0.8])
    return identify_gyro_noise(size * relative_error, rate)


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


@pytest.mark.parametrize("bias", [np.zeros(3), np.array([0.02, -0.015, 0.01])])
def test_a_bias_of_the_state_is_no_noise(bias: Float[np.ndarray, " 3"]) -> None:
    layout = StateLayout(ROTATION_BLOCKS).joined(GYRO_BIAS)
    process = TorqueFreeProcess(layout, THESIS_NOISE)
    time = 0.1 * np.arange(150)
    rates = np.empty((len(time), 3))
    state = layout.origin()
    state[layout.mean_slice("w")] = [0.4, 1.0, 0.6]
    state[layout.mean_slice("s")] = from_inertia(np.diag([1.6, 1.25, 1.0]))
    for k in range(len(time)):
        rates[k] = state[layout.mean_slice("w")]
        state = process.step(state, 0.1)
    noise = 0.002 * np.random.default_rng(2).standard_normal(rates.shape)
    gyro = MeasurementStream("gyro", time, rates + bias + noise)
    settings = replace(Settings().initialisation, gyro_bias_std=0.03)
    found, _ = recorded_gyro_noise(gyro, process, SensorNoise({}), settings)
    assert found.is_white
    assert white_level(gyro, found)["gyro_noise_std"] == pytest.approx(0.002, rel=0.1)
