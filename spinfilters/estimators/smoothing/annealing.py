"""Annealed schedule: process noise inflated at first, down to what it is."""

from dataclasses import dataclass

import numpy as np

from spinfilters.estimators.smoothing.motion import Motion
from spinfilters.estimators.smoothing.problem import Normal, Point, Stage
from spinfilters.estimators.smoothing.robust_kernels import LeastSquares

TIGHTENING = 4.0
"""By which the inflation falls at least from one iteration to the next."""
SMALLEST_INFLATION = 3.0
"""Of the standard deviation of the process noise; less is as good as none."""


def process_noise_inflation(motion: Motion, here: Point, before: Normal | None) -> float:
    """Factor of the process noise's standard deviation at which the trajectory obeys its dynamics; 1 where it nearly does.

    Enforcing the dynamics from the first iteration, about a trajectory that breaks them by hundreds of standard deviations,
    moves it far from where the linear models hold.
    """
    steps = max(len(motion.unknowns.moving) * len(motion.dt), 1)
    inflation = float(np.sqrt(here.dynamics.cost / steps))
    if before is not None:
        inflation = min(inflation, before.stage.slack / TIGHTENING)
    return inflation if inflation > SMALLEST_INFLATION else 1.0


@dataclass(frozen=True)
class Annealed:
    """Least squares with inflated process noise until the trajectory obeys its dynamics, or iterations run out."""

    motion: Motion
    iterations: int

    def stage(self, iteration: int, here: Point, before: Normal | None) -> Stage:
        """Every measurement counts; by how much larger the process noise is taken than it is."""
        within = iteration < self.iterations
        return Stage(LeastSquares(), process_noise_inflation(self.motion, here, before) if within else 1.0)

    def last(self, iteration: int, stage: Stage) -> bool:
        """Whether the process noise is what it is."""
        return stage.slack == 1.0

    def repaired(self, here: Point, stage: Stage) -> Point:
        """As it is."""
        return here
