"""The Cramer-Rao bound in the quantities of the errors that it stands beside.

It is that of smoothing: of every frame given all measurements of the recording. A filter knows of a frame what came before, so
that its errors may lie well above it, except in the last frame and in what never changes.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.body import BodyEstimate, body_history
from spinfilters.evaluation.errors import BodyErrors, RmsErrors, TruthErrors, root_mean_square
from spinfilters.evaluation.trajectory import Trajectory, trajectory_of


@dataclass(frozen=True)
class ErrorBound:
    """Standard deviations that stand in the place of errors; None where there is no such error.

    Attributes
    ----------
    rms, rms_second_half: over the frames of the errors.   body: of what never changes.
    """

    rms: RmsErrors
    rms_second_half: RmsErrors
    body: BodyErrors


def error_bound(limits: EstimateHistory, errors: TruthErrors, fitted: bool) -> ErrorBound:
    """The bound of these errors.

    Parameters
    ----------
    limits: the truth with the bound's covariance, at the frames of the trajectory that has the errors.
    fitted: whether the frame g was fitted to the truth, which hides a part of the errors of the attitude and of the axes.
    """
    trajectory = trajectory_of(limits)
    return ErrorBound(
        _rms(trajectory, errors.rows, fitted),
        _rms(trajectory, errors.rows[errors.in_second_half], fitted),
        _body(body_history(limits).at(-1), fitted),
    )


def _rms(trajectory: Trajectory, rows: Int[np.ndarray, " n"], fitted: bool) -> RmsErrors:
    position = velocity = None
    if trajectory.sees_position:
        position = root_mean_square(trajectory.std_position[rows])
        velocity = root_mean_square(trajectory.std_velocity[rows])
    attitude = None if fitted else root_mean_square(trajectory.std_attitude[rows])
    return RmsErrors(position, attitude, velocity, root_mean_square(trajectory.std_rate[rows]))


def _body(body: BodyEstimate, fitted: bool) -> BodyErrors:
    """An axis moves by the turns about the other two."""
    turns = np.diag(body.principal_axes_cov)
    return BodyErrors(
        body.principal_moments_std,
        body.k1_std,
        body.k2_std,
        None if fitted else np.sqrt(turns.sum() - turns),
        None if fitted else body.center_of_mass_std,
    )
