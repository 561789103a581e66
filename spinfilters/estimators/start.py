"""A start from data: where the first frames say the body is, how it turns, and what its inertia is.

Attitudes and rates of the first frames give J up to scale in closed form (`momentum_start`); the smoother's solver makes that the
most probable trajectory of those frames and gives its covariance. Filters go on from its last frame, so no
measurement is counted twice and no guess of the mass distribution enters but a wide prior.
"""

from dataclasses import dataclass
from itertools import product
from typing import Annotated

import numpy as np
from jaxtyping import Float

from spinfilters.dynamics.mass_distribution import from_inertia
from spinfilters.errors import InputError
from spinfilters.estimators.estimator import ProcessModel
from spinfilters.estimators.first_frames import FirstStatePrior, SmoothedFrames
from spinfilters.estimators.momentum_start import fit_momentum
from spinfilters.estimators.motion_evidence import MotionEvidence
from spinfilters.estimators.smoothing.annealing import Annealed
from spinfilters.estimators.smoothing.batch import NO_LANDMARKS, NO_POINTS
from spinfilters.estimators.smoothing.marginals import Marginals
from spinfilters.estimators.smoothing.problem import Problem, Stage, problem_of, with_common_constants
from spinfilters.estimators.smoothing.robust_kernels import LeastSquares
from spinfilters.estimators.smoothing.sightings import SIGHTINGS_NEEDED
from spinfilters.estimators.smoothing.solver import Plain, Schedule, SolverOptions, solve
from spinfilters.estimators.timeline import Timeline
from spinfilters.logs.number_range import NumberRange
from spinfilters.state.block import StateBlock
from spinfilters.state.blocks.drag import DRAG
from spinfilters.state.blocks.gyro_bias import GYRO_BIAS
from spinfilters.state.blocks.rigid_body import ATTITUDE, CENTRE_OF_MASS, MASS_DISTRIBUTION, RATE, VELOCITY
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import StateLayout

MASS_SHARES = (1.0, 0.3, 0.0)
"""Shares of the closed form's departure from a sphere from which the fit is tried, in this order."""
SETTLED_FIT = 1.5
"""Rms of the whitened residuals below which a converged fit is believed without trying others."""
CLEAR_MASS_STD = 0.3
"""Of the mass distribution (log second moments) below which a fit is believed without trying others: on simulated poses all fits
with a second optimum were beyond 0.7, and all optima that were alone below 0.5."""
PRIOR_STD = NumberRange(1e-9, 1e9)
"""Of a prior in the settings, in its unit."""
GAUGE_STD = 1e-9
"""Of an attitude that defines a frame rather than being measured, rad."""
CLOSED_FORM_BLOCKS = (CENTRE_OF_MASS, MASS_DISTRIBUTION, DRAG, VELOCITY)
"""What conserved momentum and a straight path tell beyond what was seen."""


@dataclass(frozen=True)
class StartOptions:
    """How a start is made.

    Attributes
    ----------
    frames: how many frames it looks at, at most.   share: of the recording, at most.
    duration: how many seconds it looks at, at most.
    iterations: of the smoother, at most.
    mass_std: of the prior of the mass distribution about the sphere, in the logarithm of second moments (a phone lies at 2).
    centre_std: of the prior of the centre of mass about the origin of g, m.   speed_std: of its velocity, m/s.
    drag_std: of the prior of the drag coefficient, 1/rad.
    gyro_bias_std: of the prior of a gyro's bias, rad/s; 0 for a gyro without one.
    """

    frames: Annotated[int, NumberRange(1, 100_000, whole=True)] = 60
    share: Annotated[float, NumberRange(1e-6, 1e6)] = 0.6
    duration: Annotated[float, NumberRange(1e-6, 1e11, "s")] = 60.0
    iterations: Annotated[int, NumberRange(1, 10_000, whole=True)] = 40
    mass_std: Annotated[float, PRIOR_STD] = MASS_DISTRIBUTION.prior_std
    centre_std: Annotated[float, PRIOR_STD] = CENTRE_OF_MASS.prior_std
    speed_std: Annotated[float, PRIOR_STD] = VELOCITY.prior_std
    drag_std: Annotated[float, PRIOR_STD] = DRAG.prior_std
    gyro_bias_std: Annotated[float, NumberRange(1e-9, 1e3, "rad/s", zero=True)] = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            allowed = value >= 0 if name == GYRO_BIAS.prior_option else value > 0
            if not (np.isfinite(value) and allowed):
                raise InputError(f"start.{name} is {value}; it must be positive")

    def states_prior(self, block: StateBlock) -> bool:
        """Whether the option that a block names for its prior is set."""
        return bool(block.prior_option and getattr(self, block.prior_option))

    def prior_std(self, block: StateBlock) -> float:
        """Of the prior of a block: the option that it names where that is set, or the block's own."""
        return (getattr(self, block.prior_option) if block.prior_option else 0.0) or block.prior_std

    def count(self, timeline: Timeline) -> int:
        """How many frames of a timeline belong to the start."""
        end = timeline[0].time + self.duration
        inside = sum(frame.time <= end for frame in timeline)
        return max(4, min(self.frames, inside, round(self.share * len(timeline))))


