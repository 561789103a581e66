"""Errors in stated standard deviations: of every quantity over time, and of the published estimate at the end."""

from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.evaluation.consistency import knows_state, true_states
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.trajectory_errors import Alignment, common_stamps
from spinfilters.models.state_blocks import MASS_DISTRIBUTION
from spinfilters.models.status import ATTITUDE, AXES, CENTRE, MOMENTS, POSITION, RATE, VELOCITY

LARGEST_STATED_ERROR: Final = 4.0
"""Stated standard deviations, beyond which an error belies the verdict ``ok``."""
RATIOS: Final = "ratios"
"""Name of the errors of k1 and k2."""


def stated_errors(evaluation: Evaluation) -> dict[str, float]:
    """Largest error component of each published quantity after the last epoch, in its stated standard deviations.

    Parameters
    ----------
    evaluation : Evaluation
        Compared with a truth; without one there are no errors.

    Returns
    -------
    dict[str, float]
        By the name of a block of the state (without the mass distribution, which no file holds), and "moments", "ratios"
        and "axes"; infinite where error or deviation are not finite.
    """
    return _block_errors(evaluation) | {
        name: error for name, error in _body_errors(evaluation).items() if name != CENTRE
    }


def quantity_errors(evaluation: Evaluation) -> dict[str, Float[np.ndarray, " n"]]:
    """Largest error component of each quantity in its stated standard deviations, at the n own epochs with a truth.

    Parameters
    ----------
    evaluation : Evaluation
        Compared with a truth; without one there are no errors.

    Returns
    -------
    dict[str, (n,) float array]
        By the quantities of `spinfilters.models.status`; of moments, axes and centre of mass after the last epoch alone.
        Infinite where error or deviation are not finite. A fit of both frames g hides errors of attitude and axes, which
        are left out then.
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
    body = _body_errors(evaluation)
    if RATIOS in body:
        body[MOMENTS] = max(body[MOMENTS], body.pop(RATIOS))
    return found | {name: np.array([error]) for name, error in body.items()}


def _block_errors(evaluation: Evaluation) -> dict[str, float]:
    """Errors of the state after the last epoch by block, where the truth holds every block."""
    history, layout, error = evaluation.history, evaluation.history.layout, evaluation.last_error
    if error is None:
        truth = evaluation.truth
        if truth is None or not knows_state(truth, layout):
            return {}
        _, rows = common_stamps(history.time[-1:], truth.time)
        true = evaluation.truth_in_own_frames_at(rows)
        if true is None:
            return {}
        if not np.isfinite(history.mean[-1]).all():
            return {"state": np.inf}
        error = layout.local(history.mean[-1], true_states(true, layout)[0])
    std = np.linalg.norm(history.factor[-1], axis=1)
    shares = _shares(error, std)
    named = [block for block in layout.blocks if block != MASS_DISTRIBUTION.name]
    return {block: shares[layout.slice(block)].max().item() for block in named}


def _body_errors(evaluation: Evaluation) -> dict[str, float]:
    """Errors of the mass properties after the last epoch."""
    errors, body = evaluation.body_errors, evaluation.body
    if errors is None:
        return {}
    pairs = {}
    if errors.principal_moments is not None and errors.k1 is not None and errors.k2 is not None:
        pairs[MOMENTS] = errors.principal_moments[:2], body.principal_moments_std[:2]
        pairs[RATIOS] = np.array([errors.k1, errors.k2]), np.array([body.k1_std, body.k2_std])
    if errors.axes_angle is not None and evaluation.alignment is not Alignment.BODY_FRAME:
        variances = np.square(body.principal_axes_std)  # an axis moves by rotations about both others
        pairs[AXES] = errors.axes_angle, np.sqrt(variances.sum() - variances)
    if errors.center_of_mass_g is not None and body.center_of_mass_std is not None:
        pairs[CENTRE] = errors.center_of_mass_g, body.center_of_mass_std
    return {name: _largest(*pair).item() for name, pair in pairs.items()}


def _largest(error: Float[np.ndarray, "*n c"], std: Float[np.ndarray, "*n c"]) -> Float[np.ndarray, "*n"]:
    return _shares(error, std).max(axis=-1)


def _shares(error: Float[np.ndarray, "*n"], std: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Errors in standard deviations, infinite where that is not a finite number."""
    with np.errstate(all="ignore"):
        value = np.abs(error / np.where(std > 0, std, np.nan))
    return np.where(np.isfinite(value), value, np.inf)
