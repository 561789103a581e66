"""A better place to go on from while the inertia is hardly known: what conserved angular momentum says of the poses so far."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.motion_evidence import evidence_from_poses
from spinfilters.estimators.smoothing.problem import Normal, Point, Problem
from spinfilters.estimators.smoothing.solver import Plain, SolverOptions, solve
from spinfilters.estimators.start import closed_form
from spinfilters.logs.measurement_log import MeasurementStream

FIRST, GROWTH = 5, 1.5
"""Number of frames at which it is first asked, and by how much more before it is asked again."""
GOOD_FIT, BELIEVED = 1.5, 0.9
"""Cost per degree of freedom, and share of the sightings, from which a fit is not in doubt."""
STEPS = 4
"""From where it points to."""


@dataclass
class Tried:
    """When to ask again."""

    next: float = FIRST

    def due(self, frames: int) -> bool:
        """Whether there are enough frames; the next time there must be more."""
        if frames < self.next:
            return False
        self.next = GROWTH * frames
        return True


def fits(here: Point, normal: Normal) -> bool:
    """Whether the fit, after the step that the linear problem promises, is as good as noise allows."""
    if normal.eliminated is None or here.linear is None or not normal.solved:
        return False
    used = int(np.count_nonzero(normal.eliminated.used))
    dof = here.linear.rows.shape[1] * used - 3 * int(np.count_nonzero(normal.eliminated.told))
    every = int(np.count_nonzero(normal.eliminated.told[normal.eliminated.sightings.landmark]))
    cost = here.cost(normal.used, normal.stage) - normal.decrement
    return used >= BELIEVED * every and cost <= GOOD_FIT * max(dof, 1)


def at_closed_form(
    problem: Problem, here: Point, normal: Normal, times: Float[np.ndarray, " k"]
) -> tuple[Point | None, int]:
    """A point that fits better than ``here`` would after a step, reached from the closed form, or None; and linearisations."""
    layout = problem.layout
    if "t" not in layout.blocks:
        return None, 0
    poses = np.concatenate([here.trajectory[:, layout.mean_slice(b)] for b in ("t", "a")], axis=1)
    try:
        evidence = evidence_from_poses(MeasurementStream("pose", times, poses), len(times))
        first, _ = closed_form(layout, evidence)
    except InputError:  # no rotation yet, or too few poses: nothing better is known
        return None, 0
    trajectory = here.trajectory.copy()
    for block in ("c", "s", "d", "v"):
        if block in layout.blocks:
            trajectory[:, layout.mean_slice(block)] = first[layout.mean_slice(block)]
    trajectory[:, layout.mean_slice("w")] = evidence.rates
    found = solve(
        problem, problem.at(trajectory, here.points), SolverOptions(STEPS), Plain(normal.stage.kernel)
    )
    best = here.cost(normal.used, normal.stage) - normal.decrement
    better = found.point.cost(found.normal.used, normal.stage) < best - 1
    return (found.point if better else None), found.linearisations
