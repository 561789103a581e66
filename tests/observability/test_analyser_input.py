"""What cannot be analysed is refused in one clear line."""

from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from observability import system as sensors
from observability.body_model import body_rank
from observability.canonical_motions import landmarks, motion, point_of
from observability.certificate import certify
from observability.coordinates import PrincipalChart
from observability.exact_numbers import rational, rationals, unit_quaternion
from observability.function_values import branch_decisions
from observability.residue_matrices import FIELD
from observability.system import Input, System, SystemSensor
from observability.tape import tape_of
from spinfilters.core.attitude_expressions import Expression
from spinfilters.core.errors import InputError, ShapeError
from spinfilters.models.sensors.gyro import Gyro
from tests.observability.analyser_samples import EULER, LOG_RATIOS, TUMBLE

PRINCIPAL = PrincipalChart()


class _Stepping(Gyro):
    """Rounds its value: it has no derivative."""

    name = "stepping gyro"

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        return ca.floor(100 * state["w"])


class _Kinked(Gyro):
    """Is not differentiable where two rates are equal."""

    name = "kinked gyro"

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        return ca.fmax(state["w"][0], state["w"][1])


class _Inverse(Gyro):
    """Has no value at rate 0."""

    name = "inverse gyro"

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        return 1 / state["w"]


def gyro_like(model: type[Gyro]) -> System:
    """A system with a sensor of that class."""
    return System(EULER, [SystemSensor(model(sensors.LAYOUT), (rationals((0.1, 0.0)),))])


def test_a_model_without_derivatives_is_refused_by_name() -> None:
    with pytest.raises(InputError, match="stepping gyro contains floor, which has no power series"):
        certify(gyro_like(_Stepping), point_of(EULER, TUMBLE))


def test_a_point_on_a_kink_is_refused_and_one_beside_it_is_not() -> None:
    blocks = {"J": ("1.2", "1", "0.9")}
    with pytest.raises(
        InputError, match="kinked gyro is not differentiable at this point: both sides of fmax are"
    ):
        certify(gyro_like(_Kinked), EULER.point({"w": (0.5, 0.5, 0.1), **blocks}))
    assert certify(gyro_like(_Kinked), EULER.point({"w": (0.5, 0.6, 0.1), **blocks})).rank > 0


def test_a_point_without_a_value_is_refused() -> None:
    with pytest.raises(InputError, match="inverse gyro has no power series at this point: division by 0"):
        certify(gyro_like(_Inverse), EULER.point({"w": (0.0, 0.6, 0.1), "J": (1.2, 1.0, 0.9)}))


def test_no_measurements_are_refused() -> None:
    with pytest.raises(InputError, match="nothing is measured"):
        System(EULER, [])
    with pytest.raises(InputError, match="stereo measures nothing"):
        sensors.watching("stereo", [])


@pytest.mark.parametrize(
    ("blocks", "error", "text"),
    [
        ({"w": (1.0, 2.0)}, InputError, "has the blocks w, J; got w"),
        (
            {"w": (1.0, 2.0), "J": (1.0, 1.0, 1.0)},
            ShapeError,
            "block w of the chart .* takes 3 numbers, got 2",
        ),
        ({"w": (1.0, np.nan, 2.0), "J": (1.0, 1.0, 1.0)}, InputError, "nan cannot be analysed"),
    ],
)
def test_a_wrong_point_is_refused(blocks: dict, error: type[Exception], text: str) -> None:
    with pytest.raises(error, match=text):
        EULER.point(blocks)


def test_wrong_shapes_are_refused() -> None:
    system = System(EULER, [sensors.watching("gyro")])
    with pytest.raises(ShapeError, match="a point of the chart principal axes has 6 numbers, got 5"):
        body_rank(system, point_of(EULER, TUMBLE)[:5], 3)
    with pytest.raises(InputError, match="0 orders leave no rows"):
        body_rank(system, point_of(EULER, TUMBLE), 0)
    with pytest.raises(InputError, match="the system has 0 known inputs, got 1 series"):
        body_rank(system, point_of(EULER, TUMBLE), 3, [[rationals((1.0,))]])
    with pytest.raises(ShapeError, match="a measurement of gyro has 2 parameters, got 3"):
        SystemSensor(Gyro(sensors.LAYOUT), (rationals((1.0, 2.0, 3.0)),))
    with pytest.raises(InputError, match="5 of 2 parameters of gyro cannot be unknown"):
        SystemSensor(Gyro(sensors.LAYOUT), (rationals((1.0, 2.0)),), 5)


def test_a_sensor_that_sees_more_than_the_chart_holds_is_refused() -> None:
    with pytest.raises(InputError, match="stereo needs q, t, which the chart principal axes does not hold"):
        System(LOG_RATIOS, [sensors.watching("stereo", landmarks(1))])
    with pytest.raises(InputError, match="an inspector's manoeuvre needs a velocity"):
        System(LOG_RATIOS, [sensors.watching("gyro")], [Input.INSPECTOR_X])


@pytest.mark.parametrize("moments", [(1.0, 1.0, 2.0), (1.0, 1.0, -1.0), (0.0, 1.0, 1.0)])
def test_moments_of_no_body_are_refused(moments: tuple[float, float, float]) -> None:
    with pytest.raises(InputError, match="are no motion"):
        motion("impossible", (0.1, 0.2, 0.3), moments)


def test_a_float_is_read_as_the_simplest_fraction_that_rounds_to_it() -> None:
    assert rational(1 / 3) == Fraction(1, 3)
    assert rational(0.1) == Fraction(1, 10)
    assert rational("1e-12") == Fraction(1, 10**12)
    odd = float(np.nextafter(0.1, 1))
    assert float(rational(odd)) == odd


@pytest.mark.parametrize(
    "q", [(0, 0, 0, 1), (0, 0, 0, -2), (1, 0, 0, 0), (0.3, -0.5, 0.2, 1e-9), (1, 1, 1, 1)]
)
def test_a_quaternion_becomes_one_of_exactly_unit_norm_beside_it(q: tuple[float, ...]) -> None:
    exact = unit_quaternion(q)
    assert sum(part * part for part in exact) == 1
    np.testing.assert_allclose([float(part) for part in exact], np.array(q) / np.linalg.norm(q), atol=1e-15)


@pytest.mark.parametrize("q", [(0, 0, 0, 0), (1, 0, 0), (np.inf, 0, 0, 1)])
def test_what_is_no_quaternion_is_refused(q: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="is no quaternion"):
        unit_quaternion(q)


def test_an_exponent_with_a_root_that_has_no_residue_is_refused() -> None:
    x = ca.SX.sym("x", 3)
    tape = tape_of("the expression", [x], ca.SX(ca.exp(ca.sqrt(x[0]))))
    with pytest.raises(InputError, match="a square root has no exact value"):
        branch_decisions(tape, [[rationals((2.0, 2.0, 3.0))]], FIELD)
