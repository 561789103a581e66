"""Batch smoother of a whole recording, and its annealed schedule of gates and process noise."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.robust_losses import Gate, LeastSquares, RobustLoss
from spinfilters.filters.estimator import ProcessModel
from spinfilters.filters.timeline import Timeline
from spinfilters.models.status import Finding
from spinfilters.smoother.landmark_factors import ROWS, linearise_observations, reinitialised
from spinfilters.smoother.linear_system import Marginals
from spinfilters.smoother.motion_factors import EpochFactors
from spinfilters.smoother.priors import StatePrior
from spinfilters.smoother.problem import (
    LinearizationPoint,
    NormalEquations,
    Problem,
    Stage,
    problem_of,
    unobservable_directions,
    with_last_constants,
)
from spinfilters.smoother.solver import Solved, SolverOptions, solve

GATE = 5.0
"""Whitened length of an innovation of three components beyond which an observation counts as wrong."""
TIGHTENING = 4.0
"""By which the inflation falls at least from one iteration to the next."""
SMALLEST_INFLATION = 3.0
"""Of the standard deviation of the process noise; less is as good as none."""
WIDER_GATES = (4.0, 2.0)
"""Of the gate in the first iterations."""
FREE_ITERATIONS = 15
"""Iterations in which landmark observations may still come and go."""
FAR = 1e6
"""Standard deviations: no residual is as long."""
NOMINAL_MEDIAN = 1.1
"""Root of the median of the squared innovations per component from which the noise counts as larger than stated: 0.9 where all
observations are right, 1.1 where 30 % are wrong."""


def process_noise_inflation(
    motion: EpochFactors, here: LinearizationPoint, before: NormalEquations | None
) -> float:
    """Factor of the process noise's standard deviation at which the trajectory obeys its dynamics; 1 if it nearly does.

    Enforcing the dynamics from the first iteration, about a trajectory that breaks them by hundreds of standard deviations,
    moves it far from where the linear models hold.
    """
    steps = max(len(motion.ordering.moving) * len(motion.dt), 1)
    inflation = float(np.sqrt(here.dynamics.cost / steps))
    if before is not None:
        inflation = min(inflation, before.stage.inflation / TIGHTENING)
    return inflation if inflation > SMALLEST_INFLATION else 1.0


def residual_scale(here: LinearizationPoint) -> float:
    """Robust scale of the innovations in standard deviations: 1, or more where the noise exceeds its stated level."""
    squares = [here.sensors.mean_squares]
    if here.linear is not None:
        squares.append(here.linear.square / ROWS)
    every = np.concatenate(squares)
    scale = np.sqrt(np.median(every)) / NOMINAL_MEDIAN if len(every) else 1.0
    return float(np.clip(np.nan_to_num(scale, nan=1.0), 1.0, FAR))


@dataclass(frozen=True)
class AnnealedSchedule:
    """Inflated process noise and wide gates until the trajectory obeys its dynamics, or iterations run out.

    Attributes
    ----------
    iterations : int
        Number of first iterations in which the process noise may be inflated and the gates wide.
    gate : float or None
        Length of a whitened innovation of three components beyond which an observation counts as wrong (of others the
        length of the same probability); None for the losses that the problem has.
    """

    problem: Problem
    iterations: int
    gate: float | None = None

    def stage(self, iteration: int, here: LinearizationPoint, before: NormalEquations | None) -> Stage:
        """Loss of the observations and inflation of the process noise."""
        inflated = iteration < self.iterations and not self.problem.is_long
        inflation = process_noise_inflation(self.problem.motion, here, before) if inflated else 1.0
        if self.gate is None:
            return Stage(LeastSquares(), inflation)
        opened, width = self.gate * residual_scale(here), self._width(iteration)
        inner = opened * self.pose_only_gate / self.gate
        pose_only_loss = Gate(inner, inner * width)
        if (
            before is not None
            and before.used is not None
            and iteration >= FREE_ITERATIONS
            and inflation == 1.0
        ):
            return Stage(Gate(FAR, FAR, before.used), inflation, pose_only_loss)
        return Stage(Gate(self.gate, max(self.gate * width, opened)), inflation, pose_only_loss)

    def last(self, iteration: int, stage: Stage) -> bool:
        """Whether the stage was the strictest."""
        return stage.inflation == 1.0 and self._width(iteration) == 1.0

    def repaired(self, here: LinearizationPoint, stage: Stage) -> LinearizationPoint:
        """Linearisation point with landmarks of fewer than two inliers re-initialised."""
        observations = self.problem.observations
        if observations is None or here.linear is None or self.gate is None:
            return here
        believed = here.linear.weight(stage.loss) > 0
        points = reinitialised(observations, here.trajectory, here.points, believed, self.gate)
        if points is None:
            return here
        return replace(
            here, points=points, linear=linearise_observations(observations, here.trajectory, points)
        )

    @property
    def pose_only_gate(self) -> float:
        """Of the observation with the most components: the length that the gate's probability belongs to."""
        from scipy.special import (  # here alone: a tenth of the time that importing the smoother takes
            chdtrc,
            chdtri,
        )

        assert self.gate is not None
        components = max((sensor.model.dim for sensor in self.problem.motion.sensors), default=ROWS)
        same = np.sqrt(chdtri(components, max(chdtrc(ROWS, self.gate**2), np.finfo(float).tiny)))
        return max(self.gate, float(same))

    def _width(self, iteration: int) -> float:
        """Relative width of the gate in an iteration.

        1 from the first where there are too few iterations to tighten it in.
        """
        wide = self.gate is not None and iteration < len(WIDER_GATES) < self.iterations
        return WIDER_GATES[iteration] if wide else 1.0


