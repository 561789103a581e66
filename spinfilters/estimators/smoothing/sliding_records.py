"""What a sliding smoother is told, what it hands back, and what it remembers."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Measurement
from spinfilters.estimators.smoothing.closed_form import Tried
from spinfilters.estimators.smoothing.modes import FrozenVision, Mode
from spinfilters.estimators.smoothing.robust_kernels import Gate, RobustKernel
from spinfilters.state.status import EstimatorStatus

TRUSTED = 0.15
"""Standard deviation of the mass distribution from which the belief is trusted: before, it may sit in a wrong minimum, or be curved
more than a covariance tells (NEES of a hundred times the degrees of freedom above 0.3 on simulated motions, as it should be below
0.2)."""


@dataclass(frozen=True)
class SlidingOptions:
    """How a sliding smoother works.

    Attributes
    ----------
    mode: what it keeps.   gate: standard deviations beyond which a sighting counts as a wrong association.
    iterations: per frame, at most; one is enough where nothing surprises.
    retired: whether frames that leave are handed back with their covariance, which costs a factorisation more.
    kernel: of a sighting's residual, in place of the gate.
    """

    mode: Mode = field(default_factory=FrozenVision)
    gate: float = 5.0
    iterations: int = 4
    retired: bool = True
    kernel: RobustKernel | None = None

    def __post_init__(self) -> None:
        if self.iterations < 1 or not self.gate > 0:
            raise InputError(
                f"iterations is {self.iterations}, gate {self.gate}; give at least 1 and more than 0"
            )

    @property
    def sighting_kernel(self) -> RobustKernel:
        """The kernel, or the gate."""
        return Gate(self.gate, self.gate) if self.kernel is None else self.kernel


@dataclass(frozen=True)
class Retired:
    """A frame that left the window: the last that was said of it."""

    time: float
    mean: Float[np.ndarray, " m"]
    factor: Float[np.ndarray, "n n"]


@dataclass(frozen=True)
class Taken:
    """What taking in a frame did.

    Attributes
    ----------
    accepted, rejected: values that count and that do not.   linearisations: how many it took.
    retired: frames that left.   counts: accepted and rejected by measurement.
    """

    accepted: int
    rejected: int
    linearisations: int
    retired: tuple[Retired, ...] = ()
    counts: tuple[tuple[int, int], ...] = ()

    @classmethod
    def counted(
        cls, measurements: Sequence[Measurement], weights: list[Float[np.ndarray, " n"]], linearisations: int
    ) -> "Taken":
        """From the weights of observations by measurement; of measurements beside landmarks all values count."""
        counts = []
        for m, weight in zip(measurements, weights, strict=True):
            good = len(m.values) if m.ids is None else int(np.count_nonzero(weight > 0))
            counts.append((good, len(m.values) - good))
        accepted, rejected = (sum(count[side] for count in counts) for side in (0, 1))
        return cls(accepted, rejected, linearisations, counts=tuple(counts))


@dataclass
class Memory:
    """What a sliding smoother remembers beside its window.

    Attributes
    ----------
    prior_alive: whether the first frame's prior still stands by itself.   strange: whether the newest frame was not believed.
    determined: frames in a row after which the inertia was determined.   tried: when the closed form is asked again.
    mass_std: of the mass distribution (logarithm of second moments), the largest, after the last frame.
    fits: whether the last frame's solution explained what was measured within its noise.
    """

    prior_alive: bool = True
    strange: bool = False
    determined: int = 0
    tried: Tried = field(default_factory=Tried)
    mass_std: float = np.inf
    fits: bool = True

    @property
    def status(self) -> EstimatorStatus:
        """Whether the belief of the latest epoch can be relied upon already, and if not, why."""
        status, std = EstimatorStatus(), self.mass_std
        if not std <= TRUSTED:
            status = status.degraded(
                f"the inertia is not determined yet (standard deviation {std:.2g} of the logarithm of second moments, "
                f"at most {TRUSTED} is trusted)"
            )
        if not self.fits:
            status = status.degraded("the motion found does not explain the observations within their noise")
        if self.strange:
            status = status.degraded("the latest epoch's observations agree on no pose")
        return status
