"""Restart from conserved angular momentum while the inertia is poorly known."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.initialisation.initial_guess import MASS_SHARES, MOMENTUM_BLOCKS, initial_state
from spinfilters.estimators.initialisation.initial_motion import initial_motion
from spinfilters.estimators.smoothing.problem.least_squares import (
    LinearizationPoint,
    NormalEquations,
    Problem,
    Stage,
)
from spinfilters.estimators.smoothing.solver.annealing import GATE, AnnealedSchedule
from spinfilters.estimators.smoothing.solver.iterations import SolverOptions, solve
from spinfilters.sensors.sensor import MotionSamples
from spinfilters.state.layout import POSE_BLOCKS, StateLayout

FIRST, GROWTH, RETRY = 4, 1.5, 1.2
"""Number of epochs at which it is first asked, and by how much more before it is asked again: where all fits, and where not."""
GOOD_FIT, INLIER_SHARE = 1.5, 0.4
"""Cost per degree of freedom, and share of the observations, from which a fit is not in doubt."""
ITERATIONS = 15
"""From where it points to, with an annealed schedule."""


@dataclass
class RetrySchedule:
    """Schedule of restart attempts by number of epochs. Sparser where everything fits."""

    next: float = FIRST
    retry: float = FIRST

    def is_due(self, epochs: int, good: bool) -> bool:
        """Whether enough epochs have come for the next attempt."""
        if epochs < (self.next if good else self.retry):
            return False
        self.next, self.retry = GROWTH * epochs, RETRY * epochs
        return True


def fits(here: LinearizationPoint, normal: NormalEquations) -> bool:
    """Whether a point fits as well as the noise allows.

    Its own cost counts, not the one that its linear problem predicts.
    """
    if not normal.solved:
        return False
    if normal.eliminated is None or here.linear is None:
        return True
    used = int(np.count_nonzero(normal.eliminated.used))
    dof = here.linear.rows.shape[1] * used - 3 * int(np.count_nonzero(normal.eliminated.is_constrained))
    every = int(np.count_nonzero(normal.eliminated.is_constrained[normal.eliminated.observations.landmark]))
    cost = here.cost(normal.used, normal.stage)
    if here.marginal_prior is not None:
        prior = here.marginal_prior.marginal_prior
        cost -= (
            prior.constant_cost
        )  # of observations that have left, which are not among these degrees of freedom
        dof += max(len(prior.right) - prior.ordering.layout.error_dim, 0)  # beyond what one state takes
    return used >= INLIER_SHARE * every and cost <= GOOD_FIT * max(dof, 1)


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
