"""Estimates of a window and of a coming epoch, with covariances.

From the window's normal equations.
"""

import numpy as np
from jaxtyping import Float, Int

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import ProcessModel
from spinfilters.estimators.landmarks.belief import LandmarkBelief
from spinfilters.estimators.landmarks.landmark_options import LandmarkOptions
from spinfilters.estimators.smoothing.joint_belief import joint_belief
from spinfilters.estimators.smoothing.linear.marginals import Marginals, latest_factor
from spinfilters.estimators.smoothing.problem.least_squares import NormalEquations
from spinfilters.estimators.smoothing.state_prior import StatePrior
from spinfilters.estimators.smoothing.window.smoother_records import MarginalizedState
from spinfilters.estimators.smoothing.window.smoother_window import Window
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import StateLayout


def latest_belief(layout: StateLayout, window: Window, normal: NormalEquations) -> Gaussian:
    """Belief of the latest epoch; its factor is NaN where something is not determined."""
    solution, n = normal.solution, layout.error_dim
    factor = np.full((n, n), np.nan) if solution is None else latest_factor(solution)
    return Gaussian(layout, window.trajectory[-1], factor)


def joint_latest_belief(
    normal: NormalEquations,
    mean: Float[np.ndarray, " m"],
    ids: Int[np.ndarray, " L"],
    points: Float[np.ndarray, "L 3"],
    options: LandmarkOptions,
) -> LandmarkBelief | None:
    """Belief of the latest epoch and of all well-constrained landmarks; None without any."""
    if normal.solution is None or normal.eliminated is None:
        return None
    constrained = normal.eliminated.is_constrained
    if not constrained.any():
        return None
    marginals = Marginals(normal.solution, normal.eliminated)
    return joint_belief(marginals, mean, ids[constrained], points[constrained], options)


def window_marginals(
    layout: StateLayout, window: Window, normal: NormalEquations, epochs: int | None
) -> list[MarginalizedState]:
    """Marginals of the epochs of a window: of all, or of so many of the oldest."""
    solution, n = normal.solution, layout.error_dim
    count = len(window.epochs) if epochs is None else epochs
    if solution is None:
        factors = np.full((count, n, n), np.nan)
    else:
        gone = solution.ordering.epochs - len(window.epochs)
        factors = Marginals(solution, None).first_factors(gone + count)[gone:]
    rows = zip(window.epochs[:count], window.trajectory, factors, strict=False)
    return [MarginalizedState(epoch.time, mean, factor) for epoch, mean, factor in rows]


def predicted_state(
    process: ProcessModel,
    prior: StatePrior,
    window: Window,
    time: float,
    pose: Float[np.ndarray, " 7"] | None = None,
) -> Float[np.ndarray, " m"]:
    """Initial state of a new epoch.

    Predicted from the latest, or the prior's mean; at a pose (t m, q_ig) where one is given.
    """
    if window.epochs:
        latest = window.epochs[-1].time
        if not time > latest:
            raise InputError(f"time goes from {latest} s to {time} s; epochs must be in the order of time")
        state = process.step(window.trajectory[-1], time - latest)
    else:
        state = prior.mean.copy()
    if pose is not None:
        state[process.layout.mean_slice("t")], state[process.layout.mean_slice("a")] = pose[:3], pose[3:]
    return state
