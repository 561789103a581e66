"""A smoother of the first frames with the landmarks as unknowns: the most probable motion and map together.

Gauss-Newton on whitened residuals: dynamics, prior and other sensors (`start_motion`), sightings with the gate that wrong
associations fall to (`start_sightings`), landmarks eliminated (`start_elimination`). Unlike poses fitted one by one, whose common
errors no covariance tells, the trajectory's covariance here is that of all unknowns.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import ProcessModel
from spinfilters.estimators.first_frames import LARGEST_MASS_STEP, SETTLED, FirstStatePrior
from spinfilters.estimators.gain import triangular_factor
from spinfilters.estimators.landmark_start.elimination import (
    Eliminated,
    Solution,
    eliminate,
    solve_reduced,
)
from spinfilters.estimators.landmark_start.motion import (
    MOVING,
    NormalEquations,
    Unknowns,
    dynamics_equations,
    sensor_equations,
)
from spinfilters.estimators.landmark_start.result import LandmarkSmoothing
from spinfilters.estimators.landmark_start.revival import revived
from spinfilters.estimators.landmark_start.sightings import (
    Gate,
    LinearSightings,
    Sightings,
    collect_sightings,
    linearise_sightings,
)
from spinfilters.estimators.timeline import Timeline
from spinfilters.state.layout import StateLayout

WIDER_GATES = (4.0, 2.0)
"""Of the gate in the first iterations."""
TIGHTENING = 4.0
"""By which the slack of the dynamics falls at least from one iteration to the next."""
SMALLEST_SLACK = 3.0
"""Less is as good as none."""
FREE_ITERATIONS = 15
"""Iterations in which sightings may still come and go."""
FAR = 1e6
"""Standard deviations: no residual of a camera is as long."""
HALVINGS = 8
"""Of a step that makes the fit worse, at most."""
COST_SLACK = 1e-3
"""By which the cost may rise: chi-square numbers differ by far more, rounding by far less."""


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
class Trial:
    """Where a smoother sets out from: a point per frame (its constants are those of the first), and a map in frame g."""

    trajectory: Float[np.ndarray, "k m"]
    ids: Int[np.ndarray, " L"]
    points: Float[np.ndarray, "L 3"]


@dataclass(frozen=True)
class _Problem:
    process: ProcessModel
    frames: Timeline
    prior: FirstStatePrior
    sightings: Sightings
    unknowns: Unknowns
    options: SmoothingOptions


@dataclass(frozen=True)
class _Stage:
    """How strict an iteration is: which sightings count, and by how much larger the disturbances are taken than they are.

    A trial from poses fitted one by one breaks its dynamics by hundreds of standard deviations. Were they strict at once, a step
    would please them and lose the sightings, which are right.
    """

    gate: Gate
    slack: float


@dataclass(frozen=True)
class _Point:
    """A trajectory and landmarks, with everything linearised about them."""

    trajectory: Float[np.ndarray, "k m"]
    points: Float[np.ndarray, "L 3"]
    sensors: NormalEquations
    dynamics: NormalEquations
    linear: LinearSightings

    def motion(self, slack: float) -> NormalEquations:
        """Everything but sightings, with disturbances ``slack`` times as large."""
        return self.sensors.plus(self.dynamics, slack**-2)

    def cost(self, used: Bool[np.ndarray, " N"], stage: _Stage) -> float:
        """Of the motion and of the sightings that the step was made from: the others' landmarks did not move with it."""
        motion = self.sensors.cost + self.dynamics.cost / stage.slack**2
        return motion + float(self.linear.robust_costs(stage.gate)[used].sum())


@dataclass(frozen=True)
class _Normal:
    """The linear problem about a point with what was believed there, solved."""

    stage: _Stage
    eliminated: Eliminated
    solution: Solution | None

    @property
    def length(self) -> float:
        """Of the step, in standard deviations of its own components."""
        return (
            np.inf if self.solution is None else float(np.abs(self.solution.step / self.solution.std).max())
        )


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
    unknowns = Unknowns(process.layout, len(frames))
    problem = _Problem(process, frames, prior, collect_sightings(frames, ids), unknowns, options)
    here = _point(problem, _with_common_constants(process.layout, trial.trajectory), points)
    here, normal, used, converged = _iterated(problem, here)
    return _result(problem, here, normal, ids, (used, converged))


def _iterated(problem: _Problem, here: _Point) -> tuple[_Point, _Normal, int, bool]:
    """Where the iteration ends, the linear problem there, how many steps it took, and whether the last one was small."""
    used, converged = 0, False
    normal = _solve(problem, here, _stage(problem, 0, here, None))
    while used < problem.options.iterations and not converged and normal.solution is not None:
        last = normal.stage.slack == 1.0 and _width(used, problem.options) == 1.0
        converged = normal.length <= SETTLED and last
        there = _advance(problem, here, normal)
        used += 1
        if there is None:
            break
        stage = _stage(problem, used, there, normal)
        here = _revived(problem, there, stage.gate)
        normal = _solve(problem, here, stage)
    return here, normal, used, converged


