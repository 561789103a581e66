"""Solutions of a linear problem for the working variables of its variance components.

With u_i the whitened residuals that component i explains, the solution of the same linear problem with the right-hand side u_i is
P J'u_i: what the states move by as the component's ln variance rises (up to its sign), and J P J'u_i enters the average information
F_ij = u_i' (I - J P J') u_j / 2 (Gilmour, Thompson and Cullis 1995).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.identification.residuals import WhitenedRows, explained_rows
from spinfilters.estimators.smoothing.factors.epoch_rows import EpochRows
from spinfilters.estimators.smoothing.factors.landmark_observations import LinearObservations
from spinfilters.estimators.smoothing.problem.least_squares import (
    LinearizationPoint,
    NormalEquations,
    Problem,
)


@dataclass(frozen=True)
class WorkingSolutions:
    """Of a problem about a point; what is not asked for is not solved.

    Attributes
    ----------
    sources: the working variables.   normal: the linear problem of the measurements themselves.
    """

    problem: Problem
    here: LinearizationPoint
    normal: NormalEquations
    sources: Sequence[WhitenedRows]

    @cached_property
    def variances_information(self) -> Float[np.ndarray, " c"]:
        """Information on each ln variance, the others known.

        By how much the cost of u falls in the linear problem is u' J P J' u.
        """
        lengths = np.array([source.dot(source) for source in self.sources])
        return (lengths - [each.predicted_reduction for each in self._solved]) / 2

    @cached_property
    def information(self) -> Float[np.ndarray, "c c"]:
        """Fisher information of all ln variances.

        What two of them share is that of the one with what is left of the other.
        """
        F = np.diag(self.variances_information)
        explained = [explained_rows(self.problem, self.here, each) for each in self._solved[1:]]
        for (i, one), (j, other) in combinations(enumerate(self.sources), 2):
            F[i, j] = F[j, i] = (one.dot(other) - one.dot(explained[j - 1])) / 2
        return F

    @property
    def errors(self) -> Float[np.ndarray, "c k n"]:
        """P J'u: error of every epoch by each ln variance, up to its sign."""
        solutions = [each.solution for each in self._solved]
        return np.array([each.errors for each in solutions if each is not None])

    @cached_property
    def _solved(self) -> list[NormalEquations]:
        return [self._solution(each) for each in self.sources]

    def _solution(self, right: WhitenedRows) -> NormalEquations:
        """The linear problem with another right-hand side."""
        here = self.here
        left = here.marginal_prior
        if left is not None:
            left = replace(left, gradient=np.zeros_like(left.gradient))
        steps = here.dynamics.steps.copy()
        gradient = np.einsum("kdc,kd->kc", here.dynamics.rows[:, :, :-1], right.steps)
        steps[:, :-1, -1] = steps[:, -1, :-1] = gradient
        steps[:, -1, -1] = np.einsum("kd,kd->k", right.steps, right.steps)
        other = replace(
            here,
            dynamics=replace(here.dynamics, steps=steps),
            sensors=replace(here.sensors, epochs=self._sensors(right)),
            linear=_observations(here.linear, right),
            marginal_prior=left,
        )
        return self.problem.normal(other, self.normal.stage)

    def _sensors(self, right: WhitenedRows) -> Float[np.ndarray, "k n1 n1"]:
        """Information blocks of the epochs; that of the prior has no right-hand side."""
        motion, here = self.problem.motion, self.here
        epochs, gradient = here.sensors.epochs.copy(), np.zeros(here.sensors.epochs.shape[:2])
        for k, (sensor, u) in enumerate(zip(motion.sensors, right.sensors, strict=True)):
            if not u.any():
                continue
            rows = EpochRows(here.sensor_rows(motion, k).rows, sensor.epoch)
            columns = motion.sensor_columns(sensor)[:-1]
            gradient[:, columns] += rows.gradient(u[:, :, None], len(gradient))[:, :, 0]
        epochs[:, :, -1] = epochs[:, -1, :] = gradient
        return epochs


def _observations(linear: LinearObservations | None, right: WhitenedRows) -> LinearObservations | None:
    if linear is None or right.observations is None:
        return linear
    seen = linear.rows.copy()
    seen[:, :, -1] = right.observations
    return replace(linear, rows=seen)
