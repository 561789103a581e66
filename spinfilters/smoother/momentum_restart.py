"""Restart from conserved angular momentum while the inertia is poorly known, and when it is tried."""

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.models.sensor import MotionSamples
from spinfilters.models.state_layout import POSE_BLOCKS, StateLayout
from spinfilters.smoother.batch_smoother import GATE, AnnealedSchedule
from spinfilters.smoother.closed_form import MASS_SHARES, MOMENTUM_BLOCKS, initial_motion, initial_state
from spinfilters.smoother.linear_system import SchurSystem
from spinfilters.smoother.problem import LinearizationPoint, LinearProblem, Problem, Stage
from spinfilters.smoother.solver import SolverOptions, solve
from spinfilters.smoother.window import Window

if TYPE_CHECKING:
    from spinfilters.smoother.problem import NormalEquations


FIRST, GROWTH, RETRY = 4, 1.5, 1.2
"""Number of epochs at which it is first asked, and by how much more before it is asked again: where all fits, and where not."""
GOOD_FIT, INLIER_SHARE = 1.5, 0.4
"""Cost per degree of freedom, and share of the observations, from which a fit is not in doubt."""


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


def fits(here: "LinearizationPoint", normal: "NormalEquations") -> bool:
    """Whether a point fits as well as the noise allows.

    Its own cost counts, not the one that its linear problem predicts.
    """
    if not normal.solved:
        return False
    if normal.eliminated is None or here.linear is None:
        return True
    used, constrained = int(np.count_nonzero(normal.eliminated.used)), normal.eliminated.is_constrained
    dof = here.linear.rows.shape[1] * used - 3 * int(np.count_nonzero(constrained))
    every = int(np.diff(normal.eliminated.observations.start)[constrained].sum())
    cost = here.cost(normal.used, normal.stage)
    if here.marginal_prior is not None:
        prior = here.marginal_prior.marginal_prior
        cost -= (
            prior.constant_cost
        )  # of observations that have left, which are not among these degrees of freedom
        dof += max(len(prior.right) - prior.ordering.layout.error_dim, 0)  # beyond what one state takes
    return used >= INLIER_SHARE * every and cost <= GOOD_FIT * max(dof, 1)


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
    window : Window
        At its present optimum.
    linear : LinearProblem
        The last linear problem on the way to it.
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
    return _choose_best(problem, window, candidates, linear.normal.stage), count


def _leads_to(
    optimum: SchurSystem | None,
    layout: StateLayout,
    trajectory: Float[np.ndarray, "k m"],
    point: LinearizationPoint,
) -> bool:
    """Whether iterations from a point would end at an optimum that fits, so close is it."""
    return optimum is not None and optimum.rise(layout.local(trajectory, point.trajectory)) < KNOWN


def _choose_best(
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
    """Trajectory with rates and constants of conserved angular momentum; None where its poses show no motion."""
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
