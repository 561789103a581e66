"""Robust losses: each weight is its cost's derivative, and nothing pulls from infinity."""

from collections.abc import Callable

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.core.robust_losses import (
    LOSS_NAMES,
    Barron,
    Gate,
    Graduated,
    Huber,
    LeastSquares,
    PseudoHuber,
    RobustLoss,
    build_loss,
)

LOSSES: tuple[RobustLoss, ...] = (
    LeastSquares(),
    Huber(),
    Huber(0.7),
    PseudoHuber(),
    PseudoHuber(5.0),
    Barron(2.0),
    Barron(1.0),
    Barron(0.0),
    Barron(-2.0, 3.0),
    Barron(1e-9),
    Graduated(),
    Graduated().at_stage(3),
    Graduated().at_stage(7),
    Graduated().at_stage(100),
    Gate(2.0, 6.0),
    Gate(5.0, 5.0),
    *(build_loss(name, 2.5, -1.0) for name in LOSS_NAMES),
)
SIZES = np.array([1e-2, 0.3, 0.65, 1.1, 1.7, 2.6, 4.4, 5.9, 6.3, 30.0, 1e3])
"""Lengths of residuals off the corners of the losses."""


@pytest.mark.parametrize("loss", LOSSES, ids=str)
def test_the_weight_is_the_derivative_of_the_cost(loss: RobustLoss) -> None:
    square, step = SIZES**2, 1e-5 * SIZES**2
    slope = (loss.cost(square + step) - loss.cost(square - step)) / (2 * step)
    np.testing.assert_allclose(loss.weight(square), slope, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("loss", LOSSES, ids=str)
def test_a_residual_of_zero_costs_nothing_and_has_its_full_weight(loss: RobustLoss) -> None:
    np.testing.assert_array_equal(loss.cost(np.zeros(2)), 0.0)
    np.testing.assert_array_equal(loss.weight(np.zeros(2)), 1.0)


@pytest.mark.parametrize("loss", LOSSES, ids=str)
def test_what_is_infinitely_far_has_no_weight(loss: RobustLoss) -> None:
    far = np.array([np.inf, 1.0])
    weight, cost = loss.weight(far), loss.cost(far)
    assert weight[0] == 0.0
    assert weight[1] > 0.0
    assert not np.isnan(cost).any()


@pytest.mark.parametrize("loss", LOSSES, ids=str)
def test_costs_grow_and_weights_fall_with_the_residual(loss: RobustLoss) -> None:
    square = np.logspace(-8, 12, 200)
    assert (np.diff(loss.cost(square)) >= 0).all()
    assert (np.diff(loss.weight(square)) <= 0).all()


def test_barrons_family_holds_the_kernels_that_have_names() -> None:
    square = SIZES**2
    np.testing.assert_allclose(Barron(1.0, 3.0).cost(square), PseudoHuber(3.0).cost(square), rtol=1e-6)
    np.testing.assert_allclose(Barron(2.0).cost(square), square, rtol=1e-14)
    np.testing.assert_allclose(Barron(1e-9).cost(square), Barron(0.0).cost(square), rtol=1e-6)
    np.testing.assert_allclose(Barron(-2.0, 3.0).weight(square), (1 + square / 36) ** -2, rtol=1e-12)


def test_a_gate_counts_only_those_it_is_told_to_count() -> None:
    gate = Gate(5.0, 5.0, np.array([True, False]))
    np.testing.assert_array_equal(gate.weight(np.ones(2)), [1.0, 0.0])
    np.testing.assert_array_equal(gate.cost(np.ones(2)), [1.0, 0.0])


def test_a_graduated_kernel_narrows_until_it_is_what_it_says() -> None:
    loss, square = Graduated(3.0, 1e4, 4.0), np.array([100.0])
    weights = [float(loss.at_stage(k).weight(square)[0]) for k in range(loss.stages + 3)]
    assert weights[0] > 0.99
    assert (np.diff(weights[: loss.stages + 1]) < 0).all()
    np.testing.assert_array_equal(weights[loss.stages :], weights[-1])
    assert weights[-1] == pytest.approx((9 / 109) ** 2)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Huber(0.0),
        lambda: Huber(np.nan),
        lambda: PseudoHuber(-1.0),
        lambda: Barron(0.0, 0.0),
        lambda: Barron(2.5),
        lambda: Barron(-np.inf),
        lambda: Graduated(0.0),
        lambda: Graduated(first=1.0),
        lambda: Graduated(rate=0.9),
        lambda: Graduated(rate=np.inf),
    ],
)
def test_a_parameter_without_a_meaning_is_refused(make: Callable[[], RobustLoss]) -> None:
    with pytest.raises(InputError, match="give a"):
        make()
