"""Whitened rows of prior and steps, one factor at a time.

As `smoothing.motion` has them, and fast.
A peer's solver asks for one factor at a time, so everything here is written for short calls: a step costs some 70 us, of which
the process model's linearisation is half.
"""

import numpy as np
from jaxtyping import Float

from spinfilters.core.linear_algebra import dpotrf, dtrtrs
from spinfilters.filters.estimator import ProcessModel
from spinfilters.models.state_layout import StateLayout
from spinfilters.smoother.motion_factors import NOISE_FLOOR
from spinfilters.smoother.priors import FirstStatePrior

MOVING = 12
"""Error components of t, a, v, w, which lead the full layout."""
POSE = 6
"""Of them, t and a."""


def prior_rows(
    layout: StateLayout, first: Float[np.ndarray, " m"], prior: FirstStatePrior
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]:
    """Whitened residual of the first state, and its derivative.

    About the prior's mean; by the error about that state.
    """
    away = layout.local(prior.mean, first)
    by_first = np.linalg.inv(layout.reset_jacobian(away))
    return away / prior.std, by_first / prior.std[:, None]


def step_rows(
    process: ProcessModel, here: Float[np.ndarray, " m"], there: Float[np.ndarray, " m"], dt: float
) -> tuple[Float[np.ndarray, " r"], Float[np.ndarray, "r c"]]:
    """Whitened residual of one step of ``dt`` s, and its derivative.

    That is by the error of ``here`` (n) and the moving error of ``there`` (12), in this order. The covariance that
    whitens is linearised anew at ``here``; its own dependence on the state is not differentiated.
    """
    layout = process.layout
    moved, transition, noise = process.linearise(here, dt)
    defect = layout.local(there, moved)
    attitude = slice(POSE // 2, POSE)
    turn = np.linalg.inv(layout.reset_jacobian(defect)[attitude, attitude])
    n = transition.shape[1]
    rows = np.zeros((MOVING, n + MOVING + 1), order="F")
    rows[:, :n] = -transition[:MOVING]
    rows[attitude, :n] = turn @ rows[attitude, :n]
    rows.T.flat[n * MOVING : (n + MOVING) * MOVING : MOVING + 1] = 1.0
    rows[:, -1] = -defect[:MOVING]
    spread = noise[:MOVING].copy()
    spread[attitude] = turn @ spread[attitude]
    covariance = spread @ spread.T
    covariance.flat[:: MOVING + 1] += NOISE_FLOOR**2
    root, _ = dpotrf(covariance, lower=1)
    rows, _ = dtrtrs(root, rows, lower=1, overwrite_b=1)
    return rows[:, -1], rows[:, :-1]
