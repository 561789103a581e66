"""State blocks: what layouts, models, estimators and tables ask of a part of a state, every block, and the tuple that names them.

A new constant block is one `StateBlock` here and its name in `OWN_BLOCKS`. A block that drifts also changes the process
(`spinfilters.models.process`).
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from math import inf
from types import MappingProxyType
from typing import Final

import casadi as ca

from spinfilters.core.attitude_expressions import (
    Expression,
    conjugate,
    normalised,
    product,
    quaternion_from_mrp,
    short_mrp_from_quaternion,
)
from spinfilters.core.errors import InputError
from spinfilters.core.mass_distribution import (
    from_second_moments,
    inertia,
    inertia_entries,
    local_mass,
    near_local_mass,
    reset_mass_jacobian,
    retract_mass,
    second_moments,
)
from spinfilters.io.stated_values import NumberRange

PointAndError = Callable[[Expression, Expression], Expression]
"""From a point and an error, or from two points."""


def add(point: Expression, error: Expression) -> Expression:
    """The point at an additive error."""
    return point + error


def subtract(here: Expression, there: Expression) -> Expression:
    """The additive error that takes ``here`` to ``there``."""
    return there - here


def same(point: Expression) -> Expression:
    """The point itself."""
    return point


@dataclass(frozen=True)
class ErrorChart:
    """Points and errors of a block, as CasADi expressions; by default both are vectors that add.

    Attributes
    ----------
    retract : PointAndError
        (point, error) to the point at that error.
    local : PointAndError
        (here, there) to the error that takes one to the other.
    near_local : PointAndError
        ``local`` to first order at here = there, for derivatives there: a shorter expression.
    reset_jacobian : Callable[[Expression], Expression] | None
        Derivative of the error about retract(x, d) by the error about x, at d; None where it is the identity.
    normalised : Callable[[Expression], Expression] | None
        a point without rounding off its manifold; None where every number is a point.
    """

    retract: PointAndError = add
    local: PointAndError = subtract
    near_local: PointAndError = subtract
    reset_jacobian: Callable[[Expression], Expression] | None = None
    normalised: Callable[[Expression], Expression] | None = None


@dataclass(frozen=True)
class RotationParameters:
    """Numbers by which a constant block enters the equation of the body rate.

    Attributes
    ----------
    count : int
        How many.
    of : Callable[[Expression], Expression]
        Them from a point of the block; by default they are the point.
    """

    count: int
    of: Callable[[Expression], Expression] = same


@dataclass(frozen=True)
class ReportedConstant:
    """A block as one of the results of a run.

    Attributes
    ----------
    value_key, std_key : str
        Of its value and standard deviation in `summary.json`.
    value_format, std_format : str
        Of a number in the table.
    """

    value_key: str
    std_key: str
    value_format: str = ".3g"
    std_format: str = ".2g"


@dataclass(frozen=True)
class StateBlock:
    """A part of a state.

    Attributes
    ----------
    name : str
        Its letter in layouts and formulas.
    rank : int
        Its place among the blocks of a layout, ascending.
    dimension : int
        Of its error.
    unit : str
        Of its error.
    label : str
        In tables and figures.
    phrase : str
        In a sentence, with its article.
    constant : bool
        Whether it is the same at every time; if not, the process model moves it.
    translational : bool
        Whether it means anything only where the state has a position.
    prior_std : float
        Of the prior of the first state, in `unit`.
    prior_option : str
        Of the initialisation, which has it instead; "" for none.
    prior_range : NumberRange | None
        Of that option, with zero, for a block that a state has only where the option is set: the table
        [initialisation] of the settings then has it by itself, with default 0. None where the settings name it.
    prior_at_origin : bool
        Whether that prior lies at the origin, not at what the first measurements say.
    symbol : str
        Of its point among the expressions of a state, its name by default.
    chart : ErrorChart
        Of its points and errors.
    origin : tuple[float, ...]
        Its point of reference; zeros by default.
    largest_step : float
        Of a component in one iteration, beyond which a linear model of it says nothing.
    rotation : RotationParameters | None
        How it enters the equation of the body rate, None where it does not.
    after_gauge_move : Callable[[Expression, Expression, Expression], Expression] | None
        The point once frame g has been moved by the rotation R and then rho (m), both in g axes, from (point, R,
        rho); None where it does not depend on g.
    truth_field : str
        Of a `Truth`, which is this block's point; "" where the truth does not hold it as such.
    reported : ReportedConstant | None
        How it is shown as a result of its own, None where it is not.
    switch : str
        Key of [process] in the settings that gives the state this block; "" of a block that no such key does.
    switched_by : tuple
        Values of that key that do.
    """

    name: str
    rank: int
    dimension: int
    unit: str
    label: str
    phrase: str
    constant: bool
    translational: bool = False
    prior_std: float = 1.0
    prior_option: str = ""
    prior_range: NumberRange | None = None
    prior_at_origin: bool = True
    symbol: str = ""
    chart: ErrorChart = field(default_factory=ErrorChart)
    origin: tuple[float, ...] = ()
    largest_step: float = inf
    rotation: RotationParameters | None = None
    after_gauge_move: Callable[[Expression, Expression, Expression], Expression] | None = None
    truth_field: str = ""
    reported: ReportedConstant | None = None
    switch: str = ""
    switched_by: tuple[bool | str, ...] = (True,)

    def __post_init__(self) -> None:
        object.__setattr__(self, "symbol", self.symbol or self.name)
        object.__setattr__(self, "origin", self.origin or (0.0,) * self.dimension)

    @property
    def mean_size(self) -> int:
        """Numbers of a point."""
        return len(self.origin)


def vector_after_gauge_move(vector: Expression, R: Expression, rho: Expression) -> Expression:
    """Components of a vector in axes g once g has been rotated."""
    return R @ vector


ACCELERATION: Final = StateBlock(
    name="f",
    rank=8,
    dimension=3,
    unit="m/s^2",
    label="acceleration",
    phrase="the constant acceleration",
    constant=True,
    translational=True,
    prior_std=10.0,
    reported=ReportedConstant("acceleration", "acceleration_std"),
    switch="gravity",
)


DRAG: Final = StateBlock(
    name="d",
    rank=6,
    dimension=1,
    unit="1/rad",
    label="drag",
    phrase="the drag",
    constant=True,
    prior_std=0.05,
    prior_option="drag_std",
    rotation=RotationParameters(1),
    reported=ReportedConstant("drag_per_rad", "drag_std_per_rad", ".2e", ".1e"),
    switch="drag",
    # "auto" has been decided where epochs are smoothed, and is quadratic where they are not
    switched_by=(True, "quadratic", "auto"),
)


GYRO_BIAS: Final = StateBlock(
    name="b",
    rank=7,
    dimension=3,
    unit="rad/s",
    label="gyro bias",
    phrase="the bias of the gyro",
    constant=True,
    prior_std=0.003,
    prior_option="gyro_bias_std",
    prior_range=NumberRange(1e-9, 1e3, "rad/s", zero=True),
    after_gauge_move=vector_after_gauge_move,
    truth_field="gyro_bias",
    reported=ReportedConstant("gyro_bias", "gyro_bias_std"),
)


GYRO_SCALE: Final = StateBlock(
    name="k",
    rank=10,
    dimension=1,
    unit="1",
    label="gyro scale",
    phrase="the scale of the gyro",
    constant=True,
    prior_std=0.05,
    prior_option="gyro_scale_error_std",
    prior_range=NumberRange(1e-9, 1.0, zero=True),
    reported=ReportedConstant("gyro_scale_error", "gyro_scale_error_std"),
)


LINEAR_DRAG: Final = StateBlock(
    name="l",
    rank=11,
    dimension=1,
    unit="1/s",
    label="linear drag",
    phrase="the linear drag",
    constant=True,
    prior_std=0.5,
    prior_option="linear_drag_std",
    rotation=RotationParameters(1),
    reported=ReportedConstant("linear_drag_per_s", "linear_drag_std_per_s", ".2e", ".1e"),
    switch="drag",
    switched_by=("linear",),
)


def _retract_attitude(q: Expression, a: Expression) -> Expression:
    return product(q, quaternion_from_mrp(a))


def _local_attitude(q: Expression, p: Expression) -> Expression:
    return short_mrp_from_quaternion(product(conjugate(q), p))


def _reset_attitude(d: Expression) -> Expression:
    """Derivative of the 4 x MRP of dq(d)^-1 (x) dq(e) by e, at e = d."""
    e = ca.SX.sym("e", 3)
    jacobian = ca.jacobian(_local_attitude(quaternion_from_mrp(d), quaternion_from_mrp(e)), e)
    return ca.substitute(jacobian, e, d)


def _rotated_mass(s: Expression, R: Expression, rho: Expression) -> Expression:
    return from_second_moments(R @ second_moments(s) @ R.T)


def _moved_point(c: Expression, R: Expression, rho: Expression) -> Expression:
    return R @ c + rho


POSITION: Final = StateBlock(
    name="t",
    rank=0,
    dimension=3,
    unit="m",
    label="position of g",
    phrase="the position of frame g",
    constant=False,
    translational=True,
    prior_at_origin=False,
)
"""Origin of g in i."""
ATTITUDE: Final = StateBlock(
    name="a",
    rank=1,
    dimension=3,
    unit="rad",
    label="attitude",
    phrase="the attitude",
    constant=False,
    prior_at_origin=False,
    symbol="q",
    chart=ErrorChart(_retract_attitude, _local_attitude, _local_attitude, _reset_attitude, normalised),
    origin=(0.0, 0.0, 0.0, 1.0),
    largest_step=1.0,
    truth_field="q_ig",
)
"""Quaternion q_ig, whose error is 4 x MRP on the body side."""
VELOCITY: Final = StateBlock(
    name="v",
    rank=2,
    dimension=3,
    unit="m/s",
    label="velocity",
    phrase="the velocity of the centre of mass",
    constant=False,
    translational=True,
    prior_std=1.0,
    prior_option="speed_std",
    truth_field="velocity",
)
"""Of the centre of mass, in i."""
RATE: Final = StateBlock(
    name="w",
    rank=3,
    dimension=3,
    unit="rad/s",
    label="rate",
    phrase="the body rate",
    constant=False,
    prior_at_origin=False,
    after_gauge_move=vector_after_gauge_move,
)
"""Of the body, in g axes."""
CENTRE_OF_MASS: Final = StateBlock(
    name="c",
    rank=4,
    dimension=3,
    unit="m",
    label="centre of mass",
    phrase="the centre of mass",
    constant=True,
    translational=True,
    prior_std=1.0,
    prior_option="centre_std",
    after_gauge_move=_moved_point,
    truth_field="center_of_mass_g",
)
"""In g."""
MASS_DISTRIBUTION: Final = StateBlock(
    name="s",
    rank=5,
    dimension=5,
    unit="log second moment",
    label="mass distribution",
    phrase="the mass distribution",
    constant=True,
    prior_std=1.5,
    prior_option="mass_std",
    chart=ErrorChart(retract_mass, local_mass, near_local_mass, reset_mass_jacobian),
    largest_step=1.0,
    rotation=RotationParameters(6, lambda s: inertia_entries(inertia(s))),
    after_gauge_move=_rotated_mass,
)
"""See `spinfilters.core.mass_distribution`."""
RIGID_BODY: Final = (POSITION, ATTITUDE, VELOCITY, RATE, CENTRE_OF_MASS, MASS_DISTRIBUTION)


ROTOR: Final = StateBlock(
    name="h",
    rank=20,
    dimension=3,
    unit="rad/s",
    label="flywheel",
    phrase="the angular momentum of a flywheel",
    constant=True,
    prior_std=1.0,
    rotation=RotationParameters(3),
    after_gauge_move=vector_after_gauge_move,
    reported=ReportedConstant("rotor_momentum", "rotor_momentum_std"),
    switch="rotor",
)


TORQUE: Final = StateBlock(
    name="m",
    rank=9,
    dimension=3,
    unit="rad/s^2",
    label="body torque",
    phrase="the constant body torque",
    constant=True,
    prior_std=0.1,
    rotation=RotationParameters(3),
    after_gauge_move=vector_after_gauge_move,
    reported=ReportedConstant("body_torque", "body_torque_std"),
    switch="body_torque",
)


OWN_BLOCKS: Final = (*RIGID_BODY, ACCELERATION, DRAG, GYRO_BIAS, GYRO_SCALE, LINEAR_DRAG, ROTOR, TORQUE)


def table(blocks: Iterable[StateBlock]) -> Mapping[str, StateBlock]:
    """Blocks by name in the order of their ranks.

    Raises
    ------
    InputError
        A name or a rank that two of them have.
    """
    ranked = sorted(blocks, key=lambda block: block.rank)
    for attribute in ("name", "rank"):
        values = [getattr(block, attribute) for block in ranked]
        twice = {str(value) for value in values if values.count(value) > 1}
        if twice:
            raise InputError(
                f"state blocks share the {attribute} {', '.join(sorted(twice))}; give each its own"
            )
    return MappingProxyType({block.name: block for block in ranked})


BLOCKS: Final = table(OWN_BLOCKS)
"""Every state block by name, in the order in which a layout holds them."""
