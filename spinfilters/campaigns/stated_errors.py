"""Errors of the last epoch in stated standard deviations.

They tell whether an estimate that is called ``ok`` is right.
"""

from typing import Final

import numpy as np

from spinfilters.data.truth import Truth
from spinfilters.evaluation.consistency import knows_state, true_states
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.trajectory_errors import Alignment, common_stamps
from spinfilters.evaluation.truth_frames import truth_in_first_frame, truth_in_inertial_frame
from spinfilters.state.blocks.rigid_body import MASS_DISTRIBUTION

LARGEST: Final = 4.0
"""Stated standard deviations, beyond which an error belies the verdict ``ok``."""


def stated_errors(evaluation: Evaluation, truth: Truth) -> dict[str, float]:
    """Largest error component of each quantity in stated standard deviations; infinite if not finite.

    Blocks of the state by name (without the mass distribution, which no file tells), ``moments``, ``ratios``, ``axes``.
    """
    with np.errstate(all="ignore"):
        found = _block_errors(evaluation, truth) | _body_errors(evaluation)
    return {name: value if np.isfinite(value) else np.inf for name, value in found.items()}


def _block_errors(evaluation: Evaluation, truth: Truth) -> dict[str, float]:
    history = evaluation.history
    layout = history.layout
    if evaluation.alignment is Alignment.FIRST_FRAME:
        truth = truth_in_first_frame(history, truth)
    if evaluation.alignment is Alignment.INERTIAL_FRAME:
        truth = truth_in_inertial_frame(history, truth)
    if evaluation.alignment is Alignment.BODY_FRAME or not knows_state(truth, layout):
        return {}
    _, rows = common_stamps(history.time[-1:], truth.time)
    if not np.isfinite(history.mean[-1]).all():
        return {"state": np.inf}
    error = layout.local(history.mean[-1], true_states(truth, layout)[rows[0]])
    std = np.linalg.norm(history.factor[-1], axis=1)
    named = [block for block in layout.blocks if block != MASS_DISTRIBUTION.name]
    return {block: float(np.max(np.abs(error / std)[layout.slice(block)])) for block in named}


def _body_errors(evaluation: Evaluation) -> dict[str, float]:
    errors, body = evaluation.body_errors, evaluation.body
    if errors is None:
        return {}
    found: dict[str, float] = {}
    if errors.principal_moments is not None:
        found["moments"] = float(np.max(np.abs(errors.principal_moments / body.principal_moments_std)[:2]))
    if errors.k1 is not None and errors.k2 is not None:
        found["ratios"] = float(np.max(np.abs(np.array([errors.k1, errors.k2]) / [body.k1_std, body.k2_std])))
    if errors.axes_angle is not None and evaluation.alignment is not Alignment.BODY_FRAME:
        variances = np.square(body.principal_axes_std)
        found["axes"] = float(np.max(errors.axes_angle / np.sqrt(variances.sum() - variances)))
    return found
