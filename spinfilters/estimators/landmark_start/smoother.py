"""A smoother of the first frames with the landmarks as unknowns, drawn in from afar and robust to wrong associations.

It is the smoother of `spinfilters.estimators.smoothing` with a schedule for a poor trial: disturbances are taken for larger than
they are until the trajectory obeys its dynamics, the gate that wrong associations fall to is wide at first and strict at last,
and landmarks that a wrong association misplaced are placed anew.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Int

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import ProcessModel
from spinfilters.estimators.first_frames import FirstStatePrior
from spinfilters.estimators.landmark_start.result import LandmarkSmoothing
from spinfilters.estimators.smoothing.annealing import process_noise_inflation
from spinfilters.estimators.smoothing.marginals import Marginals
from spinfilters.estimators.smoothing.problem import (
    Normal,
    Point,
    Problem,
    Stage,
    Trial,
    problem_of,
    with_common_constants,
)
from spinfilters.estimators.smoothing.revival import revived
from spinfilters.estimators.smoothing.robust_kernels import Gate
from spinfilters.estimators.smoothing.sightings import (
    NOTHING_TWICE,
    SIGHTINGS_NEEDED,
    Sightings,
    linearise_sightings,
)
from spinfilters.estimators.smoothing.solver import Solved, SolverOptions, solve
from spinfilters.estimators.timeline import Timeline

WIDER_GATES = (4.0, 2.0)
"""Of the gate in the first iterations."""
FREE_ITERATIONS = 15
"""Iterations in which sightings may still come and go."""
FAR = 1e6
"""Standard deviations: no residual of a camera is as long."""


@dataclass(frozen=True)
class SmoothingOptions:
    """How the first frames are smoothed.

    Attributes
    ----------
    iterations: at most; 0 linearises at the trial and takes no step.
    gate: whitened length of a sighting's residual beyond which it counts as a wrong association.
    """

    iterations: int = 40
    gate: float = 5.0

    def __post_init__(self) -> None:
        if self.iterations < 0 or not self.gate > 0:
            raise InputError(
                f"iterations is {self.iterations}, gate {self.gate}; give at least 0 and more than 0"
            )


@dataclass(frozen=True)
class DrawnIn:
    """Loose and wide at first, then strict; at last what was believed is believed for good, for labels that flip never settle.

    A trial from poses fitted one by one breaks its dynamics by hundreds of standard deviations. Were they strict at once, a step
    would please them and lose the sightings, which are right.
    """

    problem: Problem
    options: SmoothingOptions

    def stage(self, iteration: int, here: Point, before: Normal | None) -> Stage:
        """Which sightings count, and by how much larger the disturbances are taken than they are."""
        within = iteration < self.options.iterations
        slack = process_noise_inflation(self.problem.motion, here, before) if within else 1.0
        if before is not None and iteration >= FREE_ITERATIONS and slack == 1.0:
            return Stage(Gate(FAR, FAR, before.used), slack)
        return Stage(Gate(self.options.gate, self.options.gate * self._width(iteration)), slack)

    def last(self, iteration: int, stage: Stage) -> bool:
        """Whether the stage was as strict as any."""
        return stage.slack == 1.0 and self._width(iteration) == 1.0

    def repaired(self, here: Point, stage: Stage) -> Point:
        """With landmarks placed anew that no two believed sightings tell."""
        sightings = self.problem.sightings
        assert sightings is not None
        assert here.linear is not None
        believed = stage.kernel.weight(here.linear.square) > 0
        points = revived(sightings, here.trajectory, here.points, believed, self.options.gate)
        if points is None:
            return here
        return replace(here, points=points, linear=linearise_sightings(sightings, here.trajectory, points))

    def _width(self, iteration: int) -> float:
        """Of the gate: strict from the first where there are too few iterations to tighten it in."""
        wide = iteration < len(WIDER_GATES) < self.options.iterations
        return WIDER_GATES[iteration] if wide else 1.0


def smooth_with_landmarks(
    process: ProcessModel, frames: Timeline, trial: Trial, prior: FirstStatePrior, options: SmoothingOptions
) -> LandmarkSmoothing:
    """Iterate from a trial to the most probable motion and map.

    Parameters
    ----------
    frames: their measurements with ids are sightings, those of landmarks that the trial does not hold are left out.
    prior: of the first state; its pose must be tight, for it says where g is.

    Raises
    ------
    InputError: when no landmark of the trial is seen twice, or the layout has no place.
    """
    order = np.argsort(trial.ids)
    ids, points = trial.ids[order], trial.points[order]
    problem = problem_of(process, frames, ids, prior, SIGHTINGS_NEEDED)
    if problem.sightings is None:
        raise InputError(NOTHING_TWICE)
    here = problem.at(with_common_constants(process.layout, trial.trajectory), points)
    solved = solve(problem, here, SolverOptions(options.iterations), DrawnIn(problem, options))
    return _result(problem, solved, ids, options.gate)


def _result(problem: Problem, solved: Solved, ids: Int[np.ndarray, " L"], gate: float) -> LandmarkSmoothing:
    here, fit, sightings = solved.point, solved.normal.eliminated, problem.sightings
    assert fit is not None
    assert sightings is not None
    assert here.linear is not None
    solution, n = solved.normal.solution, problem.layout.error_dim
    marginals = None if isinstance(solution, int) else Marginals(solution, fit)
    nothing = np.full((len(here.trajectory), n, n), np.nan)
    used = int(np.count_nonzero(fit.used)) * here.linear.rows.shape[1]
    motion = here.sensors.cost + here.dynamics.cost
    return LandmarkSmoothing(
        layout=problem.layout,
        mean=here.trajectory,
        factor=nothing if marginals is None else marginals.factors,
        ids=ids[fit.told],
        points=here.points[fit.told],
        cost=motion + float(here.linear.square[fit.used].sum()),
        dof=problem.motion.measured + used - 3 * int(np.count_nonzero(fit.told)),
        rejected=int(np.count_nonzero(here.linear.size >= gate)),
        iterations=solved.iterations,
        converged=solved.converged,
        used=sightings.by_frame(fit.used),
        counts=_hits(sightings, fit.used)[fit.told],
        marginals=marginals,
    )


def _hits(sightings: Sightings, used: Bool[np.ndarray, " N"]) -> Int[np.ndarray, " L"]:
    return np.bincount(sightings.landmark[used], minlength=sightings.landmarks)
