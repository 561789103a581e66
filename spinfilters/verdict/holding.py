"""What still holds of an estimate: each quantity ok, doubtful or not determined.

A quantity holds where it is determined and no failed check is about it. Checks that cannot tell which quantities an error reaches
are about all of them. Where a score test names an error of the models, it also tells how far each quantity moves once the error is
removed, and those hold that move little (`moved_quantities`).
"""

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.estimators.history import EPOCH_ARRAYS, EstimateHistory
from spinfilters.evaluation.body import UNDETERMINED_STD
from spinfilters.evaluation.estimated_motion import trajectory_of
from spinfilters.state.quantities import (
    ALL,
    ATTITUDE,
    AXES,
    CENTRE,
    MOMENTS,
    POSITION,
    QUANTITIES,
    RATE,
    VELOCITY,
)
from spinfilters.state.status import EstimatorStatus, Holds, Verdict
from spinfilters.verdict.checks import check_of
from spinfilters.verdict.estimate_tests import LARGEST_MOMENT_STD
from spinfilters.verdict.evidence import Evidence

LARGEST_ANGLE_STD: Final = 0.5
"""Of an attitude or a principal axis, rad: beyond it its direction is not known; of nothing known it is `UNDETERMINED_STD`."""
LARGEST_SHARE: Final = 0.5
"""Of a deviation to the size of what it is about (the rate; the path, its length and its distance; the centre's prior)."""

MOST_EPOCHS: Final = 200
"""Of an estimate that are looked at."""

assert LARGEST_ANGLE_STD < UNDETERMINED_STD


def holding(evidence: Evidence, status: EstimatorStatus) -> dict[str, Holds]:
    """Whether each quantity holds, given what was found.

    Nothing of a failed estimate does.
    """
    if status.verdict is Verdict.FAILED:
        return dict.fromkeys(QUANTITIES, Holds.NOT_DETERMINED)
    determined = determined_quantities(evidence)
    holds = {name: Holds.OK if name in determined else Holds.NOT_DETERMINED for name in QUANTITIES}
    for found in status.findings:
        check = check_of(found)
        for name in check.about if found.about is None else found.about:
            # what a finding is about beyond its check follows from what is not determined, and is doubtful
            state = check.leaves if name in check.about or not check.about else Holds.DOUBTFUL
            if state is Holds.NOT_DETERMINED or holds[name] is Holds.OK:
                holds[name] = state
    return holds


def determined_quantities(evidence: Evidence) -> frozenset[str]:
    """Quantities whose stated deviation, the largest of its components, is small enough to mean something.

    Of what moves the median over the estimator's own epochs counts, of what is constant the last epoch.
    """
    evaluation = evidence.evaluation
    body, motion = evaluation.body, trajectory_of(some_epochs(evaluation.history))
    duration = float(motion.time[-1] - motion.time[0]) if len(motion.time) > 1 else 0.0
    rate = float(np.median(np.linalg.norm(motion.rate_i, axis=1)))
    reached = float(np.max(np.linalg.norm(motion.position, axis=1)))
    rate_std, velocity_std = _typical(motion.std_rate), _typical(motion.std_velocity)
    found = {
        ATTITUDE: _typical(motion.std_attitude) < LARGEST_ANGLE_STD,
        # a body at rest is known to be so where it cannot have turned meanwhile
        RATE: rate_std < LARGEST_SHARE * rate or rate_std * duration < LARGEST_ANGLE_STD,
        MOMENTS: float(np.max(body.principal_moments_std)) <= LARGEST_MOMENT_STD,
        AXES: float(np.max(body.principal_axes_std)) < LARGEST_ANGLE_STD,
    }
    if motion.sees_position:
        found[POSITION] = _typical(motion.std_position) < LARGEST_SHARE * reached
        found[VELOCITY] = velocity_std * duration < LARGEST_SHARE * max(
            reached, _length(motion.velocity, duration)
        )
    if body.center_of_mass_std is not None:
        found[CENTRE] = float(np.max(body.center_of_mass_std)) < LARGEST_SHARE * evidence.centre_prior_std
    return frozenset(name for name, known in found.items() if known) & ALL


def some_epochs(history: EstimateHistory) -> EstimateHistory:
    """A history of at most `MOST_EPOCHS` of the estimator's own epochs, evenly spread, the last among them."""
    return history_at(history, own_rows(history))


def own_rows(history: EstimateHistory) -> Int[np.ndarray, " k"]:
    """Indices of these epochs."""
    last = len(history.time) - 1
    return np.unique(np.linspace(min(history.initialisation, last), last, MOST_EPOCHS).round().astype(int))


def history_at(history: EstimateHistory, rows: Int[np.ndarray, " k"]) -> EstimateHistory:
    """A history of some epochs, its covariance alone."""
    return replace(
        history,
        **{name: getattr(history, name)[rows] for name in EPOCH_ARRAYS},
        calibration=None,
        observations=None,
        initialisation=0,
    )


def _typical(std: Float[np.ndarray, "n 3"]) -> float:
    """Median over the epochs of the largest component; infinite where it is not finite."""
    value = float(np.median(std.max(axis=1)))
    return value if np.isfinite(value) else float("inf")


def _length(velocity: Float[np.ndarray, "n 3"], duration: float) -> float:
    return float(np.median(np.linalg.norm(velocity, axis=1))) * duration