@dataclass(frozen=True)
class StartReport:
    """The first frames of a run, and how they were reached.

    Attributes
    ----------
    frames: smoothed trajectory with covariance; the filters begin from its last frame.
    fit: rms of the whitened innovations of those frames: 1 when noise and model are right.
    momentum_residual: how far the closed form's angular momentum was from constant (relative rms).
    prior: of the first frame's state.
    """

    layout: StateLayout
    frames: SmoothedFrames
    fit: float
    momentum_residual: float
    prior: FirstStatePrior

    @property
    def belief(self) -> Gaussian:
        """Belief after the last frame of the start."""
        return Gaussian(self.layout, self.frames.mean[-1], self.frames.factor[-1])


def start_from_data(
    process: ProcessModel, timeline: Timeline, evidence: MotionEvidence, options: StartOptions
) -> StartReport:
    """Smooth the first frames of a timeline, for any estimator over ``process.layout`` to go on from.

    Parameters
    ----------
    evidence: attitudes and rates of (at least some of) those frames.

    Raises
    ------
    InputError: when the evidence has fewer than 4 frames or the body does not rotate.
    """
    first, momentum_residual = closed_form(process.layout, evidence)
    frames = timeline[: options.count(timeline)]
    prior = wide_prior(process.layout, first, options, evidence)
    found = _best_fit(
        process, frames, trial_trajectory(process.layout, frames, first, evidence), prior, options
    )
    fit = float(np.sqrt(found.cost / max(found.dof, 1)))
    return StartReport(process.layout, found, fit, momentum_residual, prior)


def closed_form(layout: StateLayout, evidence: MotionEvidence) -> tuple[Float[np.ndarray, " m"], float]:
    """First state from conserved momentum (and a straight path of the centre of mass), and how constant momentum was."""
    fit = fit_momentum(evidence.rotations, evidence.rates, evidence.time, layout.has(DRAG))
    x = layout.origin()
    x[layout.mean_slice("a")] = evidence.attitude[0]
    x[layout.mean_slice("w")] = evidence.rates[0]
    x[layout.mean_slice("s")] = from_inertia(fit.inertia)
    if layout.has(DRAG):
        x[layout.mean_slice("d")] = fit.drag
    if evidence.positions is not None and layout.translates:
        c, v = _straight_centre(evidence)
        x[layout.mean_slice("t")] = evidence.positions[0]
        x[layout.mean_slice("c")], x[layout.mean_slice("v")] = c, v
    return x, fit.residual


def _straight_centre(evidence: MotionEvidence) -> tuple[np.ndarray, np.ndarray]:
    """(c, v) by linear least squares of t_k + R_k c = r_0 + v (t_k - t_0)."""
    assert evidence.positions is not None
    elapsed, rotations = evidence.time - evidence.time[0], evidence.rotations
    eye = np.broadcast_to(np.eye(3), rotations.shape)
    A = np.concatenate([rotations, -eye, -eye * elapsed[:, None, None]], axis=2).reshape(-1, 9)
    solution = np.linalg.lstsq(A, -evidence.positions.reshape(-1), rcond=1e-9)[0]
    return solution[:3], solution[6:]


