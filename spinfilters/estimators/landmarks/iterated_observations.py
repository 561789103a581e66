"""Iterated update by landmark observations, for strong nonlinearity.

What the landmarks' own errors make of the observations is noise, whitened as at the point before the update; see
`spinfilters.estimators.filters.iterated_update`.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.filters.iterated_update import IterationOptions, agrees, iterate
from spinfilters.estimators.landmarks.observations import (
    ChosenObservations,
    SolvedObservations,
    corrected,
)
from spinfilters.estimators.landmarks.steps import LinearisedObservations, MapObservations


@dataclass(frozen=True)
class IteratedObservations:
    """Observations in the coordinates y of a predicted belief.

    error = factor @ y about its mean.

    Attributes
    ----------
    first: the solution about the mean.
    """

    observations: MapObservations
    mean: Float[np.ndarray, " m"]
    factor: Float[np.ndarray, "N N"]
    first: SolvedObservations

    def solution(self, options: IterationOptions) -> SolvedObservations:
        """The most probable point, from the first solution."""
        if options.iterations == 1 or self._is_good(options):
            return self.first
        y, last = iterate(self.first, self._solved_at, self._objective, options)
        return last._replace(correction=replace(last.correction, error=self.factor @ y))

    def _is_good(self, options: IterationOptions) -> bool:
        """Whether the innovations at the first solution are what the linear model predicted."""
        rows, error = self.first.whitened.rows, self.first.correction.error
        found = self._linear(error)
        residual = self._whitened(found)
        expected = rows[..., -1] - rows[..., :-1] @ error[self.observations.columns]
        valid = bool(found.valid[self.first.used].all())
        return valid and agrees(residual.reshape(-1), expected.reshape(-1), options)

    def _objective(self, y: Float[np.ndarray, " N"]) -> float:
        found = self._linear(self.factor @ y)
        if not found.valid[self.first.used].all():
            return np.inf
        residual = self._whitened(found)
        return float(y @ y) + float(np.sum(residual * residual))

    def _solved_at(self, y: Float[np.ndarray, " N"]) -> SolvedObservations:
        """The solution of the model linearised at y, told about y = 0."""
        error, o = self.factor @ y, self.observations
        found, pose, c = self._linear(error), o.sensor.columns, len(o.sensor.columns)
        reset = o.layout.reset_jacobian(error[: o.layout.error_dim])[np.ix_(pose, pose)]
        rows = found.rows.copy()
        rows[..., :c] = rows[..., :c] @ reset
        own = o.modes @ error[o.layout.error_dim : o.layout.error_dim + o.modes.shape[2]]
        rows[..., -1] += rows[..., :c] @ error[pose] + np.einsum("kdi,ki->kd", rows[..., c:-1], own)
        used, weights = self.first.used, self.first.weights
        white = o.landmarks.steps.whitened(o.landmarks, o.at[used], rows[used], weights)
        return corrected(o, found, white, ChosenObservations(used, weights), self.factor)

    @cached_property
    def _about_mean(self) -> LinearisedObservations:
        return self.observations.rows_at(self.mean)

    def _linear(self, error: Float[np.ndarray, " N"]) -> LinearisedObservations:
        o, n = self.observations, self.observations.layout.error_dim
        points = o.points + o.modes @ error[n : n + o.modes.shape[2]]
        return o.rows_at(o.layout.retract(self.mean, error[:n]), points)

    def _whitened(self, found: LinearisedObservations) -> Float[np.ndarray, "u d"]:
        """The used innovations, that were whitened by the sensor's noise alone."""
        o, used = self.observations, self.first.used
        rows = self._about_mean.rows[used]
        rows[..., -1] = found.rows[used, :, -1]
        return o.landmarks.steps.whitened(o.landmarks, o.at[used], rows, self.first.weights).rows[..., -1]
