"""Initialisation by smoothing the first epochs, for any sensors, with a map where landmarks are unknown.

Each guess is smoothed by itself under its prior; the likeliest of their optima is the initial estimate.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Protocol

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.chi_square import chi_square_tail
from spinfilters.core.errors import InputError
from spinfilters.core.robust_losses import LeastSquares
from spinfilters.filters.estimator import LandmarkBelief, ProcessModel
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.filters.timeline import Timeline, times_of
from spinfilters.inference.noise_model import sensor_residuals
from spinfilters.models.body import body_estimate
from spinfilters.models.gauge import GAUGE_DIM, GAUGE_STD
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.sensor import MotionSamples
from spinfilters.models.state_blocks import ATTITUDE, MASS_DISTRIBUTION, RATE
from spinfilters.models.state_layout import POSE_BLOCKS, Gaussian, StateLayout
from spinfilters.models.status import EstimatorStatus, Verdict
from spinfilters.settings.run_settings import InitialisationOptions
from spinfilters.smoother.batch_smoother import GATE, NO_LANDMARKS, NO_POINTS, AnnealedSchedule, IdleAnnealing
from spinfilters.smoother.closed_form import MASS_SHARES, InitialMotion, initial_motion, initial_state
from spinfilters.smoother.landmark_factors import NOTHING_TWICE, OBSERVATIONS_NEEDED
from spinfilters.smoother.linear_system import Marginals, joint_belief
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.smoother.problem import InitialGuess, Problem, problem_of, with_common_constants
from spinfilters.smoother.solver import Solved, SolverOptions, solve


@dataclass(frozen=True)
class InitialEstimate:
    """The most probable motion of the first k epochs and the L landmarks that are unknowns.

    Attributes
    ----------
    prior : FirstStatePrior
        Prior of the first epoch's state.
    mean : (k, m) float array
        Most probable states.
    factor : (k, n, n) float array
        Covariance factor of each epoch given all of them; not finite where there is none.
    cost : float
        Sum of squared whitened residuals about the mean, prior and dynamics included.
    dof : int
        Scalar observations that count, less three per landmark: what the least cost is expected to be.
    accepted, rejected : int
        Observations that count, and that do not.
    used : tuple[(_,) bool array, ...]
        Per epoch, which of its landmark observations count.
    refused : Mapping[MeasurementModel, (r,) bool array]
        Of each sensor without landmarks, in the order of time, which of its measurements do not count.
    ids : (L,) int array
        Landmarks that at least two inliers observe; empty where a map is known or there is none.
    points : (L, 3) float array
        Their positions, m, frame g.
    counts : (L,) int array
        Number of inliers of each landmark.
    marginals : Marginals or None
        Covariances of everything, or None where some direction is not determined.
    momentum_residual : float
        How far the initial guess's angular momentum was from constant (relative rms).
    noise_ratio : float or None
        Standard deviation of the observations over the stated, from the initial guess; None where it does not show it.
    departure : float
        Distance of a filter from the smoother of the same measurements, in standard deviations; zero where none was tried.
    status : EstimatorStatus
        Whether it can be trusted, with reasons.
    guess : InitialGuess or None
        The guess that it was smoothed from, whose landmarks are all that the first epochs show; None where it is not known.
    is_annealed_too : bool
        Whether an annealed smoothing would have taken the same steps.
    rivals : tuple[InitialEstimate, ...]
        Other optima of the same epochs, less likely at this noise; () where there are none or none was looked for.
    """

    layout: StateLayout
    prior: FirstStatePrior
    mean: Float[np.ndarray, "k m"]
    factor: Float[np.ndarray, "k n n"]
    cost: float
    dof: int
    accepted: int
    rejected: int
    iterations: int
    converged: bool
    used: tuple[Bool[np.ndarray, " _"], ...] = ()
    refused: Mapping[MeasurementModel, Bool[np.ndarray, " _"]] = field(default_factory=dict)
    ids: Int[np.ndarray, " L"] = field(default_factory=lambda: np.zeros(0, dtype=int))
    points: Float[np.ndarray, "L 3"] = field(default_factory=lambda: np.zeros((0, 3)))
    counts: Int[np.ndarray, " L"] = field(default_factory=lambda: np.zeros(0, dtype=int))
    marginals: Marginals | None = None
    momentum_residual: float = np.nan
    noise_ratio: float | None = None
    departure: float = 0.0
    status: EstimatorStatus = field(default_factory=EstimatorStatus)
    guess: InitialGuess | None = None
    is_annealed_too: bool = False
    rivals: tuple["InitialEstimate", ...] = ()

    @classmethod
    def failed(cls, layout: StateLayout, epochs: int, reason: str) -> "InitialEstimate":
        """Failed estimate, of which no number is finite."""
        mean = np.full((epochs, layout.mean_dim), np.nan)
        prior = FirstStatePrior(mean[0], np.full(layout.error_dim, np.nan))
        factor = np.full((epochs, layout.error_dim, layout.error_dim), np.nan)
        status = EstimatorStatus().failed(
            f"the first epochs could not be smoothed ({reason})", "not-initialised"
        )
        return cls(layout, prior, mean, factor, np.nan, 0, 0, 0, 0, converged=False, status=status)

    @property
    def has_landmarks(self) -> bool:
        """Whether landmarks are unknowns."""
        return len(self.used) > 0

    @property
    def has_failed(self) -> bool:
        """Whether nothing of it is finite."""
        return self.status.verdict is Verdict.FAILED

    @property
    def has_states(self) -> bool:
        """Whether it has not failed, and all of its states are finite."""
        return not self.has_failed and bool(np.isfinite(self.mean).all())

    @cached_property
    def moments_std(self) -> float:
        """Largest standard deviation of a principal moment after it, relative to the largest moment."""
        return float(np.max(body_estimate(self.belief, intervals=False).principal_moments_std))

    @property
    def fit(self) -> float:
        """Root mean square of the whitened residuals: 1 when noise and model are right."""
        return float(np.sqrt(self.cost / max(self.dof, 1)))

    @property
    def belief(self) -> Gaussian:
        """Belief of the state at the last epoch."""
        return Gaussian(self.layout, self.mean[-1], self.factor[-1])

    def joint_belief(self, options: LandmarkOptions) -> Gaussian | LandmarkBelief:
        """Joint belief of the last state and all landmarks; not finite where unavailable."""
        if not self.has_landmarks:
            return self.belief
        if self.marginals is not None:
            return joint_belief(self.marginals, self.mean[-1], self.ids, self.points, options)
        n, roots = self.layout.error_dim, np.full((len(self.ids), 3, 3), np.nan)
        factor, move = np.full((n + 1, n + 1), np.nan), np.zeros(GAUGE_DIM)
        shared = roots[:, :, :1]
        return LandmarkBelief(self.layout, self.mean[-1], self.ids, self.points, shared, roots, factor, move)


MOST_MASKED = 2
"""Measurements that are refused besides those that the gates refuse, at most."""


@dataclass(frozen=True)
class SmoothingOptions:
    """Options of the smoothing of the first epochs.

    Attributes
    ----------
    iterations : int
        At most; 0 linearises at the guess and takes no step.
    gate : float
        Whitened length of an innovation of three components beyond which an observation counts as wrong.
    annealed : int
        Iterations in which the process noise may be inflated and the gate wide, at most.
    """

    iterations: int = 40
    gate: float = GATE
    annealed: int = 40

    def __post_init__(self) -> None:
        if self.iterations < 0 or not self.gate > 0:
            raise InputError(
                f"iterations is {self.iterations}, gate {self.gate}; give at least 0 and more than 0"
            )


def smooth_first_epochs(
    process: ProcessModel,
    epochs: Timeline,
    guess: InitialGuess,
    prior: FirstStatePrior,
    options: SmoothingOptions,
) -> InitialEstimate:
    """Iterate from a guess to the most probable motion and map, robust to wrong observations.

    Parameters
    ----------
    epochs : Timeline
        Observations of landmarks that the guess does not hold are left out.
    prior : FirstStatePrior
        Of the first state; with unknown landmarks its pose must be tight, for it defines g.

    Raises
    ------
    InputError
        When the guess has landmarks and none is observed twice, or the layout has no place for them.
    """
    order = np.argsort(guess.ids)
    ids, points = guess.ids[order], guess.points[order]
    problem = problem_of(process, epochs, ids, prior, OBSERVATIONS_NEEDED)
    if len(ids) and problem.observations is None:
        raise InputError(NOTHING_TWICE)
    here = problem.at(with_common_constants(process.layout, guess.trajectory), points)
    schedule = AnnealedSchedule(problem, min(options.annealed, options.iterations), options.gate)
    strict = IdleAnnealing(problem) if problem.observations is None and not options.annealed else None
    solved = solve(problem, here, SolverOptions(options.iterations), schedule, strict)
    if problem.observations is None and options.iterations:
        solved = _with_masked_refused(problem, solved, options)
    found = _with_map(_estimate(problem, solved, prior), problem, solved, options.gate)
    return replace(found, ids=ids[found.ids], is_annealed_too=strict is not None and strict.is_idle)


def _with_masked_refused(problem: Problem, solved: Solved, options: SmoothingOptions) -> Solved:
    """The solution without gross errors that bend the states towards themselves.

    A gate looks at residuals. Of a measurement that determines much of its epoch, as in the first and the last, a residual is
    what is left of the error: the others determine how far off it is. Refused once, it stays beyond the gate.
    """
    strict, settings = AnnealedSchedule(problem, 0, options.gate), SolverOptions(options.iterations)
    for _ in range(MOST_MASKED):
        masked = _most_masked(problem, solved, strict.pose_only_gate)
        if masked is None:
            break
        number, row = masked
        sensors = list(problem.motion.sensors)
        sensors[number] = sensors[number].chosen(np.arange(len(sensors[number].epoch)) != row)
        others = replace(problem, motion=replace(problem.motion, sensors=tuple(sensors)))
        schedule = AnnealedSchedule(others, 0, options.gate)
        rest = solve(others, others.at(solved.point.trajectory, solved.point.points), settings, schedule)
        again = solve(problem, problem.at(rest.point.trajectory, rest.point.points), settings, strict)
        if not again.converged or again.point.sensor_rows(problem.motion, number).counted[row]:
            break
        solved = replace(again, iterations=solved.iterations)
    return solved


def _most_masked(problem: Problem, solved: Solved, gate: float) -> tuple[int, int] | None:
    """Sensor and row of the measurement farthest from all others, None where all are within the gate (whitened)."""
    if solved.normal.solution is None or not solved.converged:
        return None
    marginals = Marginals(solved.normal.solution, solved.normal.eliminated)
    every = sensor_residuals(problem, solved.point, marginals)
    beyond = [float(chi_square_tail(gate**2, sensor.model.dim)) for sensor in problem.motion.sensors]
    least = [each.least_probability / limit for each, limit in zip(every, beyond, strict=True)]
    if not least or min(least) >= 1.0:
        return None
    number = int(np.argmin(least))
    return number, every[number].farthest


def _estimate(problem: Problem, solved: Solved, prior: FirstStatePrior) -> InitialEstimate:
    """The motion that was found, and how its pose-only observations fit."""
    here, solution, n = solved.point, solved.normal.solution, problem.layout.error_dim
    marginals = None if solution is None else Marginals(solution, solved.normal.eliminated)
    nothing = np.full((len(here.trajectory), n, n), np.nan)
    cost, dof, accepted, refused = here.sensors.cost + here.dynamics.cost, 0, 0, {}
    for k, sensor in enumerate(problem.motion.sensors):
        found = here.sensor_rows(problem.motion, k)
        costs, square = found.costs, found.squares
        inliers = (here.pose_only_loss or LeastSquares()).weight(square) > 0
        cost += float(square[inliers].sum() - costs.sum())
        accepted += int(np.count_nonzero(inliers))
        dof += int(np.count_nonzero(inliers)) * sensor.model.dim
        refused[sensor.model] = ~inliers
    return InitialEstimate(
        layout=problem.layout,
        prior=prior,
        mean=here.trajectory,
        factor=nothing if marginals is None else marginals.factors,
        cost=cost,
        dof=dof,
        accepted=accepted,
        rejected=sum(int(np.count_nonzero(each)) for each in refused.values()),
        iterations=solved.iterations,
        converged=solved.converged,
        refused=refused,
        marginals=marginals,
    )


def _with_map(found: InitialEstimate, problem: Problem, solved: Solved, gate: float) -> InitialEstimate:
    """With the landmarks that were found, and how their observations fit."""
    here, fit, observations = solved.point, solved.normal.eliminated, problem.observations
    if fit is None or observations is None or here.linear is None:
        return found
    inliers = int(np.count_nonzero(fit.used))
    return replace(
        found,
        cost=found.cost + float(here.linear.square[fit.used].sum()),
        dof=found.dof + here.linear.rows.shape[1] * inliers - 3 * int(np.count_nonzero(fit.is_constrained)),
        accepted=found.accepted + inliers,
        rejected=found.rejected + int(np.count_nonzero(here.linear.size >= gate)),
        used=observations.by_epoch(fit.used),
        ids=np.flatnonzero(fit.is_constrained),
        points=here.points[fit.is_constrained],
        counts=np.bincount(observations.landmark[fit.used], minlength=observations.landmarks)[
            fit.is_constrained
        ],
    )


DEFINED_ATTITUDE_STD = 1e-9
"""Of an attitude that defines a frame rather than being measured, rad."""


def guessed_trajectory(
    layout: StateLayout, epochs: Timeline, first: np.ndarray, evidence: InitialMotion
) -> Float[np.ndarray, "k m"]:
    """Guessed state per epoch: the nearest sample with the constants of the first state."""
    trajectory = np.tile(first, (len(epochs), 1))
    nearest = [int(np.argmin(np.abs(evidence.time - time))) for time in times_of(epochs)]
    trajectory[:, layout.mean_slice("a")] = evidence.attitude[nearest]
    trajectory[:, layout.mean_slice("w")] = evidence.rates[nearest]
    if evidence.positions is not None and layout.translates:
        trajectory[:, layout.mean_slice("t")] = evidence.positions[nearest]
    return trajectory


def wide_prior(
    layout: StateLayout, first: np.ndarray, options: InitialisationOptions, evidence: InitialMotion
) -> FirstStatePrior:
    """Wide prior of the first state at the measured pose and rate, tight only where the first epoch defines a frame."""
    mean, std = first.copy(), np.zeros(layout.error_dim)
    for block in layout.members:
        std[layout.slice(block.name)] = options.prior_std(block)
        if block.prior_at_origin:
            mean[layout.mean_slice(block.name)] = block.origin
    std[layout.slice(RATE.name)] = max(float(np.linalg.norm(evidence.rates, axis=1).max()), 1e-3)
    if evidence.defines_attitude and not layout.translates:
        std[layout.slice(ATTITUDE.name)] = DEFINED_ATTITUDE_STD
    return FirstStatePrior(mean, std)


def defining_g(
    layout: StateLayout, prior: FirstStatePrior, first: Float[np.ndarray, " m"]
) -> FirstStatePrior:
    """Prior whose first pose defines frame g. It is held where the state has a pose."""
    mean, std = prior.mean.copy(), prior.std.copy()
    for block in POSE_BLOCKS:
        mean[layout.mean_slice(block)] = first[layout.mean_slice(block)]
        std[layout.slice(block)] = GAUGE_STD
    return FirstStatePrior(mean, std)


SETTLED_FIT = 1.5
"""Rms of the whitened residuals below which a converged fit is believed without trying others."""
CLEAR_MASS_STD = 0.3
"""Of the mass distribution (log second moments) below which a fit is believed without trying others: on simulated poses all fits
with a second optimum were beyond 0.7, and all optima that were alone below 0.5."""
SAME_COST, SAME_MASS = 0.1, 0.3
"""Of two fits (cost; log second moments), within which they are one optimum."""
MOST_RIVALS = 2
"""Optima that are kept in addition to the likeliest: of simulated motions no third one ever became the likeliest at other noise."""


class InitialisableProcess(ProcessModel, Protocol):
    """Process model that refuses motions too fast to integrate."""

    def require_steps(self, time: Float[np.ndarray, " k"], rates: Float[np.ndarray, "k 3"]) -> None:
        """Require few enough substeps of these rates (rad/s). InputError: too many."""
        ...


def initialise(
    process: InitialisableProcess,
    timeline: Timeline,
    samples: MotionSamples,
    options: InitialisationOptions,
    likely: InitialEstimate | None = None,
) -> InitialEstimate:
    """Smooth the first epochs of a timeline, for any estimator over ``process.layout`` to continue from.

    Parameters
    ----------
    samples : MotionSamples
        Motion at (at least some of) those epochs, and the first guess of a map where landmarks are unknowns.
    likely : InitialEstimate or None
        Of the same motion, whose mass distribution is tried alone where a fit from it settles.

    Raises
    ------
    InputError
        Fewer than 4 samples, a body that does not rotate, landmarks of which none is observed twice.
    """
    epochs = timeline[: options.count(timeline)]
    evidence = initial_motion(samples, len(epochs))
    process.require_steps(evidence.time, evidence.rates)
    first, momentum_residual = initial_state(process.layout, evidence)
    trajectory = guessed_trajectory(process.layout, epochs, first, evidence)
    prior = wide_prior(process.layout, first, options, evidence)
    guess = InitialGuess(trajectory, NO_LANDMARKS, NO_POINTS)
    if samples.landmarks is not None:
        prior = defining_g(process.layout, prior, trajectory[0])
        guess = InitialGuess(trajectory, samples.landmarks.ids, samples.landmarks.points)
    problem = _FirstProblem(process, epochs, guess, prior, SmoothingOptions(options.iterations))
    found = problem.likeliest() if likely is None else problem.nearest(likely)
    status = found.status
    if not found.converged:
        status = status.degraded(
            f"the initialisation did not converge in {found.iterations} iterations",
            "initialisation-unsettled",
        )
    return replace(
        found,
        momentum_residual=momentum_residual,
        noise_ratio=samples.noise_ratio,
        status=status,
        guess=guess,
    )


def initialised_again(
    process: ProcessModel, timeline: Timeline, before: InitialEstimate, options: InitialisationOptions
) -> InitialEstimate | None:
    """Smooth the first epochs again at other noise levels, from their earlier estimate.

    Map and associations are those of the estimate; its rivals are smoothed too where the fit is not clear. None where it has fewer
    epochs, or no optimum settles: then the measurements are to be asked anew.
    """
    count = options.count(timeline)
    if before.guess is None or count > len(before.mean) or not np.isfinite(before.mean).all():
        return None
    tries: list[InitialEstimate] = []
    for optimum in (before, *before.rivals):
        guess = _guess_from(optimum, before.guess, count)
        smoothing = SmoothingOptions(options.iterations)
        tries.append(smooth_first_epochs(process, timeline[:count], guess, before.prior, smoothing))
        if _is_clear(tries[-1]):
            break
    found = _likeliest_of(tries, GATE)
    if not _has_settled(found):
        return None
    return replace(
        found,
        momentum_residual=before.momentum_residual,
        noise_ratio=before.noise_ratio,
        guess=before.guess,
    )


def _guess_from(optimum: InitialEstimate, guess: InitialGuess, count: int) -> InitialGuess:
    """Motion and landmarks of an optimum, other landmarks as first guessed."""
    points, order = guess.points.copy(), np.argsort(guess.ids)
    points[order[np.searchsorted(guess.ids, optimum.ids, sorter=order)]] = optimum.points
    return InitialGuess(optimum.mean[:count], guess.ids, points)


@dataclass(frozen=True)
class _FirstProblem:
    """First epochs, and where smoothing may begin."""

    process: ProcessModel
    epochs: Timeline
    guess: InitialGuess
    prior: FirstStatePrior
    options: SmoothingOptions

    def likeliest(self) -> InitialEstimate:
        """The likeliest of the fits from the guess and from bodies nearer to a sphere.

        A first fit that settles and determines the body is believed; else there may be several optima.
        """
        own = self.guess.trajectory[0, self._mass]
        return self._first([share * own for share in MASS_SHARES], _is_clear)

    def nearest(self, likely: InitialEstimate) -> InitialEstimate:
        """The fit from the mass distribution of another estimate of the motion."""
        body = likely.mean[-1, likely.layout.mean_slice(MASS_DISTRIBUTION.name)]
        found = self._first([body], _has_settled) if np.isfinite(body).all() else None
        return found if found is not None and _has_settled(found) else self.likeliest()

    def _first(
        self, masses: Sequence[Float[np.ndarray, " 5"]], believed: Callable[[InitialEstimate], bool]
    ) -> InitialEstimate:
        """The first fit that is believed, else the likeliest."""
        tries: list[InitialEstimate] = []
        strict = replace(self.options, annealed=0)
        every = (
            (self.options,) if len(self.guess.ids) else (strict, self.options)
        )  # strict would lose landmarks
        for mass, own in product(masses, every):
            if own is not every[0] and tries[-1].is_annealed_too:
                continue
            trajectory = self.guess.trajectory.copy()
            trajectory[:, self._mass] = mass
            guess = replace(self.guess, trajectory=trajectory)
            tries.append(smooth_first_epochs(self.process, self.epochs, guess, self.prior, own))
            if believed(tries[-1]):
                break
        return _likeliest_of(tries, self.options.gate)

    @property
    def _mass(self) -> slice:
        return self.process.layout.mean_slice(MASS_DISTRIBUTION.name)


def _likeliest_of(tries: Sequence[InitialEstimate], gate: float) -> InitialEstimate:
    """The likeliest fit, with the other optima among them as its rivals."""
    best, *others = sorted(tries, key=lambda found: _with_rejected(found, gate))
    rivals: list[InitialEstimate] = []
    for each in others:
        finite = np.isfinite(each.mean).all() and np.isfinite(each.cost)
        if finite and not any(_is_same(each, optimum) for optimum in (best, *rivals)):
            rivals.append(replace(each, marginals=None))
    return replace(best, rivals=tuple(rivals[:MOST_RIVALS]))


def _is_same(one: InitialEstimate, other: InitialEstimate) -> bool:
    """Whether two fits are one optimum."""
    mass = one.layout.mean_slice(MASS_DISTRIBUTION.name)
    away = np.abs(one.mean[-1, mass] - other.mean[-1, mass]).max()
    return bool(abs(one.cost - other.cost) < SAME_COST and away < SAME_MASS)


def _is_clear(found: InitialEstimate) -> bool:
    """Whether a fit has converged and determines the mass distribution."""
    mass_std = np.linalg.norm(found.factor[-1, found.layout.slice(MASS_DISTRIBUTION.name)], axis=1)
    return bool(_has_settled(found) and mass_std.max() <= CLEAR_MASS_STD)


def _has_settled(found: InitialEstimate) -> bool:
    """Whether a fit has converged and explains its observations."""
    return bool(found.converged and found.fit < SETTLED_FIT and found.rejected <= found.accepted)


def _with_rejected(found: InitialEstimate, gate: float) -> float:
    """Cost that counts a rejected observation as one at the gate, so that a fit gains nothing by rejecting."""
    cost = found.cost + found.rejected * gate**2
    return cost if np.isfinite(cost) else np.inf
