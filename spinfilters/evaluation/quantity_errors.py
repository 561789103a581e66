"""Errors of every quantity of a verdict at every epoch, in stated standard deviations."""

import numpy as np
from jaxtyping import Float

from spinfilters.evaluation.body import BodyEstimate
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.trajectory_errors import Alignment, BodyErrors
from spinfilters.state.quantities import ATTITUDE, AXES, CENTRE, MOMENTS, POSITION, RATE, VELOCITY


def quantity_errors(evaluation: Evaluation) -> dict[str, Float[np.ndarray, " n"]]:
    """Largest component of each quantity's error over its standard deviation, at the n own epochs with a truth.

    Of moments, axes and centre of mass the last epoch alone. Infinite where error or deviation are not finite; empty without a
    truth. A fit of both frames g hides errors of attitude and axes, which are left out then.
    """
    errors, begin = evaluation.errors, evaluation.own_begin
    own = None if errors is None or begin is None else errors.within(begin, np.inf)
    if own is None:
        return {}
    motion, fitted = evaluation.trajectory, evaluation.alignment is Alignment.BODY_FRAME
    pairs = {
        POSITION: (own.position, motion.std_position),
        ATTITUDE: (None if fitted else own.attitude, motion.std_attitude),
        VELOCITY: (own.velocity, motion.std_velocity),
        RATE: (own.rate, motion.std_rate),
    }
    found = {
        name: _largest(error, std[own.rows]) for name, (error, std) in pairs.items() if error is not None
    }
    body = evaluation.body_errors
    return found if body is None else found | _of_body(body, evaluation.body, fitted)


def _of_body(errors: BodyErrors, body: BodyEstimate, fitted: bool) -> dict[str, Float[np.ndarray, " n"]]:
    found = {}
    if errors.principal_moments is not None and errors.k1 is not None and errors.k2 is not None:
        away = [*errors.principal_moments[:2], errors.k1, errors.k2]
        std = [*body.principal_moments_std[:2], body.k1_std, body.k2_std]
        found[MOMENTS] = _largest(np.array([away]), np.array([std]))
    if errors.axes_angle is not None and not fitted:
        variances = np.square(body.principal_axes_std)  # an axis moves by turns about both others
        found[AXES] = _largest(
            errors.axes_angle[np.newaxis], np.sqrt(variances.sum() - variances)[np.newaxis]
        )
    if errors.center_of_mass_g is not None and body.center_of_mass_std is not None:
        found[CENTRE] = _largest(errors.center_of_mass_g[np.newaxis], body.center_of_mass_std[np.newaxis])
    return found


def _largest(error: Float[np.ndarray, "n c"], std: Float[np.ndarray, "n c"]) -> Float[np.ndarray, " n"]:
    with np.errstate(all="ignore"):
        value = np.abs(error / np.where(std > 0, std, np.nan)).max(axis=1)
    return np.where(np.isfinite(value), value, np.inf)
