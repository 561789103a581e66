"""Sliding-window smoother, solved again after every epoch: options, results, and estimates with covariances."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.errors import InputError
from spinfilters.core.robust_losses import Gate, RobustLoss
from spinfilters.filters.estimator import LandmarkBelief, Measurement, ProcessModel
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.filters.timeline import Epoch, Timeline
from spinfilters.models.state_layout import Gaussian, StateLayout
from spinfilters.models.status import EstimatorStatus, Finding
from spinfilters.smoother.linear_system import Marginals, joint_belief, latest_factor
from spinfilters.smoother.marginalization import without_landmarks, without_oldest
from spinfilters.smoother.priors import StatePrior
from spinfilters.smoother.problem import (
    LinearizationPoint,
    LinearProblem,
    NormalEquations,
    Problem,
    unobservable_directions,
)
from spinfilters.smoother.restarts import (
    RetrySchedule,
    fits,
    is_poor_guess,
    latest_pose,
    linear_problem,
    observation_weights,
    restarted_from_momentum,
    with_few_joined,
)
from spinfilters.smoother.solver import (
    ConstantSchedule,
    GaussNewton,
    SolverOptions,
    StepRule,
    advanced,
    moved,
    solve,
)
from spinfilters.smoother.window import DETERMINED, LandmarkMarginalization, Window, WindowPolicy

TRUSTED = 0.15
"""Standard deviation of the mass distribution from which the belief is trusted: before, it may sit in a wrong minimum, or be curved
more than a covariance describes (NEES of a hundred times the degrees of freedom above 0.3 on simulated motions, as it should be
below 0.2)."""


@dataclass(frozen=True)
class SmootherOptions:
    """Options of a sliding smoother.

    Attributes
    ----------
    policy : WindowPolicy
        Which epochs and landmarks the window keeps.
    gate : float
        Standard deviations beyond which an observation counts as a wrong association.
    iterations : int
        Largest number of iterations per epoch; one suffices where the initial guess is good.
    marginalized : bool
        Whether epochs that leave are handed back with their covariance, which costs a factorisation more.
    loss : RobustLoss or None
        Robust loss of an observation's residual, in place of the gate.
    step_rule : StepRule
        How far a step of an iteration goes.
    """

    policy: WindowPolicy = field(default_factory=LandmarkMarginalization)
    gate: float = 5.0
    iterations: int = 4
    marginalized: bool = True
    loss: RobustLoss | None = None
    step_rule: StepRule = field(default_factory=GaussNewton)

    def __post_init__(self) -> None:
        if self.iterations < 1 or not self.gate > 0:
            raise InputError(
                f"iterations is {self.iterations}, gate {self.gate}; give at least 1 and more than 0"
            )

    @property
    def observation_loss(self) -> RobustLoss:
        """The loss, or the gate."""
        return Gate(self.gate, self.gate) if self.loss is None else self.loss


@dataclass(frozen=True)
class MarginalizedState:
    """Final estimate of an epoch that left the window."""

    time: float
    mean: Float[np.ndarray, " m"]
    factor: Float[np.ndarray, "n n"]


@dataclass(frozen=True)
class UpdateResult:
    """Result of adding an epoch.

    Attributes
    ----------
    accepted, rejected : int
        Values that count and that do not.
    linearisations : int
        Number of linearisations.
    marginalized : tuple[MarginalizedState, ...]
        Epochs that left the window.
    counts : tuple[tuple[int, int], ...]
        Accepted and rejected by measurement.
    """

    accepted: int
    rejected: int
    linearisations: int
    marginalized: tuple[MarginalizedState, ...] = ()
    counts: tuple[tuple[int, int], ...] = ()

    @classmethod
    def counted(
        cls, measurements: Sequence[Measurement], weights: list[Float[np.ndarray, " n"]], linearisations: int
    ) -> "UpdateResult":
        """Result from the weights of observations; landmark-free measurements count all values."""
        counts = []
        for m, weight in zip(measurements, weights, strict=True):
            good = len(m.values) if m.ids is None else int(np.count_nonzero(weight > 0))
            counts.append((good, len(m.values) - good))
        accepted, rejected = (sum(count[side] for count in counts) for side in (0, 1))
        return cls(accepted, rejected, linearisations, counts=tuple(counts))


@dataclass
class SmootherState:
    """State of a sliding smoother apart from its window.

    Attributes
    ----------
    prior_alive : bool
        Whether the first epoch's prior still stands by itself.
    poor_guess : bool
        Whether the latest epoch's initial guess was poor.
    determined : int
        Epochs in a row after which the inertia was determined.
    retry_schedule : RetrySchedule
        When the closed form is asked again.
    mass_std : float
        Largest standard deviation of the mass distribution (logarithm of second moments) after the last epoch.
    fits : bool
        Whether the last epoch's solution explained what was measured within its noise.
    """

    prior_alive: bool = True
    poor_guess: bool = False
    determined: int = 0
    retry_schedule: RetrySchedule = field(default_factory=RetrySchedule)
    mass_std: float = np.inf
    fits: bool = True

    @property
    def status(self) -> EstimatorStatus:
        """Whether the belief of the latest epoch can be relied upon already, and if not, why."""
        status, std = EstimatorStatus(), self.mass_std
        if not std <= TRUSTED:
            status = status.degraded(
                f"the inertia is not determined yet (standard deviation {std:.2g} of the logarithm of second moments, "
                f"at most {TRUSTED} is trusted)",
                "inertia-not-yet",
            )
        if not self.fits:
            status = status.degraded(
                "the motion found does not explain the observations within their noise", "poor-fit"
            )
        if self.poor_guess:
            status = status.degraded("the latest epoch's observations agree on no pose", "no-pose")
        return status


def latest_belief(layout: StateLayout, window: Window, normal: NormalEquations) -> Gaussian:
    """Belief of the latest epoch; its factor is NaN where something is not determined."""
    solution, n = normal.solution, layout.error_dim
    factor = np.full((n, n), np.nan) if solution is None else latest_factor(solution)
    return Gaussian(layout, window.trajectory[-1], factor)


def joint_latest_belief(
    normal: NormalEquations,
    mean: Float[np.ndarray, " m"],
    ids: Int[np.ndarray, " L"],
    points: Float[np.ndarray, "L 3"],
    options: LandmarkOptions,
) -> LandmarkBelief | None:
    """Belief of the latest epoch and of all well-constrained landmarks; None without any."""
    if normal.solution is None or normal.eliminated is None:
        return None
    constrained = normal.eliminated.is_constrained
    if not constrained.any():
        return None
    marginals = Marginals(normal.solution, normal.eliminated)
    return joint_belief(marginals, mean, ids[constrained], points[constrained], options)


def window_marginals(
    layout: StateLayout, window: Window, normal: NormalEquations, epochs: int | None
) -> list[MarginalizedState]:
    """Marginals of the epochs of a window: of all, or of so many of the oldest."""
    solution, n = normal.solution, layout.error_dim
    count = len(window.epochs) if epochs is None else epochs
    if solution is None:
        factors = np.full((count, n, n), np.nan)
    else:
        gone = solution.ordering.epochs - len(window.epochs)
        factors = Marginals(solution, None).first_factors(gone + count)[gone:]
    rows = zip(window.epochs[:count], window.trajectory, factors, strict=False)
    return [MarginalizedState(epoch.time, mean, factor) for epoch, mean, factor in rows]


def predicted_state(
    process: ProcessModel,
    prior: StatePrior,
    window: Window,
    time: float,
    pose: Float[np.ndarray, " 7"] | None = None,
) -> Float[np.ndarray, " m"]:
    """Initial state of a new epoch.

    Predicted from the latest, or the prior's mean; at a pose (t m, q_ig) where one is given.
    """
    if window.epochs:
        latest = window.epochs[-1].time
        if not time > latest:
            raise InputError(f"time goes from {latest} s to {time} s; epochs must be in the order of time")
        state = process.step(window.trajectory[-1], time - latest)
    else:
        state = prior.mean.copy()
    if pose is not None:
        state[process.layout.mean_slice("t")], state[process.layout.mean_slice("a")] = pose[:3], pose[3:]
    return state


COST_THRESHOLD = 10.0
"""Fall of the cost per scalar measurement of the latest epoch from which a step is checked and followed by another."""
LOOSE, SETTLED_COST = 0.05, 1.0
"""Standard deviation of the mass distribution above which an epoch is iterated until the cost falls by less than the second number:
what is believed of a body hardly known is curved, and a covariance from one step before would lie."""
SETTLED = 3
"""Epochs in a row after which the inertia must have been determined before an epoch leaves."""


class SlidingSmoother:
    """Smoothing after every epoch.

    Parameters
    ----------
    process : ProcessModel
        Process model of the motion.
    prior : StatePrior
        Prior of the first epoch's state; its pose defines frame g.
    has_landmarks : bool
        Whether there are observations of landmarks.
    """

    def __init__(
        self, process: ProcessModel, prior: StatePrior, options: SmootherOptions, has_landmarks: bool
    ) -> None:
        self.process, self.options, self._has_landmarks = process, options, has_landmarks
        self._prior, self.state = prior, SmootherState()
        self._linear: LinearProblem | None = None
        self.at_levels: Callable[[Problem], Problem] = lambda problem: problem
        """The window's problem at other noise levels than those that the measurements came with."""
        self.window = Window.empty(process.layout.mean_dim)
        self._landmarks = self.window.ids, self.window.points
        """Of the linear problem; some have left the window since."""

    def resume(self, window: Window, state: SmootherState) -> None:
        """Continue from the window of a snapshot, linearised again if asked for."""
        self.window, self.state, self._linear = window, state, None
        self._landmarks = window.ids, window.points

    def begin(
        self,
        epochs: Timeline,
        trajectory: Float[np.ndarray, "k m"],
        ids: Int[np.ndarray, " L"],
        points: Float[np.ndarray, "L 3"],
    ) -> list[UpdateResult]:
        """Add the first epochs, with states and landmarks (m, frame g) of an initialisation."""
        ends = []
        for epoch, state in zip(epochs, trajectory, strict=True):
            self.window = self.window.opened(epoch.time, state)
            ends.append(self._extend_latest(epoch.measurements))
        self.window = self.window.placed(ids, points)
        _, problem = self._iterate_window(epochs[-1].measurements)
        self._remember(problem)
        weights = [self._weights(k, end) for k, end in enumerate(ends)]
        return [UpdateResult.counted(f.measurements, w, 1) for f, w in zip(epochs, weights, strict=True)]

    def add(self, epoch: Epoch, guess: Float[np.ndarray, " 7"] | None = None) -> UpdateResult:
        """Take in an epoch.

        Parameters
        ----------
        guess : ndarray of float, shape (7,) or None
            Pose (t m, q_ig) to begin from; without it the last state is predicted.

        Raises
        ------
        InputError
            When time does not go forwards.
        """
        self.window = self.window.opened(
            epoch.time, predicted_state(self.process, self._prior, self.window, epoch.time, guess)
        )
        return self.extend(epoch.measurements)

    def add_all(self, epochs: Sequence[Epoch]) -> UpdateResult:
        """Take in gathered epochs, solve once, and return the last one's result."""
        for epoch in epochs[:-1]:
            self.window = self.window.opened(
                epoch.time, predicted_state(self.process, self._prior, self.window, epoch.time)
            )
            self._extend_latest(epoch.measurements)
        return self.add(epochs[-1])

    def extend(self, measurements: tuple[Measurement, ...]) -> UpdateResult:
        """Add measurements of the latest epoch, solve, and marginalize by the window policy."""
        ends = self._extend_latest(measurements)
        count, problem = self._iterate_window(measurements)
        self._remember(problem)
        count += self._restarted_from_momentum(problem)
        taken = UpdateResult.counted(measurements, self._weights(len(self.window.epochs) - 1, ends), count)
        return replace(taken, marginalized=self._slide(problem))

    def problem(self) -> Problem:
        """The least-squares problem of the window."""
        prior = self._prior if self.state.prior_alive else None
        return self.at_levels(self.window.problem(self.process, prior, self._has_landmarks))

    @property
    def solution(self) -> LinearProblem:
        """The last linear problem, with its solution."""
        return self._linearised()

    @property
    def belief(self) -> Gaussian:
        """Belief of the latest epoch; its factor is not finite where unobservable."""
        return latest_belief(self.process.layout, self.window, self._linearised().normal)

    def joint_belief(self, options: LandmarkOptions) -> Gaussian | LandmarkBelief:
        """Joint belief of the latest epoch and all well-constrained landmarks."""
        belief = joint_latest_belief(
            self._linearised().normal, self.window.trajectory[-1], *self._landmarks, options
        )
        return self.belief if belief is None else belief

    @property
    def mass_std(self) -> float:
        """Largest standard deviation of the mass distribution (logarithm of second moments)."""
        return self.state.mass_std

    @property
    def status(self) -> EstimatorStatus:
        """Whether the belief of the latest epoch can be relied upon already, and if not, why."""
        return self.state.status

    def smoothed(self, epochs: int | None = None) -> list[MarginalizedState]:
        """Epochs of the window with their covariances: all, or so many of the oldest."""
        return window_marginals(self.process.layout, self.window, self._linearised().normal, epochs)

    def settle(self) -> None:
        """Iterate on the window until it converges."""
        problem = self.problem()
        here = problem.at(self.window.trajectory, self.window.points)
        solved = solve(
            problem,
            here,
            SolverOptions(rule=self.options.step_rule),
            ConstantSchedule(self.options.observation_loss),
        )
        self._move_to(LinearProblem(solved.point, solved.normal))
        self._remember(problem)

    def counts(self) -> Int[np.ndarray, "k 2"] | None:
        """Accepted and rejected values per epoch, None where some are marginalized."""
        if self.window.marginal_prior is not None:
            return None
        found = []
        for k, epoch in enumerate(self.window.epochs):
            ends = np.searchsorted(self.window.seen.epoch, [k, k + 1])
            (weight,) = self._weights(k, ends.tolist())
            good, beside = int(np.count_nonzero(weight > 0)), sum(len(m.values) for m in epoch.measurements)
            found.append((beside + good, len(weight) - good))
        return np.array(found)

    def unobservable(self) -> list[Finding]:
        """Findings of unobservable directions so far. Only while the first epoch is in the window."""
        linear = self._linearised()
        if len(linear.point.trajectory) != len(self.window.epochs):
            return []
        return unobservable_directions(self.problem(), linear.point, linear.normal)

    def _iterate_window(self, measurements: tuple[Measurement, ...]) -> tuple[int, Problem]:
        """Relinearise and iterate; the number of iterations is returned too."""
        problem, loss = self.problem(), self.options.observation_loss
        here = self._found_back(problem, problem.at(self.window.trajectory, self.window.points), loss)
        linear = linear_problem(problem, here, loss)
        scalars = sum(m.values.size for m in measurements) + self.process.layout.error_dim
        threshold = COST_THRESHOLD * scalars if self.mass_std <= LOOSE else SETTLED_COST
        rule, count = self.options.step_rule, 1
        number = rule.first  # of the step rule: each epoch begins anew
        while count < self.options.iterations and linear.normal.solved:
            if not linear.normal.predicted_reduction > threshold:
                break
            there, number, _ = advanced(problem, linear.point, linear.normal, rule, number)
            if there is None:
                break
            linear, count = linear_problem(problem, there, loss), count + 1
        self.window = _step_window(self.window, problem, linear, rule, number)
        self._linear = linear
        return count, problem

    def _move_to(self, linear: LinearProblem) -> None:
        self.window = replace(self.window, trajectory=linear.point.trajectory, points=linear.point.points)
        self._linear = linear

    def _remember(self, problem: Problem) -> None:
        """Keep what the last linear problem determines of the whole run."""
        linear = self._linearised(problem)
        solution = linear.normal.solution
        self._landmarks = self.window.ids, self.window.points
        self.state.mass_std = np.inf if solution is None else solution.mass_std
        self.state.fits = fits(linear.point, linear.normal)

    def _linearised(self, problem: Problem | None = None) -> LinearProblem:
        """The last linear problem; after `resume` about where the window is."""
        if self._linear is None:
            problem = problem or self.problem()
            here = problem.at(self.window.trajectory, self.window.points)
            self._linear = linear_problem(problem, here, self.options.observation_loss)
        return self._linear

    def _found_back(self, problem: Problem, here: LinearizationPoint, loss: RobustLoss) -> LinearizationPoint:
        """Latest epoch moved to its observations, if its guess is poor."""
        self.state.poor_guess = False
        if not is_poor_guess(problem, here, loss):
            return here
        pose = latest_pose(problem, here.trajectory, here.points)
        if pose is None:
            joined = with_few_joined(problem, here, loss)
            self.state.poor_guess = joined is None
            return here if joined is None else joined
        self.window = self.window.latest_at(pose)
        return problem.at(self.window.trajectory, self.window.points)

    def _restarted_from_momentum(self, problem: Problem) -> int:
        """Linearisations of a restart from conserved momentum, tried while the inertia is not determined."""
        if self.mass_std <= (TRUSTED if self.state.fits else DETERMINED):
            return 0
        if not self.state.retry_schedule.is_due(len(self.window.epochs), self.state.fits):
            return 0
        linear = self._linearised()
        found, tries = restarted_from_momentum(problem, self.window, linear)
        if found is not None:
            self._move_to(linear_problem(problem, found, linear.normal.stage.loss))
            self._remember(problem)
        return tries + 1

    def _extend_latest(self, measurements: tuple[Measurement, ...]) -> list[int]:
        """Put measurements into the latest epoch; where their observations begin and end in the window."""
        ends = [len(self.window.seen.epoch)]
        for measurement in measurements:
            self.window = self.window.extended(measurement)
            ends.append(len(self.window.seen.epoch))
        return ends

    def _weights(self, epoch: int, ends: list[int]) -> list[Float[np.ndarray, " n"]]:
        return observation_weights(self.window, self._linearised().normal, epoch, ends)

    def _slide(self, problem: Problem) -> tuple[MarginalizedState, ...]:
        """Let go what the mode lets go."""
        linear = self._linearised()
        window, policy, std = self.window, self.options.policy, self.mass_std
        self.state.determined = (
            self.state.determined + 1 if std <= policy.determined and not self.state.poor_guess else 0
        )
        landmarks = policy.marginalized_landmarks(window, self.process.layout)
        over = policy.batch_size(len(window.epochs), std if self.state.determined >= SETTLED else np.inf)
        if over < 1 or not linear.normal.solved:
            if landmarks.any() and linear.normal.solved:
                self.window = without_landmarks(window, problem, linear, landmarks)
            return ()
        landmarks[window.seen.landmark[window.seen.epoch < over]] = True
        marginalized = tuple(self.smoothed(over)) if self.options.marginalized else ()
        self.window = without_oldest(window, problem, linear, landmarks, over)
        self.state.prior_alive = False
        return marginalized


def _step_window(
    window: Window, problem: Problem, linear: LinearProblem, rule: StepRule, number: float
) -> Window:
    """The window one step beyond the last linearisation, if the linear problem has a solution."""
    here, normal = linear.point, linear.normal
    step = rule.propose(lambda _: normal, problem.layout, number) if normal.solved else None
    trajectory, points = (here.trajectory, here.points) if step is None else moved(problem, here, step)
    return replace(window, trajectory=trajectory, points=points)
