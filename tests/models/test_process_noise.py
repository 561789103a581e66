"""The noise covariance Q: against samples of the stochastic equation, and against the linearisation that was published."""

from functools import cache
from typing import cast

import numpy as np
import pytest
from jaxtyping import Float
from scipy.linalg import expm, solve_triangular

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.conventions import RPM
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout
from spinfilters.simulation.scenario import simulate_motion
from tests.models.process_samples import EMBEDDED_MOMENTS, LAYOUTS, embedded_point, random_point

ROTATION, FULL = StateLayout(ROTATION_BLOCKS), StateLayout(FULL_BLOCKS)
NOISE = ProcessNoise()
RATE = np.array([0.5, 10.0, 0.5]) * RPM
SAMPLES = 4000


class _Orthogonal:
    """Normal numbers of bodies whose sampled covariance is exactly the identity: what is linear in them has no chance."""

    def standard_normal(self, shape: tuple[int, ...]) -> np.ndarray:
        """Of shape (..., bodies, 3)."""
        rest = (*shape[:-2], shape[-1])
        drawn = np.random.default_rng(1).standard_normal((SAMPLES, int(np.prod(rest))))
        orthogonal = np.linalg.qr(drawn)[0] * np.sqrt(SAMPLES)
        return np.moveaxis(orthogonal.reshape(SAMPLES, *rest), 0, -2)


@cache
def _sampled_covariance(dt: float) -> Float[np.ndarray, "6 6"]:
    """Covariance of (a, w) after dt, by integrating the stochastic equation for many bodies."""
    process, x = _process(ROTATION), embedded_point(ROTATION, RATE)
    generator = cast(np.random.Generator, _Orthogonal())
    end = simulate_motion(process, np.tile(x, (SAMPLES, 1)), np.array([0.0, dt]), generator)[-1]
    error = ROTATION.local(process.step(x, dt), end)[:, :6]
    return error.T @ error / SAMPLES


@cache
def _process(layout: StateLayout) -> TorqueFreeProcess:
    return TorqueFreeProcess(layout, NOISE)


def _whitened_eigenvalues(Q: np.ndarray, sampled: np.ndarray) -> Float[np.ndarray, " 6"]:
    root = np.linalg.cholesky(Q)
    half = solve_triangular(root, sampled, lower=True)
    return np.linalg.eigvalsh(solve_triangular(root, half.T, lower=True))


def test_the_noise_covariance_is_that_of_the_stochastic_equation() -> None:
    Q = _process(ROTATION).noise_covariance(embedded_point(ROTATION, RATE), 2.0)
    np.testing.assert_allclose(_whitened_eigenvalues(Q[:6, :6], _sampled_covariance(2.0)), 1.0, atol=0.002)


@pytest.mark.parametrize(("dt", "least", "greatest"), [(0.5, 0.61, 1.6), (2.0, 0.2, 4.0)])
def test_the_published_linearisation_gives_another_covariance(
    dt: float, least: float, greatest: float
) -> None:
    Q = _process(ROTATION).noise_covariance(embedded_point(ROTATION, RATE), dt)
    values = _whitened_eigenvalues(_published_covariance(dt), Q[:6, :6])
    assert values[0] < least
    assert values[-1] > greatest


def _published_covariance(dt: float) -> Float[np.ndarray, "6 6"]:
    """Integral of exp(A t) B B' exp(A' t) with A of Tweddle 2013, Eqs 4.80 and 4.107, error on the body side (Van Loan)."""
    J, Z = np.diag(EMBEDDED_MOMENTS), np.zeros((3, 3))
    A = np.block([[-_cross(RATE) / 2, np.eye(3)], [Z, -np.linalg.solve(J, _cross(RATE) @ J)]])
    entry = np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]) * NOISE.torque_psd
    both = expm(dt * np.block([[-A, entry], [np.zeros((6, 6)), A.T]]))
    return both[6:, 6:].T @ both[:6, 6:]


@pytest.mark.parametrize("dt", [0.5, 2.0])
def test_noise_of_place_and_velocity_of_the_centre_of_mass_is_that_of_a_double_integrator(dt: float) -> None:
    x = random_point(FULL, 1.0, np.random.default_rng(11))
    process = _process(FULL)
    Q, after = process.noise_covariance(x, dt), process.step(x, dt)
    t, a, v, w = (FULL.slice(block) for block in ("t", "a", "v", "w"))
    centre = np.zeros((3, FULL.error_dim))
    centre[:, t] = np.eye(3)
    R, c = matrix_from_quaternion(after[FULL.mean_slice("a")]), after[FULL.mean_slice("c")]
    centre[:, a] = -R @ _cross(c)
    eye = NOISE.force_psd * np.eye(3)
    np.testing.assert_allclose(centre @ Q @ centre.T, eye * dt**3 / 3, atol=1e-12 * NOISE.force_psd)
    np.testing.assert_allclose((centre @ Q)[:, v], eye * dt**2 / 2, atol=1e-12 * NOISE.force_psd)
    np.testing.assert_allclose(Q[v, v], eye * dt, atol=1e-12 * NOISE.force_psd)
    np.testing.assert_allclose((centre @ Q)[:, w], 0.0, atol=1e-12 * NOISE.torque_psd)
    np.testing.assert_allclose(Q[v, w], 0.0, atol=1e-12 * NOISE.torque_psd)


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: "".join(layout.blocks))
@pytest.mark.parametrize("dt", [1e-8, 1e-6, 1e-3, 0.1, 1.0, 10.0])
def test_the_noise_covariance_is_positive_semidefinite_at_every_time_step(
    layout: StateLayout, dt: float
) -> None:
    Q = _process(layout).noise_covariance(random_point(layout, 1.0, np.random.default_rng(12)), dt)
    assert np.isfinite(Q).all()
    np.testing.assert_array_equal(Q, Q.T)
    moving = [
        k
        for b in ("t", "a", "v", "w")
        if b in layout.blocks
        for k in range(layout.error_dim)[layout.slice(b)]
    ]
    std = np.sqrt(np.diag(Q)[moving])
    assert (std > 0).all()
    assert np.linalg.eigvalsh(Q[np.ix_(moving, moving)] / np.outer(std, std))[0] > 1e-4
    constant = [k for k in range(layout.error_dim) if k not in moving]
    assert not Q[constant].any()


@pytest.mark.parametrize("dt", [1e-8, 1e-6, 1e-4])
def test_over_a_short_step_attitude_is_the_integral_of_a_random_walk_of_the_rate(dt: float) -> None:
    Q = _process(ROTATION).noise_covariance(random_point(ROTATION, 1.0, np.random.default_rng(13)), dt)
    scale = np.repeat([dt**1.5, dt**0.5], 3) * np.sqrt(NOISE.torque_psd)
    expected = np.kron([[1 / 3, 1 / 2], [1 / 2, 1]], np.eye(3))
    np.testing.assert_allclose(Q[:6, :6] / np.outer(scale, scale), expected, atol=3 * dt + 1e-12)


def test_the_noise_covariance_is_proportional_to_its_densities() -> None:
    x = random_point(FULL, 1.0, np.random.default_rng(14))
    both, force, torque = (
        TorqueFreeProcess(FULL, noise).noise_covariance(x, 0.5)
        for noise in (ProcessNoise(3e-8, 7e-6), ProcessNoise(1e-8, 0.0), ProcessNoise(0.0, 1e-6))
    )
    np.testing.assert_allclose(both, 3 * force + 7 * torque, rtol=1e-9, atol=1e-20)


def _cross(v: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
