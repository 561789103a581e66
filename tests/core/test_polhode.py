"""Polhodes lie on both ellipsoids, carry the motion, and are named after the axis that they go round."""

import numpy as np
import pytest

from spinfilters.core.errors import InputError, ShapeError
from spinfilters.core.polhode import PolhodeKind, ellipsoid_semi_axes, polhode
from spinfilters.core.torque_free import torque_free_motion

MOMENTS = np.array([3.0, 2.0, 1.5])
CASES = [
    ([1.5, 0.8, 0.6], PolhodeKind.ABOUT_MAJOR),
    ([-1.5, 0.8, 0.6], PolhodeKind.ABOUT_MAJOR),
    ([0.2, 0.5, 2.0], PolhodeKind.ABOUT_MINOR),
    ([1e-4, 2.0, 0.0], PolhodeKind.ABOUT_MAJOR),
    ([0.0, 2.0, 1e-4], PolhodeKind.ABOUT_MINOR),
    ([0.0, 2.0, 0.0], PolhodeKind.SEPARATRIX),
    ([1.0, 2.0, 2.0], PolhodeKind.SEPARATRIX),
    ([1.0, 0.0, 0.0], PolhodeKind.POINT),
    ([0.0, 0.0, -1.0], PolhodeKind.POINT),
    ([0.0, 0.0, 0.0], PolhodeKind.POINT),
]


@pytest.mark.parametrize(("rate", "kind"), CASES)
@pytest.mark.parametrize("order", [[0, 1, 2], [2, 1, 0], [1, 2, 0]])
def test_kind_does_not_depend_on_the_order_of_the_axes(
    rate: list[float], kind: PolhodeKind, order: list[int]
) -> None:
    w = np.array(rate)
    assert polhode(MOMENTS[order], w[order]).kind is kind


@pytest.mark.parametrize(("rate", "kind"), CASES)
def test_every_point_of_both_curves_is_on_both_ellipsoids(rate: list[float], kind: PolhodeKind) -> None:
    result = polhode(MOMENTS, np.array(rate))
    if not np.any(rate):
        assert np.all(result.curves == 0.0)
        return
    for semi_axes in (result.momentum_semi_axes, result.energy_semi_axes):
        assert np.abs(np.sum(np.square(result.curves / semi_axes), axis=-1) - 1.0).max() < 1e-13
    assert np.abs(result.curves[:, 0] - result.curves[:, -1]).max() < 1e-13


@pytest.mark.parametrize(
    "rate", [[1.5, 0.8, 0.6], [-1.5, 0.8, 0.6], [0.2, 0.5, 2.0], [0.0, 2.0, 1e-4], [1.0, 0.3, 2.0]]
)
def test_motion_stays_on_one_of_the_curves(rate: list[float]) -> None:
    curves = polhode(MOMENTS, np.array(rate), points=20001).curves
    rates = torque_free_motion(MOMENTS, np.array(rate), np.linspace(0.0, 60.0, 23)).rate
    distances = np.array([[np.linalg.norm(curve - w, axis=-1).min() for curve in curves] for w in rates])
    assert distances.min(axis=-1).max() < 1e-3


@pytest.mark.parametrize(
    ("moments", "rate", "kind"),
    [
        ([2.0, 2.0, 1.0], [0.3, 0.4, 0.5], PolhodeKind.ABOUT_MINOR),
        ([1.0, 1.0, 1.9], [0.3, 0.4, 0.5], PolhodeKind.ABOUT_MAJOR),
        ([2.0, 2.0, 1.0], [0.3, 0.4, 0.0], PolhodeKind.POINT),
        ([1.0, 1.0, 1.0], [0.3, 0.4, 0.5], PolhodeKind.POINT),
    ],
)
def test_equal_moments_give_circles_about_the_axis_of_symmetry_or_points(
    moments: list[float], rate: list[float], kind: PolhodeKind
) -> None:
    result = polhode(np.array(moments), np.array(rate))
    assert result.kind is kind
    assert np.ptp(np.hypot(result.curves[..., 0], result.curves[..., 1])) < 1e-15
    assert np.ptp(np.abs(result.curves[..., 2])) < 1e-15


def test_separatrix_is_recognised_although_rounding_misses_it() -> None:
    # 3 (3 - 2) w_x^2 = 1 (2 - 1) w_z^2 holds for no doubles but zero.
    moments = np.array([3.0, 2.0, 1.0])
    assert polhode(moments, np.array([1.0, 0.5, np.sqrt(3.0)])).kind is PolhodeKind.SEPARATRIX
    assert polhode(moments, np.array([1.0, 0.5, np.sqrt(3.0) - 1e-12])).kind is PolhodeKind.ABOUT_MAJOR
    assert polhode(moments, np.array([1.0, 0.5, np.sqrt(3.0) + 1e-12])).kind is PolhodeKind.ABOUT_MINOR


def test_semi_axes_are_those_of_equations_2_79_and_2_81() -> None:
    momentum, energy = ellipsoid_semi_axes(MOMENTS, np.array([0.0, 2.0, 0.0]))
    assert np.allclose(momentum, [4.0 / 3.0, 2.0, 4.0 / 1.5], rtol=1e-15)
    assert np.allclose(energy, np.sqrt([8.0 / 3.0, 4.0, 8.0 / 1.5]), rtol=1e-15)


def test_body_of_the_figures_of_the_thesis_is_refused() -> None:
    with pytest.raises(InputError, match=r"Jxx = 3 kg m\^2 exceeds the sum 1.33333"):
        polhode(np.array([3.0, 1.0, 1.0 / 3.0]), np.array([0.0, 2.0, 0.0]))


def test_rates_of_wrong_shape_or_not_finite_are_refused() -> None:
    with pytest.raises(ShapeError, match="rate"):
        polhode(MOMENTS, np.zeros((2, 3)))
    with pytest.raises(InputError, match="rate"):
        polhode(MOMENTS, np.array([0.0, np.nan, 1.0]))
