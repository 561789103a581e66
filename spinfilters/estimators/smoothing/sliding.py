"""A smoother that takes one frame after the other and re-solves what it keeps after each."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Measurement, ProcessModel
from spinfilters.estimators.smoothing.closed_form import at_closed_form, fits
from spinfilters.estimators.smoothing.latest_pose import latest_pose
from spinfilters.estimators.smoothing.marginalisation import without_landmarks, without_oldest
from spinfilters.estimators.smoothing.marginals import Marginals
from spinfilters.estimators.smoothing.modes import DETERMINED
from spinfilters.estimators.smoothing.motion import StatePrior
from spinfilters.estimators.smoothing.newest import newest_factor
from spinfilters.estimators.smoothing.newest_sightings import is_strange, with_landmarks_put_right
from spinfilters.estimators.smoothing.problem import Normal, Point, Problem, Stage
from spinfilters.estimators.smoothing.reduced import Reduced
from spinfilters.estimators.smoothing.robust_kernels import RobustKernel
from spinfilters.estimators.smoothing.sliding_records import TRUSTED, Memory, Retired, SlidingOptions, Taken
from spinfilters.estimators.smoothing.solver import Plain, SolverOptions, advanced, moved, solve
from spinfilters.estimators.smoothing.step_rules import GaussNewton
from spinfilters.estimators.smoothing.undetermined import undetermined_directions
from spinfilters.estimators.smoothing.window import Window
from spinfilters.estimators.timeline import Frame, Timeline
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.status import EstimatorStatus

SURPRISE = 10.0
"""Fall of the cost per scalar measurement of the newest frame from which a step is checked and followed by another."""
LOOSE, SETTLED_COST = 0.05, 1.0
"""Standard deviation of the mass distribution above which a frame is iterated until the cost falls by less than the second number:
what is believed of a body hardly known is curved, and a covariance from one step before would lie."""
SETTLED = 3
"""Frames in a row after which the inertia must have been determined before a frame leaves."""


class SlidingSmoother:
    """Smoothing after every frame.

    Parameters
    ----------
    process: of the motion.   prior: of the first frame's state; its pose says where g is.
    tied: whether there are sightings of landmarks.
    """

    def __init__(self, process: ProcessModel, prior: StatePrior, options: SlidingOptions, tied: bool) -> None:
        self.process, self.options, self._tied = process, options, tied
        self._prior, self.memory = prior, Memory()
        self._linear: tuple[Point, Normal] | None = None
        self.window = Window.empty(process.layout.mean_dim)

    def resume(self, window: Window, memory: Memory) -> None:
        """Go on from a window that was taken in before; it is linearised where it is when that is asked for."""
        self.window, self.memory, self._linear = window, memory, None

    def begin(
        self,
        frames: Timeline,
        trajectory: Float[np.ndarray, "k m"],
        ids: Int[np.ndarray, " L"],
        points: Float[np.ndarray, "L 3"],
    ) -> list[Taken]:
        """Take in the first frames at once, with states and landmarks (m, frame g) that a start has found for them."""
        ends = []
        for frame, state in zip(frames, trajectory, strict=True):
            self.window = self.window.opened(frame.time, state)
            ends.append(self._extended(frame.measurements))
        self.window = self.window.placed(ids, points)
        _, problem = self._solved(frames[-1].measurements)
        self._remember(problem)
        every = zip(frames, ends, strict=True)
        return [Taken.counted(f.measurements, self._weights(k, end), 1) for k, (f, end) in enumerate(every)]

    def add(self, frame: Frame, guess: Float[np.ndarray, " 7"] | None = None) -> Taken:
        """Take in a frame.

        Parameters
        ----------
        guess: pose (t m, q_ig) to begin from; without it the last state is predicted.

        Raises
        ------
        InputError: when time does not go forwards.
        """
        self.window = self.window.opened(frame.time, self._guess(frame.time, guess))
        return self.extend(frame.measurements)

    def extend(self, measurements: tuple[Measurement, ...]) -> Taken:
        """Take in measurements of the newest frame, beside those it has; solve, and let go what the mode lets go."""
        ends = self._extended(measurements)
        count, problem = self._solved(measurements)
        self._remember(problem)
        count += self._from_closed_form(problem)
        taken = Taken.counted(measurements, self._weights(len(self.window.frames) - 1, ends), count)
        return replace(taken, retired=self._slide(problem))

    def problem(self) -> Problem:
        """The least-squares problem of the window."""
        prior = self._prior if self.memory.prior_alive else None
        return self.window.problem(self.process, prior, self._tied)

    @property
    def belief(self) -> Gaussian:
        """Of the newest frame; its factor is not finite where something is not determined."""
        return Gaussian(self.process.layout, self.window.trajectory[-1], self._newest_factor())

    @property
    def mass_std(self) -> float:
        """Largest standard deviation of the mass distribution (logarithm of second moments)."""
        return self.memory.mass_std

    @property
    def status(self) -> EstimatorStatus:
        """Whether the belief of the latest epoch can be relied upon already, and if not, why."""
        return self.memory.status

    def smoothed(self, frames: int | None = None) -> list[Retired]:
        """Frames of the window with their covariances: all, or so many of the oldest."""
        solution, n = self._linearised()[1].solution, self.process.layout.error_dim
        count = len(self.window.frames) if frames is None else frames
        if isinstance(solution, int):
            factors = np.full((count, n, n), np.nan)
        else:
            gone = solution.unknowns.frames - len(self.window.frames)
            factors = Marginals(solution, None).first_factors(gone + count)[gone:]
        rows = zip(self.window.frames[:count], self.window.trajectory, factors, strict=False)
        return [Retired(frame.time, mean, factor) for frame, mean, factor in rows]

    def settle(self) -> None:
        """Iterate on what the window holds until nothing moves: one step per frame leaves a little to be gained."""
        problem = self.problem()
        here = problem.at(self.window.trajectory, self.window.points)
        solved = solve(problem, here, SolverOptions(), Plain(self.options.sighting_kernel))
        here = solved.point
        self.window = replace(self.window, trajectory=here.trajectory, points=here.points)
        self._linear = (here, solved.normal)
        self._remember(problem)

    def counts(self) -> Int[np.ndarray, "k 2"] | None:
        """Values of every epoch that count, and that do not; None where a part of them has been marginalized."""
        if self.window.carried is not None:
            return None
        found = []
        for k, frame in enumerate(self.window.frames):
            ends = np.searchsorted(self.window.seen.frame, [k, k + 1])
            (weight,) = self._weights(k, ends.tolist())
            good, beside = int(np.count_nonzero(weight > 0)), sum(len(m.values) for m in frame.measurements)
            found.append((beside + good, len(weight) - good))
        return np.array(found)

    def undetermined(self) -> list[str]:
        """What the measurements so far do not determine, in words; only while the first frame is in the window."""
        here, normal = self._linearised()
        if len(here.trajectory) != len(self.window.frames):
            return []
        return undetermined_directions(self.problem(), here, normal)

    def _guess(self, time: float, guess: np.ndarray | None) -> Float[np.ndarray, " m"]:
        """A first state for a new frame: predicted, at the guessed pose."""
        if self.window.frames:
            dt = time - self.window.frames[-1].time
            if not dt > 0:
                raise InputError(
                    f"time goes from {self.window.frames[-1].time} s to {time} s; frames must be in the order of time"
                )
            state = self.process.step(self.window.trajectory[-1], dt)
        else:
            state = self._prior.mean.copy()
        if guess is not None:
            layout = self.process.layout
            state[layout.mean_slice("t")], state[layout.mean_slice("a")] = guess[:3], guess[3:]
        return state

    def _solved(self, measurements: tuple[Measurement, ...]) -> tuple[int, Problem]:
        """Linearise, and bring the window's states one step beyond the last linearisation; and how many there were."""
        problem, loss = self.problem(), self.options.sighting_kernel
        here = self._found_back(problem, problem.at(self.window.trajectory, self.window.points), loss)
        here, normal = _linear_problem(problem, here, loss)
        surprise = SURPRISE * self._measured(measurements) if self.mass_std <= LOOSE else SETTLED_COST
        count = 1
        while count < self.options.iterations and normal.solved and normal.decrement > surprise:
            there, _, _ = advanced(problem, here, normal, (GaussNewton(), 1.0))
            if there is None:
                break
            here, normal = _linear_problem(problem, there, loss)
            count += 1
        step = GaussNewton().propose(lambda _: normal, problem.layout, 1.0) if normal.solved else None
        trajectory, points = (here.trajectory, here.points) if step is None else moved(problem, here, step)
        self.window = replace(self.window, trajectory=trajectory, points=points)
        self._linear = (here, normal)
        return count, problem

    def _remember(self, problem: Problem) -> None:
        """What the last linear problem says of the whole."""
        here, normal = self._linearised(problem)
        solution = normal.solution
        self.memory.mass_std = np.inf if isinstance(solution, int) else solution.mass_std
        self.memory.fits = fits(here, normal)

    def _linearised(self, problem: Problem | None = None) -> tuple[Point, Normal]:
        """The last linear problem; after `resume` about where the window is."""
        if self._linear is None:
            problem = problem or self.problem()
            here = problem.at(self.window.trajectory, self.window.points)
            self._linear = _linear_problem(problem, here, self.options.sighting_kernel)
        return self._linear

    def _found_back(self, problem: Problem, here: Point, kernel: RobustKernel) -> Point:
        """With the latest epoch where its observations agree, if its guess was so poor that the loss would reject them."""
        self.memory.strange = False
        if not is_strange(problem, here, kernel):
            return here
        pose = latest_pose(problem, here.trajectory, here.points)
        self.memory.strange = pose is None
        if pose is None:
            return here
        self.window = self.window.latest_at(pose)
        return problem.at(self.window.trajectory, self.window.points)

    def _measured(self, measurements: tuple[Measurement, ...]) -> int:
        """Scalar measurements that are new, and unknowns of a state."""
        return sum(m.values.size for m in measurements) + self.process.layout.error_dim

    def _from_closed_form(self, problem: Problem) -> int:
        """While the inertia is not determined, the closed form of the momentum may know a better place to go on from.

        Returns how many linearisations it took to see.
        """
        if self.mass_std <= (TRUSTED if self.memory.fits else DETERMINED):
            return 0
        if not self.memory.tried.due(len(self.window.frames), self.memory.fits):
            return 0
        stage, times = self._linearised()[1].stage, np.array([frame.time for frame in self.window.frames])
        now = problem.at(self.window.trajectory, self.window.points)
        found, tries = at_closed_form(problem, now, stage, times)
        if found is not None:
            here, normal = _linear_problem(problem, found, stage.kernel)
            self._linear = (here, normal)
            self.window = replace(self.window, trajectory=here.trajectory, points=here.points)
            self._remember(problem)
        return tries + 1

    def _extended(self, measurements: tuple[Measurement, ...]) -> list[int]:
        """Put measurements into the newest frame; where their observations begin and end in the window."""
        ends = [len(self.window.seen.frame)]
        for measurement in measurements:
            self.window = self.window.extended(measurement)
            ends.append(len(self.window.seen.frame))
        return ends

    def _weights(self, frame: int, ends: list[int]) -> list[Float[np.ndarray, " n"]]:
        """Of the observations of a frame between these ends; zero where there is no solution."""
        seen, fit = self.window.seen, self._linearised()[1].eliminated
        landmark = seen.landmark[seen.frame == frame]
        weight = np.zeros(len(landmark))
        if fit is not None:
            weight[np.argsort(landmark, kind="stable")] = fit.weight[fit.sightings.frame == frame]
        first = int(np.searchsorted(seen.frame, frame))
        return np.split(weight, np.array(ends) - first)[1:-1]

    def _slide(self, problem: Problem) -> tuple[Retired, ...]:
        """Let go what the mode lets go."""
        at = self._linearised()
        window, mode, std = self.window, self.options.mode, self.mass_std
        self.memory.determined = (
            self.memory.determined + 1 if std <= mode.determined and not self.memory.strange else 0
        )
        landmarks = mode.frozen(window, self.process.layout)
        over = mode.leaving(len(window.frames), std if self.memory.determined >= SETTLED else np.inf)
        if over < 1 or not at[1].solved:
            if landmarks.any() and at[1].solved:
                self.window = without_landmarks(window, problem, at, landmarks)
            return ()
        landmarks[window.seen.landmark[window.seen.frame < over]] = True
        retired = self._leaving(over)
        self.window = without_oldest(window, problem, at, landmarks, over)
        self.memory.prior_alive = False
        return retired

    def _leaving(self, count: int) -> tuple[Retired, ...]:
        return tuple(self.smoothed(count)) if self.options.retired else ()

    def _newest_factor(self) -> Float[np.ndarray, "n n"]:
        solution = self._linearised()[1].solution
        if isinstance(solution, Reduced):
            return newest_factor(solution)
        n = self.process.layout.error_dim
        return np.full((n, n), np.nan)


def _linear_problem(problem: Problem, here: Point, kernel: RobustKernel) -> tuple[Point, Normal]:
    """About the point, or one at which misplaced landmarks have been put right."""
    stage = Stage(kernel)
    here = with_landmarks_put_right(problem, here, stage)
    return here, problem.normal(here, stage)
