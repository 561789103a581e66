"""Blocks of a rigid body with a geometric frame.

Pose, velocities, centre of mass and mass distribution.
"""

from typing import Final

import casadi as ca

from spinfilters.attitude.expressions import (
    Expression,
    conjugate,
    normalised,
    product,
    quaternion_from_mrp,
    short_mrp_from_quaternion,
)
from spinfilters.dynamics.mass_distribution import (
    from_second_moments,
    inertia,
    local_mass,
    near_local_mass,
    reset_mass_jacobian,
    retract_mass,
    second_moments,
)
from spinfilters.state.block import ErrorChart, RotationParameters, StateBlock, vector_after_gauge_move


def _retract_attitude(q: Expression, a: Expression) -> Expression:
    return product(q, quaternion_from_mrp(a))


def _local_attitude(q: Expression, p: Expression) -> Expression:
    return short_mrp_from_quaternion(product(conjugate(q), p))


def _reset_attitude(d: Expression) -> Expression:
    """Derivative of the 4 x MRP of dq(d)^-1 (x) dq(e) by e, at e = d."""
    e = ca.SX.sym("e", 3)
    jacobian = ca.jacobian(_local_attitude(quaternion_from_mrp(d), quaternion_from_mrp(e)), e)
    return ca.substitute(jacobian, e, d)


def _inertia_entries(s: Expression) -> Expression:
    """The lower triangle of J(s), column by column."""
    J = inertia(s)
    return ca.vertcat(J[0, 0], J[1, 0], J[2, 0], J[1, 1], J[2, 1], J[2, 2])


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
    rotation=RotationParameters(6, _inertia_entries),
    after_gauge_move=_rotated_mass,
)
"""See `spinfilters.dynamics.mass_distribution`."""
RIGID_BODY: Final = (POSITION, ATTITUDE, VELOCITY, RATE, CENTRE_OF_MASS, MASS_DISTRIBUTION)
