"""The compiled prediction and update of the EKF compute what their NumPy reference computes."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.filters import ekf as multiplicative_ekf
from spinfilters.filters import filter as multiplicative_filter
from spinfilters.filters.compiled_steps import Update, compiled_propagation, compiled_update
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Measurement
from spinfilters.filters.filter import LinearisedProcess, PredictedMeasurement, propagate_factor
from spinfilters.filters.iterated_update import IterationOptions
from spinfilters.filters.outlier_rejection import RobustOptions
from spinfilters.filters.square_root import covariance_factor, triangular_factor
from spinfilters.models.state_layout import Gaussian
from tests.filters.filter_samples import FULL, PROCESS, embedded

STD = np.repeat([0.005, 0.02, 0.005, 0.02, 0.005, 0.05], [3, 3, 3, 3, 3, 5])
PLAIN = IterationOptions(iterations=1)


@pytest.fixture(autouse=True)
def _compiler() -> None:
    if compiled_propagation(FULL.error_dim) is None:
        pytest.skip("no compiler")


def started(options: RobustOptions, iteration: IterationOptions = PLAIN) -> MultiplicativeEkf:
    generator = np.random.default_rng(3)
    turned = np.linalg.qr(generator.standard_normal((FULL.error_dim,) * 2))[0]
    filtering = MultiplicativeEkf(PROCESS, options, iteration=iteration)
    mean = FULL.retract(embedded(0).truth[0], STD * generator.standard_normal(FULL.error_dim))
    filtering.start(Gaussian(FULL, mean, STD[:, np.newaxis] * turned))
    return filtering


def both(
    monkeypatch: pytest.MonkeyPatch,
    measurement: Measurement,
    options: RobustOptions,
    iteration: IterationOptions = PLAIN,
) -> list[tuple]:
    """Belief and report of the compiled update and of the reference."""
    found = []
    for _ in range(2):
        filtering = started(options, iteration)
        report = filtering.update(measurement)
        found.append((filtering.belief, report))
        monkeypatch.setattr(multiplicative_ekf, "compiled_update", lambda model: None)
    return found


def assert_alike(found: list[tuple]) -> None:
    (compiled, said), (reference, expected) = found
    np.testing.assert_allclose(compiled.mean, reference.mean, rtol=1e-9, atol=1e-12)
    scale = np.outer(reference.std, reference.std)
    np.testing.assert_allclose(compiled.covariance / scale, reference.covariance / scale, atol=1e-9)
    assert (said.dof, said.accepted, said.rejected) == (expected.dof, expected.accepted, expected.rejected)
    np.testing.assert_allclose(
        [said.nis, said.log_likelihood], [expected.nis, expected.log_likelihood], rtol=1e-9
    )


def test_an_update_by_a_known_map(monkeypatch):
    measurement = embedded(0).timeline[0].measurements[0]
    found = both(monkeypatch, measurement, RobustOptions(gate_probability=1.0))
    assert found[0][1].accepted == len(measurement.values)
    assert_alike(found)


def test_values_outside_the_gate_are_left_out(monkeypatch):
    measurement = embedded(0).timeline[0].measurements[0]
    values = measurement.values.copy()
    values[::7] += 300.0
    found = both(monkeypatch, replace(measurement, values=values), RobustOptions())
    assert found[0][1].rejected >= len(values[::7])
    assert_alike(found)


def test_an_update_none_of_whose_values_passes_leaves_the_belief(monkeypatch):
    measurement = embedded(0).timeline[0].measurements[0]
    found = both(monkeypatch, replace(measurement, values=measurement.values + 1e6), RobustOptions())
    assert found[0][1].accepted == 0
    assert_alike(found)


def test_a_value_that_is_not_finite_is_left_out(monkeypatch):
    measurement = embedded(0).timeline[0].measurements[0]
    values = measurement.values.copy()
    values[3, 1] = np.nan
    found = both(monkeypatch, replace(measurement, values=values), RobustOptions(gate_probability=1.0))
    assert found[0][1].rejected == 1
    assert_alike(found)


def test_an_update_far_from_linear_iterates(monkeypatch):
    measurement = embedded(0).timeline[0].measurements[0]
    assert_alike(both(monkeypatch, measurement, RobustOptions(), IterationOptions(tolerance=1e-6)))


def test_noise_of_another_scale():
    measurement = embedded(0).timeline[0].measurements[0]
    compiled, belief = compiled_update(measurement.model), started(RobustOptions()).belief
    assert compiled is not None
    wide = measurement.parameters.copy()
    wide[:, -1] *= 3.0  # the standard deviation of the pixels
    found = compiled(belief.mean, belief.factor, measurement, 9.0, 1e9)
    expected = compiled(belief.mean, belief.factor, replace(measurement, parameters=wide), 1.0, 1e9)
    assert found is not None
    assert expected is not None
    np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-12)
    np.testing.assert_allclose(found.correction.log_likelihood, expected.correction.log_likelihood)


def test_a_prediction(monkeypatch):
    belief = started(RobustOptions()).belief
    step = LinearisedProcess(*PROCESS.linearise(belief.mean, 0.5))
    found = propagate_factor(belief.factor, step, step.noise)
    monkeypatch.setattr(multiplicative_filter, "compiled_propagation", lambda size: None)
    expected = propagate_factor(belief.factor, step, step.noise)
    scale = np.outer(*[np.linalg.norm(expected, axis=1)] * 2)
    np.testing.assert_allclose(found @ found.T / scale, expected @ expected.T / scale, atol=1e-12)
    assert not np.triu(found, 1).any()


class _Hesitant(MultiplicativeEkf):
    """Takes no correction at all."""

    def correct_linearly(self, predicted: PredictedMeasurement) -> Update:
        """The belief as it is, with a correction of nothing."""
        update = super().correct_linearly(predicted)
        return update._replace(mean=self.mean, factor=self.factor)


def test_a_subclass_with_its_own_correction_is_not_bypassed_by_compiled_code():
    filtering = _Hesitant(PROCESS, RobustOptions(gate_probability=1.0), iteration=PLAIN)
    filtering.start(started(RobustOptions()).belief)
    before = filtering.belief
    filtering.update(embedded(0).timeline[0].measurements[0])
    np.testing.assert_array_equal(filtering.belief.mean, before.mean)


@pytest.mark.parametrize("count", [0, 1, 5, 63, 64, 65, 200])
@pytest.mark.parametrize("size", [1, 7, 16, 17, 24, 25, 40, 41, 64, 65])
def test_a_compiled_factor_is_that_of_lapack_with_a_diagonal_that_is_not_negative(
    size: int, count: int
) -> None:
    rows = np.random.default_rng(size).standard_normal((count, size))
    wide = np.zeros((count, 2 * size))
    wide[:, ::2] = rows
    for given in (rows, np.asfortranarray(rows), wide[:, ::2], rows[::-1]):
        L, reference = covariance_factor(given), triangular_factor(rows)
        assert (L.diagonal() >= 0).all()
        assert not np.triu(L, 1).any()
        np.testing.assert_allclose(L @ L.T, reference @ reference.T, rtol=1e-12, atol=1e-12 * max(count, 1))


def test_a_factor_keeps_directions_a_million_times_smaller_than_others() -> None:
    scales = np.logspace(0, -12, 20)
    rows = scales * np.random.default_rng(0).standard_normal((50, 20))
    L, reference = covariance_factor(rows), triangular_factor(rows)
    np.testing.assert_allclose(L, np.where(reference.diagonal() < 0, -reference, reference), rtol=1e-9)


def test_a_factor_of_numbers_that_are_none_is_not_finite() -> None:
    rows = np.eye(20)
    rows[3, 4] = np.nan
    assert np.isnan(covariance_factor(rows)).any()
