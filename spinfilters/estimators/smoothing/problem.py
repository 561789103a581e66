"""The least-squares problem of a motion with landmarks: factors from the filters' own models, about a point."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.estimators.estimator import ProcessModel
from spinfilters.estimators.smoothing.carried import Carried, CarriedAt
from spinfilters.estimators.smoothing.elimination import Eliminated, eliminate
from spinfilters.estimators.smoothing.motion import STRETCH, Grams, Motion, motion_of
from spinfilters.estimators.smoothing.reduced import (
    LinearSystem,
    Reduced,
    assembled,
    assembled_by_stretches,
    solve_reduced,
)
from spinfilters.estimators.smoothing.robust_kernels import LeastSquares, RobustKernel
from spinfilters.estimators.smoothing.sightings import (
    LinearSightings,
    Sightings,
    collect_sightings,
    linearise_sightings,
)
from spinfilters.estimators.smoothing.state_prior import StatePrior
from spinfilters.estimators.smoothing.unknowns import Unknowns
from spinfilters.estimators.timeline import Timeline
from spinfilters.state.layout import StateLayout


@dataclass(frozen=True)
class Trial:
    """Where a smoother sets out from: a point per frame (its constants are those of the first), and a map in frame g.

    Attributes
    ----------
    ids: (L,) ascending.   points: (L, 3) m.
    """

    trajectory: Float[np.ndarray, "k m"]
    ids: Int[np.ndarray, " L"]
    points: Float[np.ndarray, "L 3"]


@dataclass(frozen=True)
class Stage:
    """How strict an iteration is: what a sighting's residual costs, and by how much larger disturbances are taken than they are.

    Attributes
    ----------
    loss: of pose-only observations; None for that of the problem.
    """

    kernel: RobustKernel
    slack: float = 1.0
    loss: RobustKernel | None = None


@dataclass(frozen=True)
class Point:
    """A trajectory and landmarks, with everything linearised about them.

    Attributes
    ----------
    sensors, dynamics: their grams; of a long chain the costs alone, and the linear system in ``chained``.
    loss: of pose-only observations, as in the `Stage` that it belongs to.
    """

    trajectory: Float[np.ndarray, "k m"]
    points: Float[np.ndarray, "L 3"]
    sensors: Grams
    dynamics: Grams
    linear: LinearSightings | None
    carried: CarriedAt | None
    chained: LinearSystem | None = None
    loss: RobustKernel | None = None

    def cost(self, used: Bool[np.ndarray, " N"] | None, stage: Stage) -> float:
        """Of the motion and of the sightings that a step was made from: the others' landmarks did not move with it."""
        cost = self.sensors.cost + self.dynamics.cost / stage.slack**2
        cost += 0.0 if self.carried is None else self.carried.cost
        if self.linear is None or used is None:
            return cost
        return cost + self.linear.cost(stage.kernel, used)

    def robust_cost(self, stage: Stage) -> float:
        """Of everything, so that a fit gains nothing by rejecting: an outlier costs what the loss says, whoever rejects it."""
        return self.cost(None if self.linear is None else np.ones(len(self.linear.square), dtype=bool), stage)


@dataclass(frozen=True)
class Normal:
    """The linear problem about a point; the number of its first undetermined unknown where it has no solution."""

    stage: Stage
    eliminated: Eliminated | None
    solution: Reduced | int

    @property
    def used(self) -> Bool[np.ndarray, " N"] | None:
        """Sightings that it was made from."""
        return None if self.eliminated is None else self.eliminated.used

    @property
    def solved(self) -> bool:
        """Whether it has a solution."""
        return not isinstance(self.solution, int)

    @property
    def decrement(self) -> float:
        """By how much the linear problem's cost falls; infinite without a solution."""
        if isinstance(self.solution, int):
            return np.inf
        e = self.eliminated
        return self.solution.decrement + (0.0 if e is None else float((e.gradient[e.told] ** 2).sum()))


