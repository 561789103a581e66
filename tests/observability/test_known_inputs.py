"""Motion under known inputs: against another integrator, finite differences, and what such inputs are to show."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from observability.canonical_motions import motion
from observability.cases import Case, InputSizes
from observability.cramer_rao import EACH_MOMENT, bounded_quantities, cramer_rao_bound
from observability.reference_trajectory import DrivenMotion, KnownInput, SensorSchedule, driven_reference
from observability.system import Input
from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.errors import InputError
from spinfilters.core.mass_distribution import from_inertia
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensors.gyro import Gyro, gyro_parameters
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout

FULL, ROTATION = StateLayout(FULL_BLOCKS), StateLayout(ROTATION_BLOCKS)
MOMENTS = np.array([2.4, 2.0, 1.7])
ACTING = (
    KnownInput(Input.TORQUE_X, 0.2, 9.0),
    KnownInput(Input.TORQUE_Z, -0.1, 5.0),
    KnownInput(Input.INSPECTOR_Y, 0.03, 7.0),
)
STEP = 1e-5


def driven_motion(layout: StateLayout) -> tuple[DrivenMotion, np.ndarray, float]:
    """The motion, a start, and the scale of its inertia."""
    process = TorqueFreeProcess(layout, ProcessNoise(0.0, 0.0), tolerance=1e-12)
    x = layout.retract(layout.origin(), 0.2 * np.random.default_rng(0).standard_normal(layout.error_dim))
    x[layout.mean_slice("s")] = from_inertia(np.diag(MOMENTS))
    second = MOMENTS.sum() / 2 - MOMENTS
    scale = float(np.cbrt(np.prod(second)))
    inputs = ACTING if layout is FULL else ACTING[:2]
    return DrivenMotion(process, inputs, scale), x, scale


def test_a_step_is_that_of_newton_and_euler_in_another_integrator() -> None:
    driven, x, _ = driven_motion(FULL)
    w, v = FULL.mean_slice("w"), FULL.mean_slice("v")
    R, c = matrix_from_quaternion(x[FULL.mean_slice("a")]), x[FULL.mean_slice("c")]

    def rate(time: float, y: np.ndarray) -> np.ndarray:
        spin, turned, speed = y[:3], y[3:12].reshape(3, 3), y[12:15]
        torque = np.array([ACTING[0].at(time), 0.0, ACTING[1].at(time)])
        cross = np.cross(np.eye(3), -spin)
        acceleration = np.array([0.0, -ACTING[2].at(time), 0.0])
        return np.concatenate(
            [
                (torque - np.cross(spin, MOMENTS * spin)) / MOMENTS,
                (turned @ cross.T).ravel(),
                acceleration,
                speed,
            ]
        )

    place = x[FULL.mean_slice("t")] + R @ c
    start = np.concatenate([x[w], R.ravel(), x[v], place])
    there = solve_ivp(rate, (1.3, 3.3), start, rtol=1e-11, atol=1e-12).y[:, -1]
    after = driven.step(x, 1.3, 2.0)
    turned = there[3:12].reshape(3, 3)
    np.testing.assert_allclose(after[w], there[:3], atol=1e-7)
    np.testing.assert_allclose(matrix_from_quaternion(after[FULL.mean_slice("a")]), turned, atol=1e-6)
    np.testing.assert_allclose(after[v], there[12:15], atol=1e-9)
    np.testing.assert_allclose(after[FULL.mean_slice("t")], there[15:] - turned @ c, atol=1e-6)


def test_its_transition_is_the_finite_difference_by_the_state_and_by_the_scale_of_the_inertia() -> None:
    driven, x, scale = driven_motion(FULL)
    after, transition, _ = driven.linearise(x, 0.4, 0.7)
    columns = []
    for direction in STEP * np.eye(FULL.error_dim):
        ahead, behind = (driven.step(FULL.retract(x, sign * direction), 0.4, 0.7) for sign in (1, -1))
        columns.append((FULL.local(after, ahead) - FULL.local(after, behind)) / (2 * STEP))
    heavier = [
        DrivenMotion(driven._process, ACTING, scale * np.exp(sign * STEP)).step(x, 0.4, 0.7)
        for sign in (1, -1)
    ]
    columns.append((FULL.local(after, heavier[0]) - FULL.local(after, heavier[1])) / (2 * STEP))
    np.testing.assert_allclose(transition, np.stack(columns, axis=1), atol=1e-8)


def test_the_bound_with_a_torque_is_that_of_finite_differences_of_the_whole_flight() -> None:
    driven, x, scale = driven_motion(ROTATION)
    time = 0.5 * np.arange(10)
    reference = driven_reference(TorqueFreeProcess(ROTATION, ProcessNoise(0.0, 0.0)), x, time, driven)
    schedule = SensorSchedule(Gyro(ROTATION), gyro_parameters(1, 0.01, 0.0), 0, np.ones((10, 1), dtype=bool))
    prior = {"a": 0.1, "w": 0.1, "s": 0.3, "n": 0.2}

    def rates(moved: np.ndarray) -> np.ndarray:
        other = DrivenMotion(driven._process, ACTING[:2], scale * np.exp(moved[-1]))
        states = driven_reference(reference.process, ROTATION.retract(x, moved[:-1]), time, other).states
        return states[:, ROTATION.mean_slice("w")].ravel() / 0.01

    size = ROTATION.error_dim + 1
    slopes = np.stack([(rates(d) - rates(-d)) / (2 * STEP) for d in STEP * np.eye(size)], axis=1)
    deviations = np.repeat([0.1, 0.1, 0.3, 0.2], [3, 3, 5, 1])
    covariance = np.linalg.inv(slopes.T @ slopes + np.diag(deviations**-2))
    bound = cramer_rao_bound(reference, [schedule], prior)
    constants = np.r_[6:12]
    np.testing.assert_allclose(
        bound.covariances[-1][np.ix_(constants, constants)],
        covariance[np.ix_(constants, constants)],
        atol=1e-5 * np.abs(covariance).max(),
    )


def test_a_manoeuvre_gives_one_camera_its_scale_and_the_bound_shows_it() -> None:
    found = {}
    for inputs in ((), (Input.INSPECTOR_X,)):
        case = Case(sensors=("monocular",), inputs=inputs)
        reference = case.reference(60, 0.5)
        found[len(inputs)] = bounded_quantities(case.bound(reference), reference)["centre of mass in g", "m"][
            -1
        ]
    assert found[1] < 0.05 * found[0]


def test_a_larger_manoeuvre_tells_more() -> None:
    case = Case(sensors=("monocular",), inputs=(Input.INSPECTOR_X,))
    large = Case(sensors=("monocular",), inputs=(Input.INSPECTOR_X,), sizes=InputSizes(manoeuvre=0.02))
    small, more = (
        bounded_quantities(each.bound(reference := each.reference(60, 0.5)), reference)[
            "centre of mass in g", "m"
        ][-1]
        for each in (case, large)
    )
    assert more < 0.8 * small


def test_a_torque_about_the_spin_axis_tells_that_moment_and_no_other() -> None:
    case = Case(
        sensors=("gyro",), inputs=(Input.TORQUE_Z,), motion=motion("spin", (0, 0, 1.0), (1.2, 1.0, 0.85))
    )
    reference = case.reference(60, 0.5)
    bound = case.bound(reference)
    assert bounded_quantities(bound, reference)[EACH_MOMENT][-1] > 1.0
    slopes = np.zeros(bound.covariances.shape[1])
    slopes[-1] = 1.0
    assert (
        np.sqrt(slopes @ bound.covariances[-1] @ slopes) > 1.0
    )  # of the scale, with the other moments unknown


def test_six_known_inputs_together_are_analysed() -> None:
    case = Case(sensors=("pose",), inputs=tuple(Input))
    assert case.certificate().null_dimension == 0


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: KnownInput(Input.TORQUE_X, 0.0, 1.0), "a known input of size 0"),
        (lambda: KnownInput(Input.TORQUE_X, 1.0, -1.0), "period -1 s"),
        (
            lambda: Case(inputs=(Input.INSPECTOR_Z,), sizes=InputSizes(manoeuvre=1.0)).reference(60, 0.5),
            "carries the camera past the body",
        ),
        (
            lambda: Case(sensors=("gyro",), inputs=(Input.TORQUE_X,)).reference(3, 1e4),
            "too many for a bound with a known input",
        ),
    ],
)
def test_inputs_that_make_no_sense_are_refused(make, text: str) -> None:
    with pytest.raises(InputError, match=text):
        make()
