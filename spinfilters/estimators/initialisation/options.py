"""Settings of the initialisation."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spinfilters.data.stated_values import NumberRange
from spinfilters.errors import InputError
from spinfilters.estimators.timeline import Timeline, times_of
from spinfilters.state.block import StateBlock
from spinfilters.state.blocks.drag import DRAG
from spinfilters.state.blocks.gyro_bias import GYRO_BIAS
from spinfilters.state.blocks.gyro_scale import GYRO_SCALE
from spinfilters.state.blocks.linear_drag import LINEAR_DRAG
from spinfilters.state.blocks.rigid_body import CENTRE_OF_MASS, MASS_DISTRIBUTION, VELOCITY

PRIOR_STD = NumberRange(1e-9, 1e9)
"""Of a prior in the settings, in its unit."""
_MAY_BE_ZERO = (GYRO_BIAS.prior_option, GYRO_SCALE.prior_option)
"""Options of blocks that a state has only where they are set."""


@dataclass(frozen=True)
class InitialisationOptions:
    """Options of the initialisation.

    Attributes
    ----------
    epochs: how many epochs it looks at, at most.   share: of the recording, at most; a third more where filters need it.
    duration: how many seconds it looks at, at most.
    iterations: of the smoother, at most.
    mass_std: of the prior of the mass distribution about the sphere, in the logarithm of second moments (a phone lies at 2).
    centre_std: of the prior of the centre of mass about the origin of g, m.   speed_std: of its velocity, m/s.
    drag_std: of the prior of the drag coefficient, 1/rad.   linear_drag_std: of that of a drag linear in the rate, 1/s.
    gyro_bias_std: of the prior of a gyro's bias, rad/s; 0 for a gyro without one.
    gyro_scale_error_std: of the prior of the relative error of a gyro's scale; 0 for a gyro without one.
    """

    epochs: Annotated[int, NumberRange(1, 100_000, whole=True)] = 60
    share: Annotated[float, NumberRange(1e-6, 1e6)] = 0.6
    duration: Annotated[float, NumberRange(1e-6, 1e11, "s")] = 60.0
    iterations: Annotated[int, NumberRange(1, 10_000, whole=True)] = 40
    mass_std: Annotated[float, PRIOR_STD] = MASS_DISTRIBUTION.prior_std
    centre_std: Annotated[float, PRIOR_STD] = CENTRE_OF_MASS.prior_std
    speed_std: Annotated[float, PRIOR_STD] = VELOCITY.prior_std
    drag_std: Annotated[float, PRIOR_STD] = DRAG.prior_std
    linear_drag_std: Annotated[float, PRIOR_STD] = LINEAR_DRAG.prior_std
    gyro_bias_std: Annotated[float, NumberRange(1e-9, 1e3, "rad/s", zero=True)] = 0.0
    gyro_scale_error_std: Annotated[float, NumberRange(1e-9, 1.0, zero=True)] = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            allowed = value >= 0 if name in _MAY_BE_ZERO else value > 0
            if not (np.isfinite(value) and allowed):
                raise InputError(f"initialisation.{name} is {value}; it must be positive")

    def states_prior(self, block: StateBlock) -> bool:
        """Whether the option that a block names for its prior is set."""
        return bool(block.prior_option and getattr(self, block.prior_option))

    def prior_std(self, block: StateBlock) -> float:
        """Prior standard deviation of a block.

        The option that the block names where that is set, or the block's own.
        """
        return (getattr(self, block.prior_option) if block.prior_option else 0.0) or block.prior_std

    def count(self, timeline: Timeline) -> int:
        """Number of epochs used for initialisation."""
        time = times_of(timeline)
        inside = int(np.searchsorted(time, time[0] + self.duration, "right"))
        return max(4, min(self.epochs, inside, round(self.share * len(timeline))))