@dataclass(frozen=True)
class Problem:
    """Frames, models and prior; see `problem_of`."""

    motion: Motion
    sightings: Sightings | None
    carried: Carried | None = None

    @property
    def layout(self) -> StateLayout:
        """Of every frame's state."""
        return self.motion.process.layout

    @property
    def unknowns(self) -> Unknowns:
        """How errors are split."""
        return self.motion.unknowns

    @property
    def is_long(self) -> bool:
        """Whether it is a mere chain, of so many frames that their rows are not to be in memory together."""
        return not self.unknowns.tied and self.carried is None and self.unknowns.frames > STRETCH

    def at(
        self,
        trajectory: Float[np.ndarray, "k m"],
        points: Float[np.ndarray, "L 3"],
        loss: RobustKernel | None = None,
    ) -> Point:
        """Everything linearised about a trajectory, whose constants are the same in every frame, and landmarks."""
        if self.is_long:
            motion = self.motion if loss is None else replace(self.motion, kernel=loss)
            sensors, dynamics, system = assembled_by_stretches(motion, trajectory)
            return Point(trajectory, points, sensors, dynamics, None, None, system, loss)
        linear = None if self.sightings is None else linearise_sightings(self.sightings, trajectory, points)
        return Point(
            trajectory,
            points,
            self.motion.measurements(trajectory, loss),
            self.motion.dynamics(trajectory),
            linear,
            None if self.carried is None else self.carried.at(trajectory),
            loss=loss,
        )

    def staged(self, here: Point, stage: Stage) -> Point:
        """The point with the loss of a stage."""
        if here.loss == stage.loss:
            return here
        if self.is_long:
            return self.at(here.trajectory, here.points, stage.loss)
        return replace(here, sensors=self.motion.measurements(here.trajectory, stage.loss), loss=stage.loss)

    def normal(self, here: Point, stage: Stage, damping: float = 0.0) -> Normal:
        """The linear problem about a point, solved."""
        eliminated = None
        if here.chained is not None:
            assert stage.slack == 1.0, "disturbances are inflated where there are landmarks alone"
            return Normal(stage, None, solve_reduced(self.unknowns, here.chained.copy(), None, damping))
        if self.sightings is not None:
            assert here.linear is not None
            weight = stage.kernel.weight(here.linear.square)
            eliminated = eliminate(
                self.sightings, here.linear, weight, self.unknowns.kept, self.unknowns.frames
            )
        steps = here.dynamics
        if stage.slack != 1.0:
            steps = replace(steps, steps=steps.steps / stage.slack**2)
        grams = (here.sensors, steps)
        system = assembled(self.unknowns, grams, eliminated)
        solution = solve_reduced(self.unknowns, system, here.carried, damping)
        return Normal(stage, eliminated, solution)


def problem_of(
    process: ProcessModel,
    frames: Timeline,
    ids: Int[np.ndarray, " L"],
    prior: StatePrior | None,
    needed: int,
    kernel: RobustKernel | None = None,
) -> Problem:
    """The problem of some frames.

    Parameters
    ----------
    ids: landmarks that are unknowns, ascending; sightings of others are left out.   needed: sightings of one, at least.
    kernel: of every other sensor's measurements.

    Raises
    ------
    InputError: when the layout has no place and there are sightings.
    """
    sightings = collect_sightings(frames, ids, needed)
    tied = bool(len(sightings))
    motion = replace(motion_of(process, frames, tied), prior=prior, kernel=kernel or LeastSquares())
    return Problem(motion, sightings if tied else None)


def with_common_constants(
    layout: StateLayout, trajectory: Float[np.ndarray, "k m"]
) -> Float[np.ndarray, "k m"]:
    """The trajectory with the constants of its first frame in all."""
    common = trajectory.copy()
    common[:, layout.constant_indices] = trajectory[0, layout.constant_indices]
    return common