@dataclass
class IdleAnnealing:
    """Whether a strict solution took the steps that an annealed one would take.

    It did where its first guess obeys the dynamics, and nothing was beyond its gate while an annealed one is wide. Called with
    every linear problem of the strict solution.
    """

    problem: Problem
    seen: int = 0
    same: bool = True

    def __call__(self, here: LinearizationPoint, normal: NormalEquations) -> None:
        if self.seen == 0:
            annealed = AnnealedSchedule(self.problem, 1)
            self.same = not self.problem.is_long and annealed.stage(0, here, None).inflation == 1.0
        if self.same and self.seen < len(WIDER_GATES):
            self.same = self._all_count(here, normal.stage)
        self.seen += 1

    @property
    def is_idle(self) -> bool:
        """Whether it was solved for long enough to judge."""
        return self.same and self.seen > len(WIDER_GATES) + 1

    def _all_count(self, here: LinearizationPoint, stage: Stage) -> bool:
        """Whether no measurement is beyond the gate's quadratic part."""
        loss, motion = stage.pose_only_loss, self.problem.motion
        if loss is None:
            return False
        squares = (here.sensor_rows(motion, k).squares for k in range(len(motion.sensors)))
        return all(bool((loss.weight(each) == 1.0).all()) for each in squares)


NO_LANDMARKS, NO_POINTS = np.zeros(0, dtype=int), np.zeros((0, 3))


@dataclass(frozen=True)
class BatchSmoothing:
    """The most probable trajectory.

    Attributes
    ----------
    mean : ndarray of float, shape (k, m)
        Most probable state of each epoch.
    factor : ndarray of float, shape (k, n, n)
        Factor of each epoch's covariance given all measurements; not finite where something is undetermined.
    accepted, rejected : ndarray of int, shape (k,)
        Number of measurements of each epoch that are inliers, and that are not.
    unobservable : list[Finding]
        Findings of what the measurements do not determine.
    """

    mean: Float[np.ndarray, "k m"]
    factor: Float[np.ndarray, "k n n"]
    accepted: Int[np.ndarray, " k"]
    rejected: Int[np.ndarray, " k"]
    solved: Solved
    unobservable: list[Finding]


def smooth_recording(
    process: ProcessModel,
    epochs: Timeline,
    trajectory: Float[np.ndarray, "k m"],
    prior: StatePrior,
    loss: RobustLoss,
    annealed_iterations: int = 0,
) -> BatchSmoothing:
    """Smooth measurements without landmark ids from an initial trajectory, whose constants are the last epoch's.

    Parameters
    ----------
    annealed_iterations : int
        Largest number of iterations with inflated process noise, for a trajectory that does not obey its dynamics.
    """
    problem = problem_of(process, epochs, NO_LANDMARKS, prior, 2, loss)
    return smooth_problem(problem, trajectory, annealed_iterations)


def smooth_problem(
    problem: Problem, trajectory: Float[np.ndarray, "k m"], annealed_iterations: int = 0
) -> BatchSmoothing:
    """Smooth a problem without landmarks; see `smooth_recording`."""
    start = with_last_constants(problem.layout, trajectory)
    schedule = AnnealedSchedule(problem, annealed_iterations) if annealed_iterations else None
    solved = solve(problem, problem.at(start, NO_POINTS), SolverOptions(), schedule)
    solution, here, n = solved.normal.solution, solved.point.trajectory, problem.layout.error_dim
    marginals = None if solution is None else Marginals(solution, None)
    factor = np.full((len(here), n, n), np.nan) if marginals is None else marginals.factors
    accepted, rejected = np.zeros(len(here), dtype=int), np.zeros(len(here), dtype=int)
    for sensor in problem.motion.sensors:
        good = problem.motion.inliers(sensor, here)
        np.add.at(accepted, sensor.epoch[good], 1)
        np.add.at(rejected, sensor.epoch[~good], 1)
    directions = unobservable_directions(problem, solved.point, solved.normal, marginals)
    return BatchSmoothing(here, factor, accepted, rejected, solved, directions)
