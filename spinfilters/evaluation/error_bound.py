"""Cramer-Rao bound in the quantities of the trajectory errors.

It is that of smoothing: of every epoch given all measurements of the recording. A filter knows of an epoch what came before, so
that its errors may lie well above it, except in the last epoch and in what never changes.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.body import BodyEstimate
from spinfilters.evaluation.estimated_motion import Trajectory, body_history, trajectory_of
from spinfilters.evaluation.trajectory_errors import BodyErrors, RmsErrors, TruthErrors, root_mean_square


@dataclass(frozen=True)
class ErrorBound:
    """Standard deviations of the bound per error; None where there is no such error.

    Attributes
    ----------
    trajectory: of the truth, with the bound's standard deviations.   rows: epochs of it that have errors.   body: of constants.
    fitted: whether the frame g was fitted to the truth, which hides a part of the errors of the attitude and of the axes.
    """

    trajectory: Trajectory
    rows: Int[np.ndarray, " n"]
    body: BodyErrors
    fitted: bool

    @property
    def rms(self) -> RmsErrors:
        """Root mean square of the bound over all epochs of the errors."""
        return self.over(self.rows)

    def over(self, rows: Int[np.ndarray, " n"]) -> RmsErrors:
        """Root mean square of the bound over some epochs."""
        bound, position, velocity = self.trajectory, None, None
        if bound.sees_position:
            position = root_mean_square(bound.std_position[rows])
            velocity = root_mean_square(bound.std_velocity[rows])
        attitude = None if self.fitted else root_mean_square(bound.std_attitude[rows])
        return RmsErrors(position, attitude, velocity, root_mean_square(bound.std_rate[rows]))


def error_bound(limits: EstimateHistory, errors: TruthErrors, fitted: bool) -> ErrorBound:
    """The bound of these errors.

    Parameters
    ----------
    limits: the truth with the bound's covariance, at the epochs of the trajectory that has the errors.
    fitted: see `ErrorBound`.
    """
    body = _body(body_history(limits, intervals=False).at(-1), fitted)
    return ErrorBound(trajectory_of(limits), errors.rows, body, fitted)


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
