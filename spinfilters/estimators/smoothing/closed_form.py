"""A better place to go on from while the inertia is hardly known: what conserved angular momentum says of the poses so far."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.initialisation.initial_guess import CLOSED_FORM_BLOCKS, MASS_SHARES, closed_form
from spinfilters.estimators.motion_evidence import motion_evidence
from spinfilters.estimators.smoothing.annealing import GATE, Annealed
from spinfilters.estimators.smoothing.problem import Normal, Point, Problem, Stage
from spinfilters.estimators.smoothing.solver import SolverOptions, solve
from spinfilters.sensors.sensor import MotionSamples
from spinfilters.state.layout import POSE_BLOCKS

FIRST, GROWTH, RETRY = 4, 1.5, 1.2
"""Number of frames at which it is first asked, and by how much more before it is asked again: where all fits, and where not."""
GOOD_FIT, BELIEVED = 1.5, 0.4
"""Cost per degree of freedom, and share of the sightings, from which a fit is not in doubt."""
ITERATIONS = 15
"""From where it points to, with an annealed schedule."""


@dataclass
class Tried:
    """When to ask again: at a number of frames where all fits, or where it does not."""

    next: float = FIRST
    retry: float = FIRST

    def due(self, frames: int, good: bool) -> bool:
        """Whether there are enough frames; the next time there must be more."""
        if frames < (self.next if good else self.retry):
            return False
        self.next, self.retry = GROWTH * frames, RETRY * frames
        return True


def fits(here: Point, normal: Normal) -> bool:
    """Whether a point fits as well as noise allows; the cost that its linear problem promises is not trusted."""
    if not normal.solved:
        return False
    if normal.eliminated is None or here.linear is None:
        return True
    used = int(np.count_nonzero(normal.eliminated.used))
    dof = here.linear.rows.shape[1] * used - 3 * int(np.count_nonzero(normal.eliminated.told))
    every = int(np.count_nonzero(normal.eliminated.told[normal.eliminated.sightings.landmark]))
    return used >= BELIEVED * every and here.cost(normal.used, normal.stage) <= GOOD_FIT * max(dof, 1)


def at_closed_form(
    problem: Problem, here: Point, stage: Stage, times: Float[np.ndarray, " k"]
) -> tuple[Point | None, int]:
    """A point that fits better than ``here``, reached from the closed form, or None; and linearisations."""
    layout = problem.layout
    if not layout.translates or problem.sightings is None:
        return None, 0
    poses = np.concatenate([here.trajectory[:, layout.mean_slice(b)] for b in POSE_BLOCKS], axis=1)
    try:
        evidence = motion_evidence(MotionSamples(times, poses[:, 3:], positions=poses[:, :3]), len(times))
        first, _ = closed_form(layout, evidence)
    except InputError:  # no rotation yet, or too few poses: nothing better is known
        return None, 0
    trajectory = here.trajectory.copy()
    for block in CLOSED_FORM_BLOCKS:
        if layout.has(block):
            trajectory[:, layout.mean_slice(block.name)] = first[layout.mean_slice(block.name)]
    trajectory[:, layout.mean_slice("w")] = evidence.rates
    best, least, count = None, here.robust_cost(stage) - 1, 0
    for share in MASS_SHARES:
        start = trajectory.copy()
        start[:, layout.mean_slice("s")] *= share
        found = solve(
            problem,
            problem.at(start, here.points),
            SolverOptions(ITERATIONS),
            Annealed(problem, ITERATIONS, GATE),
        )
        count += found.linearisations
        cost = found.point.robust_cost(stage)
        if cost < least:
            best, least = found.point, cost
        if fits(found.point, found.normal):
            break
    return best, count
