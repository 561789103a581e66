"""Restart from conserved angular momentum while the inertia is poorly known."""

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.initialisation.initial_guess import MASS_SHARES, MOMENTUM_BLOCKS, initial_state
from spinfilters.estimators.initialisation.initial_motion import initial_motion
from spinfilters.estimators.smoothing.problem.least_squares import (
    LinearizationPoint,
    Problem,
    Stage,
)
from spinfilters.estimators.smoothing.solver.annealing import GATE, AnnealedSchedule
from spinfilters.estimators.smoothing.solver.iterations import SolverOptions, solve
from spinfilters.estimators.smoothing.window.restart_schedule import fits
from spinfilters.sensors.sensor import MotionSamples
from spinfilters.state.layout import POSE_BLOCKS, StateLayout

ITERATIONS = 15
"""From where it points to, with an annealed schedule."""


def restarted_from_momentum(
    problem: Problem, here: LinearizationPoint, stage: Stage, times: Float[np.ndarray, " k"]
) -> tuple[LinearizationPoint | None, int]:
    """Better-fitting point from the closed form, or None; and linearisations used."""
    layout = problem.layout
    if not layout.translates or problem.observations is None:
        return None, 0
    trajectory = trajectory_from_momentum(layout, here.trajectory, times)
    if trajectory is None:
        return None, 0
    best, least, count = None, here.robust_cost(stage) - 1, 0
    for share in MASS_SHARES:
        start = trajectory.copy()
        start[:, layout.mean_slice("s")] *= share
        found = solve(
            problem,
            problem.at(start, here.points),
            SolverOptions(ITERATIONS),
            AnnealedSchedule(problem, ITERATIONS, GATE),
        )
        count += found.linearisations
        cost = found.point.robust_cost(stage)
        if cost < least:
            best, least = found.point, cost
        if fits(found.point, found.normal):
            break
    return best, count


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
