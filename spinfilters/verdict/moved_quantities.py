"""Quantities that an error of the models moves, in stated standard deviations.

Once an error is removed, the states of all epochs move by a shift that its score test gives (`ScoreTest.shift`). The quantities
that are published follow from states moved so, and their movement over their own deviations is the error that the models have put
into them.
"""

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import inverse, multiply, rotation_vector_from_quaternion
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.model_errors.score_test import ScoreTest
from spinfilters.evaluation.body import BodyEstimate, body_estimate
from spinfilters.evaluation.estimated_motion import trajectory_of
from spinfilters.state.quantities import (
    ALL,
    ATTITUDE,
    AXES,
    CENTRE,
    MOMENTS,
    NOTHING,
    POSITION,
    RATE,
    VELOCITY,
)
from spinfilters.verdict.holding import history_at

LARGEST_MOVE: Final = 1.0
"""Of a quantity that still holds, in its deviations. An error that is normal about a mean of one deviation is beyond four with a
probability of 0.13 %; the size of the error is not known better than its own deviation, which `SIZE_STD` allows for."""
SIZE_STD: Final = 2.0
"""Deviations of an error's size by which it may be larger than it seems."""
LINEAR: Final = 30.0
"""Deviations by which any component of the state moves, beyond which the linearised motion does not tell what an error does."""


def unmoved_quantities(history: EstimateHistory, test: ScoreTest) -> frozenset[str]:
    """Quantities of an estimate that removing an error moves by less than `LARGEST_MOVE`.

    None where the shift is not known, or too large for a linearisation.
    """
    shift = test.shift
    if shift is None or not np.isfinite(shift).all() or len(shift) > len(history.time):
        return NOTHING
    size = float(np.linalg.norm(test.size))
    std = float(np.sqrt(test.std**2 @ test.size**2)) / max(size, np.finfo(float).tiny)
    larger = 1.0 + SIZE_STD * std / max(size, np.finfo(float).tiny)
    moved = moved_quantities(history, shift)
    if not max(moved.values()) <= LINEAR:
        return NOTHING
    return frozenset(name for name in ALL if larger * moved.get(name, 0.0) <= LARGEST_MOVE)


def moved_quantities(history: EstimateHistory, shift: Float[np.ndarray, "k n"]) -> dict[str, float]:
    """Largest movement of every quantity over components and the first k epochs, in its deviations.

    Of what is constant that of the last of these epochs.
    """
    here = history_at(history, np.arange(len(shift)))
    with np.errstate(all="ignore"):
        there = replace(here, mean=here.layout.retract(here.mean, shift))
        before, after = trajectory_of(here), trajectory_of(there)
        angles = rotation_vector_from_quaternion(multiply(inverse(before.q_ig), after.q_ig))
        found = {
            ATTITUDE: _largest(angles, before.std_attitude),
            RATE: _largest(after.rate_i - before.rate_i, before.std_rate),
        }
        if before.sees_position:
            found[POSITION] = _largest(after.position - before.position, before.std_position)
            found[VELOCITY] = _largest(after.velocity - before.velocity, before.std_velocity)
        return found | _of_body(body_estimate(here.belief(-1)), body_estimate(there.belief(-1)))


def _of_body(before: BodyEstimate, after: BodyEstimate) -> dict[str, float]:
    away = np.append(
        after.principal_moments[:2] - before.principal_moments[:2],
        [after.k1 - before.k1, after.k2 - before.k2],
    )
    std = np.append(before.principal_moments_std[:2], [before.k1_std, before.k2_std])
    R = before.principal_axes_g @ after.principal_axes_g.T
    R = R * np.sign(np.diag(R))[np.newaxis]  # an axis has no direction
    turn = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    found = {MOMENTS: _largest(away, std), AXES: _largest(turn, before.principal_axes_std)}
    if (
        before.center_of_mass_g is not None
        and after.center_of_mass_g is not None
        and before.center_of_mass_std is not None
    ):
        found[CENTRE] = _largest(after.center_of_mass_g - before.center_of_mass_g, before.center_of_mass_std)
    return found


def _largest(away: np.ndarray, std: np.ndarray) -> float:
    """Largest of deviations; infinite where one is not finite."""
    value = float(np.max(np.abs(away) / np.where(std > 0, std, np.inf)))
    return value if np.isfinite(value) else float("inf")
