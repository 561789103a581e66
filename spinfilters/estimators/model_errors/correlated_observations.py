"""Correlation of each landmark's residuals from one of its observations to the next.

Where errors are white it is minus what states and landmark take of both, a few per cent. Errors that last, of drifting features,
leave it near their own correlation rho, and weigh on slow states like white ones of (1 + rho) / (1 - rho) times the variance.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Int

from spinfilters.estimators.model_errors.linear_rows import LinearRows

POINT: Final = 3
"""Parameters that are a landmark's place, first among them."""


@dataclass(frozen=True)
class ObservationCorrelation:
    """From observation to observation.

    Attributes
    ----------
    value: correlation.   score: its standard deviations above zero.
    """

    value: float
    score: float

    @property
    def inflation(self) -> float:
        """Of the variance of slow states."""
        value = min(max(self.value, 0.0), 0.99)
        return (1 + value) / (1 - value)


def observation_correlation(rows: LinearRows) -> ObservationCorrelation | None:
    """Of all landmarks together, unknown ones or of a known map.

    None where there are none, or each is seen once.
    """
    left, products, squares, count = rows.residual(rows.right), 0.0, np.zeros(2), 0
    found: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    fit = rows.normal.eliminated
    if fit is not None and left.observations is not None:
        observations, used = fit.observations, fit.used
        found.append((observations.landmark[used], observations.epoch[used], left.observations[used, :, 0]))
    for sensor, rest in zip(rows.problem.motion.sensors, left.sensors, strict=True):
        if len(np.unique(sensor.epoch)) < len(sensor.epoch) and sensor.parameters.shape[1] >= POINT:
            landmark = np.unique(sensor.parameters[:, :POINT], axis=0, return_inverse=True)[1].ravel()
            counted = np.abs(rest[:, :, 0]).max(axis=1) > 0
            found.append((landmark[counted], sensor.epoch[counted], rest[counted, :, 0]))
    for landmark, epoch, rest in found:
        before, after = _neighbours(landmark, epoch)
        products += float(np.vdot(rest[before], rest[after]))
        squares += [np.vdot(rest[before], rest[before]), np.vdot(rest[after], rest[after])]
        count += len(before) * rest.shape[1]
    if not (count and np.all(squares > 0)):
        return None
    value = products / float(np.sqrt(squares[0] * squares[1]))
    return ObservationCorrelation(value, value * float(np.sqrt(count)))


def _neighbours(
    landmark: Int[np.ndarray, " n"], epoch: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
    """Pairs of observations of one landmark in neighbouring epochs."""
    order = np.lexsort((epoch, landmark))
    one, other = order[:-1], order[1:]
    near = (landmark[one] == landmark[other]) & (epoch[other] == epoch[one] + 1)
    return one[near], other[near]
