"""The closed form of torque-free motion against 38-digit integration, and against its own laws."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import Float
from scipy.spatial.transform import Rotation
from scipy.special import ellipj, ellipk

from spinfilters.core.errors import InputError, ShapeError
from spinfilters.core.polhode import (
    EllipticModulus,
    angular_momentum,
    argument_of,
    jacobi_functions,
    rotational_energy,
)
from spinfilters.core.torque_free import TorqueFreeMotion, polhode_period, torque_free_motion
from tests.core.reference_motions import ATTITUDE0, BODIES, integrated, kept, times_of
from tests.core.taylor_reference import ReferenceMotion, reference_motion

MAIN_BAR = 1e-12
"""Ten times below the accuracy asked for (1e-11 of |w| and rad over 100 revolutions)."""


def worst_errors(
    moments: list[float], rate: list[float], revolutions: float, bits: int
) -> tuple[float, float]:
    """Largest error of the rate relative to |w| and of the attitude in rad."""
    J, w, time = np.array(moments), np.array(rate), times_of(rate, revolutions)
    motion = torque_free_motion(J, w, time, ATTITUDE0)
    return differences(motion, reference_motion(J, w, time, ATTITUDE0, bits), rate)


def differences(
    motion: TorqueFreeMotion, reference: ReferenceMotion, rate: list[float]
) -> tuple[float, float]:
    """The same of a motion and its reference."""
    rate_error = np.abs(motion.rate - reference.rate).max() / float(np.linalg.norm(rate))
    return float(rate_error), float(2.0 * np.abs(motion.attitude - reference.attitude).max())


@pytest.mark.parametrize("name", BODIES)
def test_motion_agrees_with_38_digit_integration_over_100_revolutions(name: str) -> None:
    moments, rate = BODIES[name]
    motion = torque_free_motion(np.array(moments), np.array(rate), times_of(rate), ATTITUDE0)
    rate_error, attitude_error = differences(motion, kept(name), rate)
    assert rate_error < MAIN_BAR
    assert attitude_error < MAIN_BAR


@pytest.mark.parametrize("name", BODIES)
def test_the_kept_motions_are_those_of_the_integration(name: str) -> None:
    whole, begin = kept(name), integrated(name, 2)
    assert len(whole.rate) == len(times_of(BODIES[name][1]))
    np.testing.assert_array_equal(whole.rate[:2], begin.rate)
    np.testing.assert_array_equal(whole.attitude[:2], begin.attitude)


@pytest.mark.parametrize("rate", [[1.0, 0.3, 3.0], [-1.0, 0.3, 3.0], [-1.0, -0.3, -3.0]])
def test_motion_on_the_exact_separatrix_agrees_with_integration_of_60_digits(rate: list[float]) -> None:
    # 9 (9 - 5) 1^2 = 4 (5 - 4) 3^2, so h^2 = 2 T J2 in doubles; integration errors grow as exp(w2 t / 3).
    rate_error, attitude_error = worst_errors([9.0, 5.0, 4.0], rate, revolutions=20, bits=200)
    assert rate_error < MAIN_BAR
    assert attitude_error < MAIN_BAR


def test_motion_within_1e_13_of_the_separatrix_is_as_accurate_as_elsewhere() -> None:
    rate_error, attitude_error = worst_errors([3.0, 2.0, 1.5], [0.0, 1.0, 1e-13], revolutions=40, bits=190)
    assert rate_error < MAIN_BAR
    assert attitude_error < MAIN_BAR


def test_error_near_the_separatrix_is_far_below_what_one_rounding_of_the_input_causes() -> None:
    J, w, time = np.array([9.0, 5.0, 4.0]), np.array([1.0, 0.3, 3.0 + 3e-12]), np.linspace(0.0, 120.0, 40)
    motion = torque_free_motion(J, w, time)
    moved = torque_free_motion(J, w * np.array([1.0 + 1e-15, 1.0, 1.0]), time)
    reference = reference_motion(J, w, time, np.array([0.0, 0.0, 0.0, 1.0]), bits=190)
    assert np.abs(moved.rate - motion.rate).max() > 1e-5
    assert np.abs(motion.rate - reference.rate).max() < MAIN_BAR
    assert np.abs(motion.attitude - reference.attitude).max() < MAIN_BAR


moment_spread = st.floats(1e-3, 1.0)
component = st.one_of(st.floats(-1.0, 1.0), st.floats(-1e-8, 1e-8), st.just(0.0))


@st.composite
def bodies(draw: st.DrawFn) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """A physical body, often almost symmetric, and a rate of 1 rad/s."""
    second = np.array([draw(moment_spread) for _ in range(3)])
    if draw(st.booleans()):
        second = second[0] * (1.0 + second * 10.0 ** -draw(st.integers(1, 16)))
    rate = np.array([draw(component) for _ in range(3)])
    rate[draw(st.integers(0, 2))] += draw(st.sampled_from([-1.0, 1.0]))
    speed = float(np.linalg.norm(rate))
    return np.sum(second) - second, rate / speed if speed > 0.1 else np.array([0.6, 0.0, 0.8])


@settings(max_examples=25, deadline=None, derandomize=True)
@given(bodies())
def test_any_body_agrees_with_integration(body: tuple[np.ndarray, np.ndarray]) -> None:
    moments, rate = body
    rate_error, attitude_error = worst_errors(moments.tolist(), rate.tolist(), revolutions=1.5, bits=110)
    assert rate_error < 1e-13
    assert attitude_error < 1e-13


@settings(max_examples=200, deadline=None, derandomize=True)
@given(bodies())
def test_energy_and_inertial_momentum_are_conserved(body: tuple[np.ndarray, np.ndarray]) -> None:
    moments, rate = body
    motion = torque_free_motion(moments, rate, np.linspace(-300.0, 300.0, 50), ATTITUDE0)
    momentum = angular_momentum(moments, motion.rate)
    inertial = Rotation.from_quat(motion.attitude).apply(momentum)
    size, energy = np.linalg.norm(moments * rate), rotational_energy(moments, rate)
    assert np.abs(rotational_energy(moments, motion.rate) / energy - 1.0).max() < 2e-14
    assert np.abs(np.linalg.norm(momentum, axis=-1) / size - 1.0).max() < 2e-14
    assert np.abs(inertial - Rotation.from_quat(ATTITUDE0).apply(moments * rate)).max() < 2e-14 * size
    assert np.abs(np.linalg.norm(motion.attitude, axis=-1) - 1.0).max() < 1e-15


@settings(max_examples=100, deadline=None, derandomize=True)
@given(bodies())
def test_rate_and_attitude_obey_the_equations_of_motion(body: tuple[np.ndarray, np.ndarray]) -> None:
    moments, rate = body
    time, step = np.linspace(-20.0, 20.0, 9), 2e-3
    ahead, here, behind = (torque_free_motion(moments, rate, time + shift) for shift in (step, 0.0, -step))
    acceleration = np.cross(moments * here.rate, here.rate) / moments
    turn = (Rotation.from_quat(behind.attitude).inv() * Rotation.from_quat(ahead.attitude)).as_rotvec()
    assert np.abs((ahead.rate - behind.rate) / (2 * step) - acceleration).max() < 2e-5
    assert np.abs(turn / (2 * step) - here.rate).max() < 2e-5


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("moments", [[3.0, 2.0, 1.5], [2.0, 2.0, 1.0], [1.0, 1.0, 1.0]])
def test_pure_spin_about_a_principal_axis_turns_at_a_constant_rate(moments: list[float], axis: int) -> None:
    rate, time = -0.7 * np.eye(3)[axis], np.array([-500.0, 0.0, 1.0, 800.0])
    motion = torque_free_motion(np.array(moments), rate, time)
    expected = Rotation.from_rotvec(time[:, None] * rate).as_quat()
    assert np.array_equal(motion.rate, np.tile(rate, (4, 1)))
    assert np.abs(np.abs(np.sum(expected * motion.attitude, axis=-1)) - 1.0).max() < 1e-15


def test_sphere_keeps_any_rate_and_turns_about_it() -> None:
    rate = np.array([0.1, -0.2, 0.3])
    motion = torque_free_motion(np.full(3, 0.4), rate, np.array(2.0), ATTITUDE0)
    expected = Rotation.from_quat(ATTITUDE0) * Rotation.from_rotvec(2.0 * rate)
    assert np.array_equal(motion.rate, rate)
    assert (expected.inv() * Rotation.from_quat(motion.attitude)).magnitude() < 1e-15


def test_body_at_rest_keeps_its_attitude() -> None:
    motion = torque_free_motion(np.array([3.0, 2.0, 1.5]), np.zeros(3), np.array([0.0, 1e9]), ATTITUDE0)
    assert np.array_equal(motion.rate, np.zeros((2, 3)))
    assert np.abs(motion.attitude - ATTITUDE0).max() < 1e-16


def test_motion_backwards_from_a_later_state_returns_to_the_start() -> None:
    J, w = np.array([1.5, 3.0, 2.0]), np.array([0.3, -0.5, 0.4])
    later = torque_free_motion(J, w, np.array(40.0), ATTITUDE0)
    back = torque_free_motion(J, later.rate, np.array(-40.0), later.attitude)
    assert np.abs(back.rate - w).max() < 2e-14
    assert np.abs(back.attitude - ATTITUDE0).max() < 2e-14


def test_scale_of_moments_and_of_time_does_not_matter() -> None:
    J, w, time = np.array([3.0, 2.0, 1.5]), np.array([0.3, 0.5, 0.4]), np.linspace(0.0, 50.0, 7)
    motion = torque_free_motion(J, w, time)
    for size in (1e-200, 1e200):
        scaled = torque_free_motion(J * size, w / size, time * size)
        assert np.abs(scaled.attitude - motion.attitude).max() < 1e-12


def test_time_of_any_shape_gives_states_of_that_shape() -> None:
    J, w = np.array([3.0, 2.0, 1.5]), np.array([0.3, 0.5, 0.4])
    for shape in ((), (0,), (4,), (2, 3)):
        motion: TorqueFreeMotion = torque_free_motion(J, w, np.zeros(shape))
        assert motion.rate.shape == (*shape, 3)
        assert motion.attitude.shape == (*shape, 4)
        assert np.abs(motion.rate - w).max(initial=0.0) < 1e-15


@pytest.mark.parametrize("rate", [[0.3, 0.5, 0.4], [0.9, 0.2, 0.1]])
def test_rate_returns_after_the_polhode_period_and_not_before(rate: list[float]) -> None:
    J, w = np.array([3.0, 2.0, 1.5]), np.array(rate)
    period = polhode_period(J, w)
    motion = torque_free_motion(J, w, np.array([0.5 * period, period]))
    assert np.abs(motion.rate[1] - w).max() < 1e-14
    assert np.abs(motion.rate[0] - w).max() > 0.1


def test_polhode_period_of_a_symmetric_body_is_the_nutation_period() -> None:
    period = polhode_period(np.array([2.0, 2.0, 1.0]), np.array([0.3, 0.4, 0.5]))
    assert period == pytest.approx(2.0 * np.pi / (0.5 * 0.5), rel=1e-15)


def test_polhode_period_is_infinite_where_the_rate_never_returns_or_never_moves() -> None:
    assert math.isinf(polhode_period(np.array([9.0, 5.0, 4.0]), np.array([1.0, 0.3, 3.0])))
    assert math.isinf(polhode_period(np.array([3.0, 2.0, 1.5]), np.array([0.0, 1.0, 0.0])))


@pytest.mark.parametrize("parameter", [0.0, 1e-12, 0.2, 0.5, 0.5000001, 0.8, 0.99])
def test_elliptic_functions_agree_with_scipy_where_scipy_is_accurate(parameter: float) -> None:
    modulus, u = EllipticModulus(parameter, 1.0 - parameter), np.linspace(-9.0, 9.0, 181)
    for ours, theirs in zip(jacobi_functions(u, modulus), ellipj(u, parameter)[:3], strict=True):
        assert np.abs(ours - theirs).max() < 2e-14
    assert modulus.quarter_period == pytest.approx(float(ellipk(parameter)), rel=1e-15)


def test_elliptic_functions_meet_at_the_switch_of_series() -> None:
    u = np.linspace(-30.0, 30.0, 301)
    below = jacobi_functions(u, EllipticModulus(0.5, 0.5))
    above = jacobi_functions(u, EllipticModulus(0.5 + 2e-16, 0.5))
    for low, high in zip(below, above, strict=True):
        assert np.abs(low - high).max() < 3e-14


def test_elliptic_functions_at_m1_zero_are_hyperbolic() -> None:
    u = np.array([-800.0, -3.0, -1e-9, 0.0, 0.7, 900.0])
    sn, cn, dn = jacobi_functions(u, EllipticModulus(1.0, 0.0))
    sech = 2.0 * np.exp(-np.abs(u)) / (1.0 + np.exp(-2.0 * np.abs(u)))
    assert np.abs(sn - np.tanh(u)).max() < 1e-15
    assert np.abs(cn - sech).max() < 1e-15
    assert np.abs(dn - sech).max() < 1e-15


@pytest.mark.parametrize("complement", [1.0, 0.6, 1e-3, 1e-20])
def test_argument_of_inverts_the_elliptic_functions(complement: float) -> None:
    modulus = EllipticModulus(1.0 - complement, complement)
    for u in (-0.999 * modulus.quarter_period, -0.1, 0.0, 0.5 * modulus.quarter_period):
        sn, cn, _ = jacobi_functions(np.array([u]), modulus)
        assert argument_of(float(sn[0]), float(cn[0]), modulus) == pytest.approx(u, abs=2e-14)


@pytest.mark.parametrize(
    ("moments", "words"),
    [
        ([3.0, 1.0, 1.0 / 3.0], "triangle inequality"),
        ([1.0, -1.0, 1.0], "Jyy = -1"),
        ([1.0, 1.0, 0.0], "Jzz = 0"),
        ([1.0, float("nan"), 1.0], "not finite"),
    ],
)
def test_moments_of_no_rigid_body_are_refused_by_name(moments: list[float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        torque_free_motion(np.array(moments), np.ones(3), np.zeros(1))


def test_thin_plate_is_accepted_in_spite_of_rounding() -> None:
    motion = torque_free_motion(np.array([0.1, 0.2, 0.1 + 0.2]), np.ones(3), np.array([1.0]))
    assert np.all(np.isfinite(motion.attitude))


def test_wrong_shapes_times_and_quaternions_are_refused() -> None:
    J, w, time = np.array([3.0, 2.0, 1.5]), np.ones(3), np.zeros(1)
    with pytest.raises(ShapeError, match=r"rate0 has shape \(2,\)"):
        torque_free_motion(J, w[:2], time)
    with pytest.raises(ShapeError, match="principal_moments"):
        torque_free_motion(np.diag(J), w, time)
    with pytest.raises(InputError, match="time"):
        torque_free_motion(J, w, np.array([np.inf]))
    with pytest.raises(InputError, match="norm 2"):
        torque_free_motion(J, w, time, np.array([0.0, 0.0, 0.0, 2.0]))
