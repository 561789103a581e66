"""Sensitivity of a smoothed motion to the given calibration (Schmidt 1966).

A parameter of the calibration, were it larger by e, would change the whitened right-hand side of the linear problem by H e. The
solution moves by S e with S = P J'H, from the same factors that solve for the states; its covariance is P + S P_c S'.
"""

from collections.abc import Sequence

from spinfilters.data.consider_parameter import ConsideredDeviation, ConsiderParameter
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.estimators.model_errors.solved_columns import Sensitivity


def smoothed_sensitivity(motion: SmoothedMotion, considered: Sequence[ConsideredDeviation]) -> Sensitivity:
    """Errors of states and landmarks by each independent error of the calibration, times its deviation."""
    right = [calibration_columns(motion, each.parameter).scaled(each.std) for each in considered]
    return motion.rows.sensitivity(Columns.joined(right))


def calibration_columns(motion: SmoothedMotion, parameter: ConsiderParameter) -> Columns:
    """Derivative of the whitened right-hand side by the calibration.

    Per unit of a parameter, a column for each of its errors.
    """
    if parameter.moved is None:
        return motion.longer()
    found = motion.shifted(lambda each: each.by_calibration(parameter))
    return motion.rows.nothing(parameter.size) if found is None else found
