"""The symbolic text: kinematics by finite differences, series by mpmath, derivatives where it branches."""

from collections.abc import Callable
from typing import Any, Final

import casadi as ca
import mpmath
import numpy as np
import pytest
from hypothesis import given

from spinfilters.core import attitude_conversions as attitude
from spinfilters.core import attitude_expressions as expressions
from tests.core.attitude_samples import SERIES_SWITCH_ANGLE, quaternions, random_quaternions, vectors

STEP: Final = 1e-3
"""s: the five-point rule's error, step^4 / 30 of the fifth derivative, and its rounding are then tiny."""


def _numbers(expression: Callable[..., ca.DM], *arguments: np.ndarray) -> np.ndarray:
    return expression(*map(ca.DM, arguments)).full().squeeze(-1)


def _rounded(exact: object) -> float:
    return float(str(exact))


def _derivative(of_time: Callable[[float], np.ndarray]) -> np.ndarray:
    a, b, c, d = (of_time(k * STEP) for k in (-2, -1, 1, 2))
    return (a - 8 * b + 8 * c - d) / (12 * STEP)


def _turned(q: np.ndarray, w: np.ndarray, time: float) -> np.ndarray:
    return attitude.multiply(q, attitude.quaternion_from_rotation_vector(w * time))


@given(quaternions(), vectors(3, 2.0))
def test_the_quaternion_rate_is_the_derivative_of_a_body_side_turn(q: np.ndarray, w: np.ndarray) -> None:
    rate = _numbers(expressions.quaternion_rate, q, w)
    np.testing.assert_allclose(rate, _derivative(lambda t: _turned(q, w, t)), atol=1e-10)


@pytest.mark.parametrize("side", [-1e-3, -1e-9, -1e-15, 0.0, 1e-15, 1e-9, 1e-3, 0.5, -0.5])
def test_series_and_closed_form_meet_at_the_switch_to_rounding(side: float) -> None:
    angle = float(SERIES_SWITCH_ANGLE * (1 + side))
    with mpmath.workdps(40):
        half = mpmath.mpf(angle) / 2
        q_exact = np.array([_rounded(mpmath.sin(half)), 0.0, 0.0, _rounded(mpmath.cos(half))])
        r_exact = 2 * mpmath.atan2(mpmath.mpf(q_exact[0]), mpmath.mpf(q_exact[3]))
    q = attitude.quaternion_from_rotation_vector(np.array([angle, 0.0, 0.0]))
    np.testing.assert_allclose(q, q_exact, rtol=2.3e-16, atol=0)
    r = _numbers(expressions.rotation_vector_from_quaternion, q_exact)
    np.testing.assert_allclose(r[0], float(r_exact), rtol=3.4e-16, atol=0)


def _jacobian(expression: Callable[[ca.SX], ca.SX], size: int, at: np.ndarray) -> np.ndarray:
    x = ca.SX.sym("x", size)
    return ca.Function("J", [x], [ca.jacobian(expression(x), x)])(at).full()


def test_derivatives_at_no_rotation_are_those_of_a_small_angle() -> None:
    identity = np.array([0.0, 0.0, 0.0, 1.0])
    J = _jacobian(expressions.quaternion_from_rotation_vector, 3, np.zeros(3))
    np.testing.assert_array_equal(J, np.eye(4, 3) / 2)
    for inverse in (expressions.rotation_vector_from_quaternion, expressions.short_mrp_from_quaternion):
        np.testing.assert_array_equal(_jacobian(inverse, 4, identity)[:, :3], 2 * np.eye(3))


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, float(SERIES_SWITCH_ANGLE), 1.0, np.pi, 5.0, 2 * np.pi])
def test_no_unused_branch_poisons_a_derivative(angle: float) -> None:
    r = angle * np.array([0.0, 0.6, 0.8])
    q = attitude.quaternion_from_rotation_vector(r)
    R = attitude.matrix_from_quaternion(q).flatten("F")
    of_matrix = _jacobian(lambda m: expressions.quaternion_from_matrix(ca.reshape(m, 3, 3)), 9, R)
    for J in (
        _jacobian(expressions.quaternion_from_rotation_vector, 3, r),
        _jacobian(expressions.rotation_vector_from_quaternion, 4, q),
        _jacobian(expressions.short_mrp_from_quaternion, 4, q),
        of_matrix,
    ):
        assert np.all(np.isfinite(J))


def test_second_derivatives_exist_at_no_rotation() -> None:
    r = ca.SX.sym("r", 3)
    scalar = expressions.quaternion_from_rotation_vector(r)[3]
    hessian = ca.Function("H", [r], [ca.hessian(scalar, r)[0]])(np.zeros(3)).full()
    np.testing.assert_allclose(hessian, -np.eye(3) / 4, atol=1e-16)


@pytest.mark.parametrize("kind", [ca.MX, ca.SX])
def test_one_text_serves_every_casadi_type(kind: Any) -> None:
    q, p = random_quaternions(2)
    for expression in (
        expressions.rotation_vector_from_quaternion,
        lambda q: expressions.quaternion_from_matrix(expressions.matrix_from_quaternion(q)),
        lambda q: expressions.quaternion_from_euler321(expressions.rotation_vector_from_quaternion(q)),
        lambda q: expressions.quaternion_from_rotation_vector(expressions.rotation_vector_from_quaternion(q)),
        lambda q: expressions.angle_between(q, ca.DM(p)),
        lambda q: expressions.shadow_mrp(expressions.short_mrp_from_quaternion(q)),
    ):
        x = kind.sym("x", 4)
        value = ca.Function("f", [x], [expression(x)])(q).full()
        np.testing.assert_allclose(value, expression(ca.DM(q)).full(), rtol=1e-14, atol=1e-15)
