"""Constant angular momentum h of a flywheel inside the body: J w' = (J w + h) x w.

h is in units of the inertia J (up to scale) times rad/s, g axes. Of a flywheel that turns steadily relative to the body (a
gyrostat), with its inertia in that of the body.
"""

from typing import Final

from spinfilters.attitude.expressions import Expression
from spinfilters.state.block import ReportedConstant, RotationParameters, StateBlock, vector_after_gauge_move


def _angular_momentum(h: Expression) -> Expression:
    return h


ROTOR: Final = StateBlock(
    name="h",
    rank=20,
    dimension=3,
    unit="rad/s",
    label="flywheel",
    phrase="the angular momentum of a flywheel",
    constant=True,
    prior_std=1.0,
    rotation=RotationParameters(3, _angular_momentum),
    after_gauge_move=vector_after_gauge_move,
    reported=ReportedConstant("rotor_momentum", "rotor_momentum_std"),
)