def trial_trajectory(
    layout: StateLayout, frames: Timeline, first: np.ndarray, evidence: MotionEvidence
) -> Float[np.ndarray, "k m"]:
    """One point per frame: what was seen nearest to its time, with the constants of the first state."""
    trajectory = np.tile(first, (len(frames), 1))
    nearest = [int(np.argmin(np.abs(evidence.time - frame.time))) for frame in frames]
    trajectory[:, layout.mean_slice("a")] = evidence.attitude[nearest]
    trajectory[:, layout.mean_slice("w")] = evidence.rates[nearest]
    if evidence.positions is not None and layout.translates:
        trajectory[:, layout.mean_slice("t")] = evidence.positions[nearest]
    return trajectory


def wide_prior(
    layout: StateLayout, first: np.ndarray, options: StartOptions, evidence: MotionEvidence
) -> FirstStatePrior:
    """Wide prior: spheres, at the pose and rate that were seen; tight only where the first frame defines a frame."""
    mean, std = first.copy(), np.zeros(layout.error_dim)
    for block in layout.members:
        std[layout.slice(block.name)] = options.prior_std(block)
        if block.prior_at_origin:
            mean[layout.mean_slice(block.name)] = block.origin
    std[layout.slice(RATE.name)] = max(float(np.linalg.norm(evidence.rates, axis=1).max()), 1e-3)
    if evidence.defines_attitude and not layout.translates:
        std[layout.slice(ATTITUDE.name)] = GAUGE_STD
    return FirstStatePrior(mean, std)


def _best_fit(
    process: ProcessModel,
    frames: Timeline,
    trajectory: Float[np.ndarray, "k m"],
    prior: FirstStatePrior,
    options: StartOptions,
) -> SmoothedFrames:
    """The likeliest of the fits from the closed form and from bodies nearer to a sphere.

    A first fit that settles and determines the body is believed; where the body is hardly determined there may be several optima.
    """
    problem = problem_of(process, frames, NO_LANDMARKS, prior, SIGHTINGS_NEEDED)
    schedules = (Plain(), Annealed(problem.motion, options.iterations))
    tries: list[SmoothedFrames] = []
    for share, schedule in product(MASS_SHARES, schedules):
        trial = with_common_constants(process.layout, trajectory)
        trial[:, process.layout.mean_slice("s")] *= share
        tries.append(_fit(problem, trial, options.iterations, schedule))
        if _is_clear(process.layout, tries[-1]):
            break
    return min(tries, key=lambda found: found.cost if np.isfinite(found.cost) else np.inf)


def _fit(
    problem: Problem, trial: Float[np.ndarray, "k m"], iterations: int, schedule: Schedule
) -> SmoothedFrames:
    """The optimum reached from a trial trajectory, whose constants are the same in every frame."""
    solved = solve(problem, problem.at(trial, NO_POINTS), SolverOptions(iterations), schedule)
    point, solution, n = solved.point, solved.normal.solution, problem.layout.error_dim
    undetermined = np.full((len(trial), n, n), np.nan)
    factor = undetermined if isinstance(solution, int) else Marginals(solution, None).factors
    dof = sum(
        int(np.count_nonzero(problem.motion.believed(sensor, point.trajectory))) * sensor.model.dim
        for sensor in problem.motion.sensors
    )
    cost = point.cost(None, Stage(LeastSquares()))
    return SmoothedFrames(point.trajectory, factor, cost, dof, solved.iterations, solved.converged)


def _is_clear(layout: StateLayout, found: SmoothedFrames) -> bool:
    """Whether a fit has settled, explains its measurements and tells the mass distribution."""
    mass_std = np.linalg.norm(found.factor[-1, layout.slice("s")], axis=1)
    settled = found.converged and found.cost < SETTLED_FIT**2 * found.dof
    return bool(settled and mass_std.max() <= CLEAR_MASS_STD)
