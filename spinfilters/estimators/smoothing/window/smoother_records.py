"""Options, results and state of a sliding smoother."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Measurement
from spinfilters.estimators.robust.losses import Gate, RobustLoss
from spinfilters.estimators.smoothing.window.restart_schedule import RetrySchedule
from spinfilters.estimators.smoothing.window.window_policy import LandmarkMarginalization, WindowPolicy
from spinfilters.state.status import EstimatorStatus

TRUSTED = 0.15
"""Standard deviation of the mass distribution from which the belief is trusted: before, it may sit in a wrong minimum, or be curved
more than a covariance tells (NEES of a hundred times the degrees of freedom above 0.3 on simulated motions, as it should be below
0.2)."""


@dataclass(frozen=True)
class SmootherOptions:
    """Options of a sliding smoother.

    Attributes
    ----------
    policy: what it keeps.   gate: standard deviations beyond which an observation counts as a wrong association.
    iterations: per epoch, at most; one is enough where nothing surprises.
    marginalized: whether epochs that leave are handed back with their covariance, which costs a factorisation more.
    loss: of an observation's residual, in place of the gate.
    """

    policy: WindowPolicy = field(default_factory=LandmarkMarginalization)
    gate: float = 5.0
    iterations: int = 4
    marginalized: bool = True
    loss: RobustLoss | None = None

    def __post_init__(self) -> None:
        if self.iterations < 1 or not self.gate > 0:
            raise InputError(
                f"iterations is {self.iterations}, gate {self.gate}; give at least 1 and more than 0"
            )

    @property
    def observation_loss(self) -> RobustLoss:
        """The loss, or the gate."""
        return Gate(self.gate, self.gate) if self.loss is None else self.loss


@dataclass(frozen=True)
class MarginalizedState:
    """Final estimate of an epoch that left the window."""

    time: float
    mean: Float[np.ndarray, " m"]
    factor: Float[np.ndarray, "n n"]


@dataclass(frozen=True)
class UpdateResult:
    """Result of adding an epoch.

    Attributes
    ----------
    accepted, rejected: values that count and that do not.   linearisations: how many it took.
    marginalized: epochs that left.   counts: accepted and rejected by measurement.
    """

    accepted: int
    rejected: int
    linearisations: int
    marginalized: tuple[MarginalizedState, ...] = ()
    counts: tuple[tuple[int, int], ...] = ()

    @classmethod
    def counted(
        cls, measurements: Sequence[Measurement], weights: list[Float[np.ndarray, " n"]], linearisations: int
    ) -> "UpdateResult":
        """Result from the weights of observations; landmark-free measurements count all values."""
        counts = []
        for m, weight in zip(measurements, weights, strict=True):
            good = len(m.values) if m.ids is None else int(np.count_nonzero(weight > 0))
            counts.append((good, len(m.values) - good))
        accepted, rejected = (sum(count[side] for count in counts) for side in (0, 1))
        return cls(accepted, rejected, linearisations, counts=tuple(counts))


@dataclass
class SmootherState:
    """State of a sliding smoother beside its window.

    Attributes
    ----------
    prior_alive: whether the first epoch's prior still stands by itself.   poor_guess: whether the latest epoch was not believed.
    determined: epochs in a row after which the inertia was determined.   retry_schedule: when the closed form is asked again.
    mass_std: of the mass distribution (logarithm of second moments), the largest, after the last epoch.
    fits: whether the last epoch's solution explained what was measured within its noise.
    """

    prior_alive: bool = True
    poor_guess: bool = False
    determined: int = 0
    retry_schedule: RetrySchedule = field(default_factory=RetrySchedule)
    mass_std: float = np.inf
    fits: bool = True

    @property
    def status(self) -> EstimatorStatus:
        """Whether the belief of the latest epoch can be relied upon already, and if not, why."""
        status, std = EstimatorStatus(), self.mass_std
        if not std <= TRUSTED:
            status = status.degraded(
                f"the inertia is not determined yet (standard deviation {std:.2g} of the logarithm of second moments, "
                f"at most {TRUSTED} is trusted)",
                "inertia-not-yet",
            )
        if not self.fits:
            status = status.degraded(
                "the motion found does not explain the observations within their noise", "poor-fit"
            )
        if self.poor_guess:
            status = status.degraded("the latest epoch's observations agree on no pose", "no-pose")
        return status
