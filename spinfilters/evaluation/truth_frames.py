"""The truth told in the frames of an estimate that defines its own."""

from dataclasses import replace
from typing import Final

import numpy as np

from spinfilters.attitude.conversions import inverse, multiply, rotate
from spinfilters.data.truth import Truth
from spinfilters.errors import InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.trajectory_errors import (
    TIME_TOLERANCE,
    Alignment,
    attitude_alignment,
    common_stamps,
)
from spinfilters.geometry.truth_frame import truth_in_moved_frame
from spinfilters.state.layout import POSE_BLOCKS

DEFINED_STD: Final[float] = 1e-4
"""Largest standard deviation (m, rad) of a pose that is a definition: well above any such prior, well below any measurement."""


def tells_first_frame(history: EstimateHistory, truth: Truth) -> bool:
    """Whether `Alignment.FIRST_FRAME` applies.

    The estimate must hold the pose of g at its first frame as a definition, without doubt (`DEFINED_STD`): a pose that was
    measured there would hand its error on to everything after. The truth must tell that pose: a row at the time of the first
    frame, and the centre of mass in its own g.
    """
    layout = history.layout
    if not layout.translates or truth.center_of_mass_g is None:
        return False
    doubt = max(np.linalg.norm(history.factor[0, layout.slice(b)], axis=1).max() for b in POSE_BLOCKS)
    told = doubt <= DEFINED_STD and np.isfinite(history.mean[0]).all()
    return bool(told and np.abs(truth.time - history.time[0]).min() <= TIME_TOLERANCE)


def truth_in_first_frame(history: EstimateHistory, truth: Truth) -> Truth:
    """The truth in the g of the estimate.

    The g that has the estimated pose at the history's first frame.
    With T = (R_ig, t) and t = r - R_ig c the transformation from the estimate's g to that of the truth is
    T_true(0)^-1 T_estimate(0); attitude, principal axes and centre of mass of the truth are expressed with it.

    Raises
    ------
    InputError: when `tells_first_frame` is False.
    """
    if not tells_first_frame(history, truth) or truth.center_of_mass_g is None:
        raise InputError(
            "the first frame does not tell how the frames g of estimate and truth differ; give center_of_mass_g in truth.toml, a "
            f"true pose at {history.time[0]:.6f} s and an estimate that defines g there, or use {Alignment.BODY_FRAME.name}"
        )
    row, layout, first = common_stamps(history.time[:1], truth.time)[1][0], history.layout, history.mean[0]
    q_true, q_first = truth.q_ig[row], first[layout.mean_slice("a")]
    turn = multiply(inverse(q_true), q_first)
    from_origin = truth.center_of_mass[row] - first[layout.mean_slice("t")]
    return truth_in_moved_frame(truth, turn, truth.center_of_mass_g - rotate(inverse(q_true), from_origin))


def truth_in_inertial_frame(history: EstimateHistory, truth: Truth) -> Truth:
    """The truth in the inertial frame of a rotation-only estimate.

    R_i'i from both attitudes of one body.
    At the first frame where both have it and the estimate defines its attitude there, over all common frames otherwise.

    Raises
    ------
    InputError: when no time stamp is common, or the estimate is finite at none.
    """
    rows, true_rows = common_stamps(history.time, truth.time)
    layout = history.layout
    q = history.mean[rows, layout.mean_slice("a")]
    finite = np.isfinite(q).all(axis=1)
    if not finite.any():
        raise InputError("the estimate is finite at no time stamp of the truth; it has no errors")
    q, q_true = q[finite], truth.q_ig[true_rows[finite]]
    doubt = np.linalg.norm(history.factor[rows[finite][0], layout.slice("a")], axis=1).max()
    defined = doubt <= DEFINED_STD
    turn = (
        multiply(q[0], inverse(q_true[0]))
        if defined
        else inverse(attitude_alignment(inverse(q), inverse(q_true)))
    )
    return replace(
        truth,
        center_of_mass=rotate(turn, truth.center_of_mass),
        q_ig=multiply(turn, truth.q_ig),
        velocity=rotate(turn, truth.velocity),
        rate_i=rotate(turn, truth.rate_i),
    )
