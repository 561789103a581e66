"""A smoother that takes one frame after the other and re-solves what it keeps after each."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import ProcessModel
from spinfilters.estimators.first_frames import FirstStatePrior
from spinfilters.estimators.smoothing.closed_form import at_closed_form, fits
from spinfilters.estimators.smoothing.marginalisation import without_landmarks, without_oldest
from spinfilters.estimators.smoothing.marginals import Marginals
from spinfilters.estimators.smoothing.modes import DETERMINED
from spinfilters.estimators.smoothing.newest import newest_factor
from spinfilters.estimators.smoothing.newest_sightings import WIDTH, is_strange, with_landmarks_put_right
from spinfilters.estimators.smoothing.problem import Normal, Point, Problem, Stage
from spinfilters.estimators.smoothing.reduced import Reduced
from spinfilters.estimators.smoothing.robust_kernels import Huber, RobustKernel
from spinfilters.estimators.smoothing.sliding_records import Memory, Retired, SlidingOptions, Taken
from spinfilters.estimators.smoothing.solver import Plain, SolverOptions, advanced, moved, solve
from spinfilters.estimators.smoothing.step_rules import GaussNewton
from spinfilters.estimators.smoothing.undetermined import undetermined_directions
from spinfilters.estimators.smoothing.window import Window
from spinfilters.estimators.timeline import Frame, Timeline
from spinfilters.state.gaussian import Gaussian

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

    def __init__(
        self, process: ProcessModel, prior: FirstStatePrior, options: SlidingOptions, tied: bool
    ) -> None:
        self.process, self.options, self._tied = process, options, tied
        self._prior, self.memory = prior, Memory()
        self._linear: tuple[Point, Normal] | None = None
        self.window = Window.empty(process.layout.mean_dim)

    def resume(self, window: Window, memory: Memory) -> None:
        """Go on from a window that was taken in before, linearised where it is."""
        self.window, self.memory = window, memory
        problem = self.problem()
        here = problem.at(window.trajectory, window.points)
        self._linear = _linear_problem(problem, here, self.options.sighting_kernel)

    def begin(
        self,
        frames: Timeline,
        trajectory: Float[np.ndarray, "k m"],
        ids: Int[np.ndarray, " L"],
        points: Float[np.ndarray, "L 3"],
    ) -> list[Taken]:
        """Take in the first frames at once, with states and landmarks (m, frame g) that a start has found for them."""
        window = self.window
        for frame, state in zip(frames, trajectory, strict=True):
            window = window.grown(frame, state)
        self.window = window.placed(ids, points)
        problem = self.problem()
        _, here, normal = self._solved(problem, problem.at(self.window.trajectory, self.window.points))
        self._linear = (here, normal)
        return [Taken(*self._counted(normal, k), 1) for k in range(len(frames))]

    def add(self, frame: Frame, guess: Float[np.ndarray, " 7"] | None = None) -> Taken:
        """Take in a frame.

        Parameters
        ----------
        guess: pose (t m, q_ig) to begin from; without it the last state is predicted.

        Raises
        ------
        InputError: when time does not go forwards.
        """
        self.window = self.window.grown(frame, self._guess(frame.time, guess))
        problem = self.problem()
        here = problem.at(self.window.trajectory, self.window.points)
        count, here, normal = self._solved(problem, here)
        self._linear = (here, normal)
        tries = self._from_closed_form(problem, here, normal)
        accepted, rejected = self._counted(normal)
        retired = self._slide(problem)
        return Taken(accepted, rejected, count + tries, retired)

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
        assert self._linear is not None
        solution = self._linear[1].solution
        return np.inf if isinstance(solution, int) else solution.mass_std

    def smoothed(self, frames: int | None = None) -> list[Retired]:
        """Frames of the window with their covariances: all, or so many of the oldest."""
        assert self._linear is not None
        solution, n = self._linear[1].solution, self.process.layout.error_dim
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

    def counts(self) -> Int[np.ndarray, "k 2"] | None:
        """Values of every epoch that count, and that do not; None where a part of them has been marginalized."""
        assert self._linear is not None
        if self.window.carried is not None:
            return None
        normal = self._linear[1]
        return np.array([self._counted(normal, k) for k in range(len(self.window.frames))])

    def undetermined(self) -> list[str]:
        """What the measurements so far do not determine, in words; only while the first frame is in the window."""
        assert self._linear is not None
        count = len(self.window.frames)
        if self._linear[0].trajectory.shape[0] != count:
            return []
        return undetermined_directions(self.problem(), *self._linear)

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

    @property
    def _before(self) -> float:
        """Standard deviation of the mass distribution after the last frame."""
        return np.inf if self._linear is None else self.mass_std

    def _solved(self, problem: Problem, here: Point) -> tuple[int, Point, Normal]:
        """The linear problem at the last linearisation, which the window's states are one step beyond, and how many there were."""
        kernel = self.options.sighting_kernel
        here, count = self._found_back(problem, here, kernel)
        here, normal = _linear_problem(problem, here, kernel)
        surprise = SURPRISE * self._measured() if self._before <= LOOSE else SETTLED_COST
        while count < self.options.iterations and normal.solved and normal.decrement > surprise:
            there, _, _ = advanced(problem, here, normal, (GaussNewton(), 1.0))
            if there is None:
                break
            here, normal = _linear_problem(problem, there, kernel)
            count += 1
        step = GaussNewton().propose(lambda _: normal, problem.layout, 1.0) if normal.solved else None
        trajectory, points = (here.trajectory, here.points) if step is None else moved(problem, here, step)
        self.window = replace(self.window, trajectory=trajectory, points=points)
        return count, here, normal

    def _found_back(self, problem: Problem, here: Point, kernel: RobustKernel) -> tuple[Point, int]:
        """Where the newest frame fits, if its guess was so poor that the kernel would lose it; else where it was."""
        if not is_strange(problem, here, kernel):
            self.memory.strange = False
            return here, 1
        there = here
        for count in range(1, self.options.iterations + 1):
            normal = problem.normal(there, Stage(Huber(WIDTH)))
            moved_there, _, _ = advanced(problem, there, normal, (GaussNewton(), 1.0))
            if moved_there is None:
                break
            there = moved_there
            if not is_strange(problem, there, kernel):
                self.memory.strange = False
                return there, count + 1
        self.memory.strange = True
        return here, self.options.iterations + 1

    def _measured(self) -> int:
        """Scalar measurements of the newest frame, and unknowns of its state."""
        frame = self.window.frames[-1]
        return sum(m.values.size for m in frame.measurements) + self.process.layout.error_dim

    def _from_closed_form(self, problem: Problem, here: Point, normal: Normal) -> int:
        """While the inertia is not determined, the closed form of the momentum may know a better place to go on from.

        Returns how many linearisations it took to see.
        """
        if self.mass_std <= DETERMINED or fits(here, normal):
            return 0
        if not self.memory.tried.due(len(self.window.frames)):
            return 0
        times = np.array([frame.time for frame in self.window.frames])
        found, tries = at_closed_form(problem, here, normal, times)
        if found is not None:
            self.window = replace(self.window, trajectory=found.trajectory, points=found.points)
        return tries

    def _counted(self, normal: Normal, number: int = -1) -> tuple[int, int]:
        """Values of a frame that count, and that do not."""
        frame = self.window.frames[number]
        rest = sum(len(m.values) for m in frame.measurements if m.ids is None)
        every = sum(len(m.values) for m in frame.measurements if m.ids is not None)
        if normal.eliminated is None:
            return rest, every
        inside = normal.eliminated.sightings.frame == number % len(self.window.frames)
        good = int(np.count_nonzero(normal.eliminated.weight[inside] > 0))
        return rest + good, every - good

    def _slide(self, problem: Problem) -> tuple[Retired, ...]:
        """Let go what the mode lets go."""
        assert self._linear is not None
        window, mode, std = self.window, self.options.mode, self.mass_std
        self.memory.determined = (
            self.memory.determined + 1 if std <= mode.determined and not self.memory.strange else 0
        )
        landmarks = mode.frozen(window, self.process.layout)
        over = mode.leaving(len(window.frames), std if self.memory.determined >= SETTLED else np.inf)
        if over < 1 or not self._linear[1].solved:
            if landmarks.any() and self._linear[1].solved:
                self.window = without_landmarks(window, problem, self._linear, landmarks)
            return ()
        landmarks[window.seen.landmark[window.seen.frame < over]] = True
        retired = self._leaving(over)
        self.window = without_oldest(window, problem, self._linear, landmarks, over)
        self.memory.prior_alive = False
        return retired

    def _leaving(self, count: int) -> tuple[Retired, ...]:
        return tuple(self.smoothed(count)) if self.options.retired else ()

    def _newest_factor(self) -> Float[np.ndarray, "n n"]:
        assert self._linear is not None
        solution = self._linear[1].solution
        if isinstance(solution, Reduced):
            return newest_factor(solution)
        n = self.process.layout.error_dim
        return np.full((n, n), np.nan)


def _linear_problem(problem: Problem, here: Point, kernel: RobustKernel) -> tuple[Point, Normal]:
    """About the point, or one at which misplaced landmarks have been put right."""
    stage = Stage(kernel)
    here = with_landmarks_put_right(problem, here, stage)
    return here, problem.normal(here, stage)