def _stage(problem: _Problem, used: int, here: _Point, before: _Normal | None) -> _Stage:
    """Loose and wide at first, then strict; at last what was believed is believed for good, for labels that flip never settle."""
    steps = max(MOVING * (len(problem.frames) - 1), 1)
    slack = float(np.sqrt(here.dynamics.cost / steps))
    if before is not None:
        slack = min(slack, before.stage.slack / TIGHTENING)
    slack = slack if slack > SMALLEST_SLACK and used < problem.options.iterations else 1.0
    if before is not None and used >= FREE_ITERATIONS and slack == 1.0:
        return _Stage(Gate(FAR, FAR, before.eliminated.used), slack)
    everything = np.ones(len(problem.sightings.frame), dtype=bool)
    inner = problem.options.gate
    return _Stage(Gate(inner, inner * _width(used, problem.options), everything), slack)


def _width(used: int, options: SmoothingOptions) -> float:
    """Of the gate in an iteration: strict from the first where there are too few iterations to tighten it in."""
    wide = used < len(WIDER_GATES) < options.iterations
    return WIDER_GATES[used] if wide else 1.0


def _with_common_constants(
    layout: StateLayout, trajectory: Float[np.ndarray, "k m"]
) -> Float[np.ndarray, "k m"]:
    constants = slice(layout.mean_slice("w").stop, None)
    common = trajectory.copy()
    common[:, constants] = trajectory[0, constants]
    return common


def _point(
    problem: _Problem, trajectory: Float[np.ndarray, "k m"], points: Float[np.ndarray, "L 3"]
) -> _Point:
    sensors = sensor_equations(problem.process, problem.frames, trajectory, problem.prior)
    dynamics = dynamics_equations(problem.process, problem.frames, trajectory)
    linear = linearise_sightings(problem.sightings, trajectory, points)
    return _Point(trajectory, points, sensors, dynamics, linear)


def _revived(problem: _Problem, here: _Point, gate: Gate) -> _Point:
    believed = here.linear.weights(gate) > 0
    points = revived(problem.sightings, here.trajectory, here.points, believed, problem.options.gate)
    if points is None:
        return here
    linear = linearise_sightings(problem.sightings, here.trajectory, points)
    return replace(here, points=points, linear=linear)


def _solve(problem: _Problem, here: _Point, stage: _Stage) -> _Normal:
    weights = here.linear.weights(stage.gate)
    eliminated = eliminate(problem.sightings, here.linear, weights, len(problem.frames))
    motion = here.motion(stage.slack)
    return _Normal(stage, eliminated, solve_reduced(motion, eliminated, problem.unknowns))


def _advance(problem: _Problem, here: _Point, normal: _Normal) -> _Point | None:
    """Along the step as far as the fit gets no worse; None where there is no such step."""
    assert normal.solution is not None
    layout, step = problem.process.layout, normal.solution.step
    errors = problem.unknowns.errors(step)
    of_points = normal.eliminated.points_step(step[problem.unknowns.poses])
    largest = float(np.abs(errors[0, layout.slice("s")]).max())
    share = min(1.0, LARGEST_MASS_STEP / max(largest, np.finfo(float).tiny))
    allowed = here.cost(normal.eliminated.used, normal.stage) + COST_SLACK
    for _ in range(HALVINGS + 1):
        points = here.points.copy()
        points[normal.eliminated.landmarks] += share * of_points
        there = _point(problem, layout.retract(here.trajectory, share * errors), points)
        if there.cost(normal.eliminated.used, normal.stage) <= allowed:
            return there
        share /= 2
    return None


def _result(
    problem: _Problem, here: _Point, normal: _Normal, ids: Int[np.ndarray, " L"], reached: tuple[int, bool]
) -> LandmarkSmoothing:
    layout, fit, count = problem.process.layout, normal.eliminated, len(problem.frames)
    size = problem.unknowns.size
    solved = normal.solution is not None and not normal.solution.damped
    root = normal.solution.root if normal.solution is not None else np.full((size, size), np.nan)
    states = [problem.unknowns.state(k) for k in range(count)]
    innovation = here.linear.innovation[fit.used]
    hits = np.bincount(problem.sightings.landmark[fit.used], minlength=len(ids))[fit.landmarks]
    return LandmarkSmoothing(
        layout=layout,
        mean=here.trajectory,
        factor=np.array([triangular_factor(root[rows].T) for rows in states]),
        ids=ids[fit.landmarks],
        points=here.points[fit.landmarks],
        cost=here.motion(1.0).cost + float((innovation**2).sum()),
        dof=here.sensors.measured + innovation.size - 3 * len(fit.landmarks),
        rejected=int(np.count_nonzero(here.linear.size >= problem.options.gate)),
        iterations=reached[0],
        converged=reached[1] and solved,
        used=problem.sightings.by_frame(fit.used),
        counts=hits,
        root=root,
        eliminated=fit,
    )
