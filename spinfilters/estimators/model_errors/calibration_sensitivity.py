"""Sensitivity of a smoothed motion to the given calibration (Schmidt 1966).

A parameter of the calibration, were it larger by e, would change the whitened right-hand side of the linear problem by H e. The
solution moves by S e with S = P J'H, from the same factors that solve for the states; its covariance is P + S P_c S'.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from spinfilters.data.consider_parameter import ConsideredDeviation, ConsiderParameter, Displaced
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.displaced_camera import KnownCamera, displaced_camera
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.estimators.model_errors.solved_columns import Sensitivity


def smoothed_sensitivity(motion: SmoothedMotion, considered: Sequence[ConsideredDeviation]) -> Sensitivity:
    """Errors of states and landmarks by each independent error of the calibration, times its deviation."""
    return motion.rows.sensitivity(_columns(motion, considered))


def told_information(
    motion: SmoothedMotion, considered: Sequence[ConsideredDeviation]
) -> Float[np.ndarray, "c c"]:
    """Information of residuals about errors of the calibration, H'M H, each in its deviations."""
    left = motion.rows.residual(_columns(motion, considered))
    return left.gram(left)


def told_moments(
    motion: SmoothedMotion, considered: Sequence[ConsideredDeviation]
) -> Float[np.ndarray, "c c"]:
    """Second moments of errors of the calibration about none, given the residuals, each in its deviations.

    With the information F and the score u = H'M y the covariance is (I + F)^-1 and the mean e = (I + F)^-1 u. The estimates are of
    no error, so that their own errors have the mean in them: the moments are (I + F)^-1 + e e'.
    """
    columns = _columns(motion, considered)
    left = motion.rows.residual(columns)
    covariance = np.linalg.inv(np.eye(columns.count) + left.gram(left))
    e = covariance @ columns.gram(motion.rows.left)[:, 0]
    return covariance + np.outer(e, e)


def _columns(motion: SmoothedMotion, considered: Sequence[ConsideredDeviation]) -> Columns:
    return Columns.joined(
        [calibration_columns(motion, each.parameter).scaled(each.std) for each in considered]
    )


def calibration_columns(motion: SmoothedMotion, parameter: ConsiderParameter) -> Columns:
    """Derivative of the whitened right-hand side by the calibration.

    Per unit of a parameter, a column for each of its errors.
    """
    if parameter.of_clock:
        return motion.longer()
    if parameter.displaced is not None:
        return _of_inspector(motion, parameter.displaced, parameter.size)
    found = motion.shifted(lambda each: each.by_calibration(parameter))
    return motion.rows.nothing(parameter.size) if found is None else found


def _of_inspector(motion: SmoothedMotion, displaced: Displaced, size: int) -> Columns:
    """Were the poses displaced: what is expected then is subtracted."""
    camera = KnownCamera.of(motion)
    if camera is None:
        return motion.rows.nothing(size)
    return displaced_camera(motion, displaced, camera).scaled(-1.0)
