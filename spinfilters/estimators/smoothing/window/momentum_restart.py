"""Restart from conserved angular momentum while the inertia is poorly known."""

from functools import partial

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.smoothing.closed_form import MASS_SHARES, MOMENTUM_BLOCKS, initial_state
from spinfilters.estimators.smoothing.initial_motion import initial_motion
from spinfilters.estimators.smoothing.linear.schur_system import SchurSystem
from spinfilters.estimators.smoothing.problem.least_squares import (
    LinearizationPoint,
    LinearProblem,
    Problem,
    Stage,
)
from spinfilters.estimators.smoothing.solver.annealing import GATE, AnnealedSchedule
from spinfilters.estimators.smoothing.solver.iterations import SolverOptions, solve
from spinfilters.estimators.smoothing.window.restart_schedule import fits
from spinfilters.estimators.smoothing.window.smoother_window import Window
from spinfilters.sensors.sensor import MotionSamples
from spinfilters.state.layout import POSE_BLOCKS, StateLayout

ITERATIONS = 15
"""From where it points to, with an annealed schedule."""
MARGIN, KNOWN = 1.0, 0.5
"""Of the cost: by how much another optimum must fit better, and how close to the present one a point leads to no other."""


def restarted_from_momentum(
    problem: Problem, window: Window, linear: LinearProblem
) -> tuple[LinearizationPoint | None, int]:
    """Better-fitting point from the closed form, or None; and linearisations used.

    Parameters
    ----------
    window: at its present optimum.   linear: the last linear problem on the way to it.
    """
    layout, here, candidates, count = problem.layout, window.trajectory, [], 0
    if not layout.translates or problem.observations is None:
        return None, 0
    trajectory = trajectory_from_momentum(layout, here, np.array([epoch.time for epoch in window.epochs]))
    if trajectory is None:
        return None, 0
    optimum = linear.normal.solution if fits(linear.point, linear.normal) else None
    is_known = partial(_leads_to, optimum, layout, here)
    for share in MASS_SHARES:
        start = trajectory.copy()
        start[:, layout.mean_slice("s")] *= share
        at, schedule = problem.at(start, window.points), AnnealedSchedule(problem, ITERATIONS, GATE)
        found = solve(problem, at, SolverOptions(ITERATIONS), schedule, is_known=is_known)
        count += found.linearisations
        if is_known(found.point):
            break
        candidates.append(found.point)
        if fits(found.point, found.normal):
            break
    return _best(problem, window, candidates, linear.normal.stage), count


def _leads_to(
    optimum: SchurSystem | None,
    layout: StateLayout,
    trajectory: Float[np.ndarray, "k m"],
    point: LinearizationPoint,
) -> bool:
    """Whether iterations from a point would end at an optimum that fits, so close is it."""
    return optimum is not None and optimum.rise(layout.local(trajectory, point.trajectory)) < KNOWN


def _best(
    problem: Problem, window: Window, candidates: list[LinearizationPoint], stage: Stage
) -> LinearizationPoint | None:
    """The candidate of least cost, if it fits better than the window does."""
    if not candidates:
        return None
    costs = np.nan_to_num([point.robust_cost(stage) for point in candidates], nan=np.inf)
    best = int(np.argmin(costs))
    now = problem.at(window.trajectory, window.points).robust_cost(stage)
    return candidates[best] if costs[best] < now - MARGIN else None


def trajectory_from_momentum(
    layout: StateLayout, given: Float[np.ndarray, "k m"], times: Float[np.ndarray, " k"]
) -> Float[np.ndarray, "k m"] | None:
    """Trajectory with rates and constants of conserved momentum.

    None where its poses tell no motion.
    """
    poses = np.concatenate([given[:, layout.mean_slice(b)] for b in POSE_BLOCKS], axis=1)
    try:
        evidence = initial_motion(MotionSamples(times, poses[:, 3:], positions=poses[:, :3]), len(times))
        first, _ = initial_state(layout, evidence)
    except InputError:  # no rotation yet, or too few poses: nothing better is known
        return None
    trajectory = given.copy()
    for block in MOMENTUM_BLOCKS:
        if layout.has(block):
            trajectory[:, layout.mean_slice(block.name)] = first[layout.mean_slice(block.name)]
    # of poses that contradict the others there is no evidence
    by_axis = [np.interp(times, evidence.time, rate) for rate in evidence.rates.T]
    trajectory[:, layout.mean_slice("w")] = np.stack(by_axis, axis=1)
    return trajectory
