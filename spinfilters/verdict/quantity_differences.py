"""Differences of two estimates in every quantity of a verdict, with both deviations."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import inverse, multiply, rotation_vector_from_quaternion
from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.body import BodyEstimate, body_estimate
from spinfilters.evaluation.estimated_motion import trajectory_of
from spinfilters.state.quantities import ATTITUDE, AXES, CENTRE, MOMENTS, POSITION, RATE, VELOCITY


@dataclass(frozen=True)
class QuantityDifference:
    """Another estimate minus one, in a quantity's own units.

    Attributes
    ----------
    away : (n, c) float array
        Difference at n epochs; at the last epoch alone of what is constant.
    std, other_std : (n, c) float arrays
        Standard deviations of the one and of the other.
    """

    away: Float[np.ndarray, "n c"]
    std: Float[np.ndarray, "n c"]
    other_std: Float[np.ndarray, "n c"]

    @property
    def largest(self) -> float:
        """Largest difference in deviations of the one; infinite where a difference or a deviation is not a number."""
        value = float(np.max(np.abs(self.away) / np.where(self.std == 0, np.inf, self.std)))
        return value if np.isfinite(value) else float("inf")

    @property
    def expected_squares(self) -> Float[np.ndarray, "n c"]:
        """Squared errors that the one is expected to have in its deviations, with the other as the truth."""
        squares = (self.away**2 + self.other_std**2) / np.where(self.std > 0, self.std, np.nan) ** 2
        return np.where(np.isfinite(squares), squares, np.inf)


def quantity_differences(one: EstimateHistory, other: EstimateHistory) -> dict[str, QuantityDifference]:
    """Differences of two histories of the same epochs and layout, by quantity."""
    a, b = trajectory_of(one), trajectory_of(other)
    turn = rotation_vector_from_quaternion(multiply(inverse(a.q_ig), b.q_ig))
    found = {
        ATTITUDE: QuantityDifference(turn, a.std_attitude, b.std_attitude),
        RATE: QuantityDifference(b.rate_i - a.rate_i, a.std_rate, b.std_rate),
    }
    if a.sees_position:
        found[POSITION] = QuantityDifference(b.position - a.position, a.std_position, b.std_position)
        found[VELOCITY] = QuantityDifference(b.velocity - a.velocity, a.std_velocity, b.std_velocity)
    return found | _of_body(body_estimate(one.belief(-1)), body_estimate(other.belief(-1)))


def _of_body(one: BodyEstimate, other: BodyEstimate) -> dict[str, QuantityDifference]:
    R = one.principal_axes_g @ other.principal_axes_g.T
    R = R * np.sign(np.diag(R))[np.newaxis]  # an axis has no direction
    turn = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    found = {
        MOMENTS: _constant(_shape(other) - _shape(one), _shape_std(one), _shape_std(other)),
        AXES: _constant(turn, one.principal_axes_std, other.principal_axes_std),
    }
    centres = one.center_of_mass_g, one.center_of_mass_std, other.center_of_mass_g, other.center_of_mass_std
    here, here_std, there, there_std = centres
    if here is not None and here_std is not None and there is not None and there_std is not None:
        found[CENTRE] = _constant(there - here, here_std, there_std)
    return found


def _constant(
    away: Float[np.ndarray, " c"], std: Float[np.ndarray, " c"], other_std: Float[np.ndarray, " c"]
) -> QuantityDifference:
    return QuantityDifference(away[np.newaxis], std[np.newaxis], other_std[np.newaxis])


def _shape(body: BodyEstimate) -> Float[np.ndarray, "4"]:
    """Moments that are not 1 by definition, and log ratios."""
    return np.array([*body.principal_moments[:2], body.k1, body.k2])


def _shape_std(body: BodyEstimate) -> Float[np.ndarray, "4"]:
    return np.array([*body.principal_moments_std[:2], body.k1_std, body.k2_std])
