"""Linear stability of the principal axes against the rule of the intermediate axis and the exact motion."""

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.core.rolling_motion import Stability, axis_stability
from spinfilters.core.torque_free import torque_free_motion

MOMENTS = np.array([3.0, 2.0, 1.5])


@pytest.mark.parametrize("order", [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]])
@pytest.mark.parametrize("spin_rate", [0.5, -0.5])
def test_only_the_intermediate_axis_is_unstable(order: list[int], spin_rate: float) -> None:
    for result in axis_stability(MOMENTS[order], spin_rate):
        intermediate = MOMENTS[order][result.axis] == 2.0
        assert result.stability is (Stability.UNSTABLE if intermediate else Stability.STABLE)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_roots_are_the_eigenvalues_of_the_linearised_equations(axis: int) -> None:
    spin = 0.8 * np.eye(3)[axis]
    columns = [(np.cross(MOMENTS * e, spin) + np.cross(MOMENTS * spin, e)) / MOMENTS for e in np.eye(3)]
    eigenvalues = np.linalg.eigvals(np.stack(columns, axis=-1))
    roots = np.array([*axis_stability(MOMENTS, 0.8)[axis].roots, 0.0])
    assert np.abs(np.sort_complex(eigenvalues) - np.sort_complex(roots)).max() < 1e-12


def test_small_disturbance_of_the_intermediate_spin_grows_at_the_growth_rate() -> None:
    result = axis_stability(MOMENTS, 1.0)[1]
    rates = torque_free_motion(MOMENTS, np.array([1e-9, 1.0, 0.0]), np.array([20.0, 21.0])).rate
    assert np.log(rates[1, 0] / rates[0, 0]) == pytest.approx(result.growth_rate, rel=1e-5)
    assert result.nutation_frequency == 0.0


@pytest.mark.parametrize("axis", [0, 2])
def test_small_disturbance_of_a_stable_spin_returns_after_one_nutation(axis: int) -> None:
    result = axis_stability(MOMENTS, 1.0)[axis]
    start = np.eye(3)[axis] + 1e-6 * np.eye(3)[1]
    period = 2.0 * np.pi / result.nutation_frequency
    rates = torque_free_motion(MOMENTS, start, np.array([0.5 * period, period])).rate
    assert rates[1, 1] == pytest.approx(1e-6, rel=1e-9)
    assert rates[0, 1] == pytest.approx(-1e-6, rel=1e-9)
    assert result.growth_rate == 0.0


def test_axis_of_symmetry_is_stable_and_the_equal_axes_are_neutral() -> None:
    x, y, z = axis_stability(np.array([2.0, 2.0, 1.0]), 1.0)
    assert (x.stability, y.stability, z.stability) == (Stability.NEUTRAL, Stability.NEUTRAL, Stability.STABLE)
    assert x.roots == (0j, 0j)
    assert z.nutation_frequency == pytest.approx(0.5, rel=1e-15)


def test_sphere_and_body_at_rest_are_neutral() -> None:
    results = (*axis_stability(np.ones(3), 1.0), *axis_stability(MOMENTS, 0.0))
    assert {result.stability for result in results} == {Stability.NEUTRAL}


def test_impossible_moments_and_rates_are_refused() -> None:
    with pytest.raises(InputError, match="triangle"):
        axis_stability(np.array([3.0, 1.0, 1.0 / 3.0]), 1.0)
    with pytest.raises(InputError, match="spin_rate"):
        axis_stability(MOMENTS, float("nan"))
