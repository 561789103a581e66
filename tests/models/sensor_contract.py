"""The contract that every sensor keeps: a new sensor's test is one call of `check_sensor_contract`."""

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.models.measurement import FEWEST_PAIRS, MeasurementModel

STEP = 1e-6
"""Of central differences, m, rad, m/s, rad/s: truncation and rounding meet near 1e-9 of a unit's derivative."""
DERIVATIVE_TOLERANCE = 2e-7
ROUNDING = 1e-9


def check_sensor_contract(
    model: MeasurementModel, x: Float[np.ndarray, " m"], parameters: Float[np.ndarray, "k p"]
) -> None:
    """Everything that filters, smoother and starts rely on, at a point where every value is valid."""
    generator = np.random.default_rng(7)
    nearby = model.layout.retract(x, 0.02 * generator.standard_normal(model.layout.error_dim))
    exact, measured = model.predict(x, parameters), model.predict(nearby, parameters)
    _check_shapes(model, x, parameters, measured)
    _check_exact_measurement(model, x, parameters, exact)
    _check_noise(model, x, parameters, measured)
    for values in (exact, measured):
        _check_jacobian(model, x, parameters, values)
    _check_batch_is_loop(model, x, parameters, measured)
    _check_many_points(model, np.stack([x, nearby]), parameters, measured)
    _check_not_finite_values_stay_alone(model, x, parameters, measured)


def _check_shapes(
    model: MeasurementModel, x: np.ndarray, parameters: np.ndarray, measured: np.ndarray
) -> None:
    k, columns = len(parameters), len(model.columns)
    assert set(model.needs) <= set(model.layout.blocks)
    assert measured.shape == (k, model.value_dim)
    innovation, jacobian, valid, log_noise = model.linearise(x, parameters, measured)
    assert innovation.shape == (k, model.dim)
    assert jacobian.shape == (k, model.dim, columns)
    assert valid.shape == log_noise.shape == (k,)
    assert valid.dtype == bool
    assert model.whitening(x, parameters).shape == (k, model.dim, model.dim)


def _check_exact_measurement(
    model: MeasurementModel, x: np.ndarray, parameters: np.ndarray, exact: np.ndarray
) -> None:
    innovation, valid = model.innovations(x, parameters, exact)
    assert valid.all(), "the contract is checked where the sensor applies"
    np.testing.assert_allclose(innovation, 0.0, atol=ROUNDING)
    np.testing.assert_allclose(model.linearise(x, parameters, exact).innovation, 0.0, atol=1e-6)


def _check_noise(
    model: MeasurementModel, x: np.ndarray, parameters: np.ndarray, measured: np.ndarray
) -> None:
    whitening, log_noise = model.whitening(x, parameters), model.linearise(x, parameters, measured).log_noise
    for row, W, log_determinant in zip(parameters, whitening, log_noise, strict=True):
        factor = np.asarray(ca.DM(model.noise_factor(model.layout.unpack(ca.DM(x)), ca.DM(row))))
        np.testing.assert_allclose(factor, np.tril(factor), err_msg="the noise factor is lower triangular")
        np.testing.assert_allclose(W @ factor, np.eye(model.dim), atol=ROUNDING)
        assert np.isclose(log_determinant, np.linalg.slogdet(factor)[1])


def _check_jacobian(
    model: MeasurementModel, x: np.ndarray, parameters: np.ndarray, values: np.ndarray
) -> None:
    """Against central differences of the innovation along every error component, those it does not need included."""
    n = model.layout.error_dim
    innovation, jacobian, *_ = model.linearise(x, parameters, values)
    whitening = model.whitening(x, parameters)
    np.testing.assert_allclose(innovation, _whitened(model, whitening, x, parameters, values), atol=1e-6)
    full = np.zeros((len(parameters), model.dim, n))
    full[..., model.columns] = jacobian
    for component, direction in enumerate(STEP * np.eye(n)):
        ahead = _whitened(model, whitening, model.layout.retract(x, direction), parameters, values)
        behind = _whitened(model, whitening, model.layout.retract(x, -direction), parameters, values)
        scale = max(1.0, float(np.abs(full).max()))
        np.testing.assert_allclose(
            full[..., component] / scale,
            -(ahead - behind) / (2 * STEP) / scale,
            atol=DERIVATIVE_TOLERANCE,
            err_msg=f"derivative of {model.name} with respect to error component {component}",
        )


def _whitened(
    model: MeasurementModel, whitening: np.ndarray, x: np.ndarray, parameters: np.ndarray, values: np.ndarray
) -> np.ndarray:
    return np.einsum("kij,kj->ki", whitening, model.innovations(x, parameters, values)[0])


def _check_batch_is_loop(
    model: MeasurementModel, x: np.ndarray, parameters: np.ndarray, measured: np.ndarray
) -> None:
    together = model.linearise(x, parameters, measured)
    for k in range(len(parameters)):
        alone = model.linearise(x, parameters[k : k + 1], measured[k : k + 1])
        for whole, part in zip(together, alone, strict=True):
            np.testing.assert_array_equal(whole[k], part[0])


def _check_many_points(
    model: MeasurementModel, points: np.ndarray, parameters: np.ndarray, measured: np.ndarray
) -> None:
    """`innovations_at`, a UKF's view, is `innovations` at each point whitened at one."""
    innovation, valid, log_noise = model.innovations_at(points, points[0], parameters, measured)
    whitening = model.whitening(points[0], parameters)
    assert innovation.shape == (len(parameters), model.dim, len(points))
    for k, point in enumerate(points):
        expected = _whitened(model, whitening, point, parameters, measured)
        np.testing.assert_allclose(innovation[..., k], expected, rtol=1e-12, atol=ROUNDING)
    assert valid.all()
    np.testing.assert_allclose(log_noise, model.linearise(points[0], parameters, measured).log_noise)
    # so many that compiled code takes them side by side
    times = -(-FEWEST_PAIRS // (len(points) * len(parameters)))
    repeated = np.tile(parameters, (times, 1)), np.tile(measured, (times, 1))
    many = model.innovations_at(points, points[0], *repeated)
    np.testing.assert_allclose(many.innovation[-len(parameters) :], innovation, rtol=1e-12, atol=ROUNDING)
    np.testing.assert_allclose(many.log_noise[-len(parameters) :], log_noise, rtol=1e-12, atol=ROUNDING)
    assert many.valid.all()


def _check_not_finite_values_stay_alone(
    model: MeasurementModel, x: np.ndarray, parameters: np.ndarray, measured: np.ndarray
) -> None:
    damaged = measured.copy()
    damaged[0] = np.nan
    innovation = model.linearise(x, parameters, damaged).innovation
    assert not np.isfinite(innovation[0]).any()
    assert np.isfinite(innovation[1:]).all()
