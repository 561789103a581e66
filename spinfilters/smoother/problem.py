"""Nonlinear least-squares problem of a motion with landmarks, and the directions that it leaves unobservable."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.linear_algebra import with_largest_positive
from spinfilters.core.robust_losses import LeastSquares, RobustLoss
from spinfilters.filters.estimator import ProcessModel
from spinfilters.filters.timeline import Timeline
from spinfilters.models.state_blocks import CENTRE_OF_MASS, MASS_DISTRIBUTION, RATE, StateBlock
from spinfilters.models.state_layout import POSE_BLOCKS, StateLayout
from spinfilters.models.status import NOTHING, OF_BLOCKS, Finding
from spinfilters.smoother.elimination import Eliminated, eliminate
from spinfilters.smoother.landmark_factors import (
    LandmarkObservations,
    LinearObservations,
    collect_observations,
    linearise_observations,
)
from spinfilters.smoother.linear_system import (
    LinearSystem,
    Marginals,
    SchurSystem,
    assembled_by_stretches,
    solve_normal_equations,
    solve_schur_system,
)
from spinfilters.smoother.motion_factors import (
    STRETCH,
    EpochFactors,
    InformationBlocks,
    SensorRows,
    WeightedRows,
    motion_of,
)
from spinfilters.smoother.priors import LinearizedPrior, MarginalizationPrior, StatePrior, VariableOrdering


@dataclass(frozen=True)
class InitialGuess:
    """Initial guess of a smoother: states and a map in frame g.

    One state per epoch; its constants are those of the first.

    Attributes
    ----------
    ids : ndarray of int, shape (L,)
        Landmark ids, ascending.
    points : ndarray of float, shape (L, 3)
        Landmark points, m, frame g.
    """

    trajectory: Float[np.ndarray, "k m"]
    ids: Int[np.ndarray, " L"]
    points: Float[np.ndarray, "L 3"]


@dataclass(frozen=True)
class Stage:
    """Robust loss and process-noise inflation of an iteration.

    Attributes
    ----------
    pose_only_loss : RobustLoss or None
        Of pose-only observations; None for that of the problem.
    """

    loss: RobustLoss
    inflation: float = 1.0
    pose_only_loss: RobustLoss | None = None


@dataclass(frozen=True)
class LinearizationPoint:
    """A trajectory and landmarks, with everything linearised about them.

    Attributes
    ----------
    sensors, dynamics : InformationBlocks
        Their grams; of a long chain the costs alone, and the linear system in ``assembled``.
    pose_only_loss : RobustLoss or None
        Of pose-only observations, as in the `Stage` that it belongs to.
    """

    trajectory: Float[np.ndarray, "k m"]
    points: Float[np.ndarray, "L 3"]
    sensors: InformationBlocks
    dynamics: InformationBlocks
    linear: LinearObservations | None
    marginal_prior: LinearizedPrior | None
    assembled: LinearSystem | None = None
    pose_only_loss: RobustLoss | None = None
    _rows: list[tuple[SensorRows, WeightedRows]] = field(
        default_factory=list, init=False, repr=False, compare=False
    )

    def sensor_rows(self, motion: EpochFactors, number: int) -> WeightedRows:
        """Weighted rows of one of the problem's sensors about this point, linearised once."""
        sensor = motion.sensors[number]
        for known, rows in self._rows:
            if known is sensor:
                return rows
        rows = motion.sensor_rows(sensor, self.trajectory, self.pose_only_loss)
        self._rows.append((sensor, rows))
        return rows

    def cost(self, used: Bool[np.ndarray, " N"] | None, stage: Stage) -> float:
        """Cost of the motion and of the observations that a step used.

        Landmarks of the other observations did not move with the step.
        """
        cost = self.sensors.cost + self.dynamics.cost / stage.inflation**2
        cost += 0.0 if self.marginal_prior is None else self.marginal_prior.cost
        if self.linear is None or used is None:
            return cost
        return cost + self.linear.cost(stage.loss, used)

    def robust_cost(self, stage: Stage) -> float:
        """Cost of all observations under the robust loss.

        A fit gains nothing by rejecting: an outlier costs what the loss says, whoever rejects it.
        """
        return self.cost(None if self.linear is None else np.ones(len(self.linear.square), dtype=bool), stage)


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations about a linearisation point, with their solution.

    Attributes
    ----------
    solution : SchurSystem or None
        None without one.
    unobservable : int
        Number of the first unobservable variable then.
    """

    stage: Stage
    eliminated: Eliminated | None
    solution: SchurSystem | None
    unobservable: int = -1

    @property
    def used(self) -> Bool[np.ndarray, " N"] | None:
        """Observations that it was made from."""
        return None if self.eliminated is None else self.eliminated.used

    @property
    def solved(self) -> bool:
        """Whether it has a solution."""
        return self.solution is not None

    @property
    def system(self) -> SchurSystem:
        """Schur system of a problem that has a solution."""
        assert self.solution is not None
        return self.solution

    @cached_property
    def predicted_reduction(self) -> float:
        """Predicted fall of the linear problem's cost; infinite without a solution."""
        if self.solution is None:
            return np.inf
        e = self.eliminated
        return self.solution.predicted_reduction + (0.0 if e is None else e.predicted_reduction)


@dataclass(frozen=True)
class LinearProblem:
    """A linearisation point and the normal equations about it."""

    point: LinearizationPoint
    normal: NormalEquations


@dataclass(frozen=True)
class Problem:
    """Frames, models and prior; see `problem_of`.

    Attributes
    ----------
    rows_together : int
        Epochs without landmarks whose rows are kept in memory together; of longer problems only their products are.
    """

    motion: EpochFactors
    observations: LandmarkObservations | None
    marginal_prior: MarginalizationPrior | None = None
    rows_together: int = STRETCH

    @property
    def layout(self) -> StateLayout:
        """Layout of every epoch's state."""
        return self.motion.process.layout

    @property
    def ordering(self) -> VariableOrdering:
        """Variable ordering: how errors are split for elimination."""
        return self.motion.ordering

    @property
    def is_long(self) -> bool:
        """Whether a problem without landmarks exceeds the epochs whose rows fit in memory together."""
        return (
            not self.ordering.has_landmarks
            and self.marginal_prior is None
            and self.ordering.epochs > self.rows_together
        )

    def at(
        self,
        trajectory: Float[np.ndarray, "k m"],
        points: Float[np.ndarray, "L 3"],
        pose_only_loss: RobustLoss | None = None,
    ) -> LinearizationPoint:
        """Problem linearised about landmarks and a trajectory of common constants."""
        if self.is_long:
            motion = self.motion if pose_only_loss is None else replace(self.motion, loss=pose_only_loss)
            sensors, dynamics, system = assembled_by_stretches(motion, trajectory)
            return LinearizationPoint(
                trajectory, points, sensors, dynamics, None, None, system, pose_only_loss
            )
        linear = (
            None
            if self.observations is None
            else linearise_observations(self.observations, trajectory, points)
        )
        here = LinearizationPoint(
            trajectory,
            points,
            self.motion.measurements(trajectory, pose_only_loss),
            self.motion.dynamics(trajectory),
            linear,
            None if self.marginal_prior is None else self.marginal_prior.at(trajectory),
            pose_only_loss=pose_only_loss,
        )
        here._rows.extend(zip(self.motion.sensors, here.sensors.sensor_rows, strict=True))
        return here

    def staged(self, here: LinearizationPoint, stage: Stage) -> LinearizationPoint:
        """The point with the loss of a stage."""
        if here.pose_only_loss == stage.pose_only_loss:
            return here
        if self.is_long:
            return self.at(here.trajectory, here.points, stage.pose_only_loss)
        if not self.motion.sensors:  # the prior has no loss
            return replace(here, pose_only_loss=stage.pose_only_loss)
        return replace(
            here,
            sensors=self.motion.measurements(here.trajectory, stage.pose_only_loss),
            pose_only_loss=stage.pose_only_loss,
        )

    def normal(self, here: LinearizationPoint, stage: Stage, damping: float = 0.0) -> NormalEquations:
        """The linear problem about a point, solved."""
        eliminated = None
        if here.assembled is not None:
            assert stage.inflation == 1.0, "disturbances are inflated only with landmarks"
            return NormalEquations(
                stage, None, *solve_schur_system(self.ordering, here.assembled.copy(), None, damping)
            )
        if self.observations is not None:
            assert here.linear is not None
            weight = here.linear.weight(stage.loss)
            eliminated = eliminate(
                self.observations, here.linear, weight, self.ordering.separator_dim, self.ordering.epochs
            )
        steps = here.dynamics
        if stage.inflation != 1.0:
            steps = replace(steps, steps=steps.steps / stage.inflation**2)
        prior = here.marginal_prior
        solution = solve_normal_equations(self.ordering, here.sensors, steps, eliminated, prior, damping)
        return NormalEquations(stage, eliminated, *solution)


def problem_of(
    process: ProcessModel,
    epochs: Timeline,
    ids: Int[np.ndarray, " L"],
    prior: StatePrior | None,
    needed: int,
    loss: RobustLoss | None = None,
) -> Problem:
    """The problem of some epochs.

    Parameters
    ----------
    ids : ndarray of int, shape (L,)
        Landmarks that are unknowns, ascending; observations of others are left out.
    needed : int
        Observations of one, at least.
    loss : RobustLoss or None
        Of every other sensor's measurements.

    Raises
    ------
    InputError
        When the layout has no place and there are observations.
    """
    observations = collect_observations(epochs, ids, needed)
    has_landmarks = bool(len(observations))
    motion = replace(motion_of(process, epochs, has_landmarks), prior=prior, loss=loss or LeastSquares())
    return Problem(motion, observations if has_landmarks else None)


def with_common_constants(
    layout: StateLayout, trajectory: Float[np.ndarray, "k m"]
) -> Float[np.ndarray, "k m"]:
    """The trajectory with the constants of its first epoch in all."""
    common = trajectory.copy()
    common[:, layout.constant_indices] = trajectory[0, layout.constant_indices]
    return common


def with_last_constants(
    layout: StateLayout, trajectory: Float[np.ndarray, "k m"]
) -> Float[np.ndarray, "k m"]:
    """The trajectory with the constants of its last epoch, the best known, in all."""
    common = trajectory.copy()
    common[:, layout.constant_indices] = trajectory[-1, layout.constant_indices]
    return common


LEFT = 0.7
"""Of the prior's standard deviation, above which nothing has been learnt."""
ALONG = 0.95
"""Cosine of the angle within which a direction is called an axis."""
CHECK = "unobservable"
"""Name of the check in the verdict."""
CURES = {
    MASS_DISTRIBUTION.name: "record a motion that wobbles",
    CENTRE_OF_MASS.name: "record a rotation about more than one axis",
}
"""By block; other constants need more data."""
MORE_DATA = "give a longer recording, or leave it out of the state"


def unobservable_directions(
    problem: Problem, here: LinearizationPoint, normal: NormalEquations, marginals: Marginals | None = None
) -> list[Finding]:
    """Findings of unobservable directions; empty when there are none.

    Parameters
    ----------
    normal : NormalEquations
        The linear problem about ``here``.
    marginals : Marginals or None
        Of its solution, where they are at hand.
    """
    solution = normal.solution
    if solution is None:
        name = component_name(problem.ordering, normal.unobservable)
        return [Finding(CHECK, f"{name} is not determined by any measurement")]
    prior = problem.motion.prior
    if prior is None:
        return []
    layout, first, std = problem.layout, here.trajectory[0], np.linalg.norm(prior.factor, axis=1)
    rows = (marginals or Marginals(solution, None)).epoch_rows(0)
    covariance = rows @ rows.T
    axis = first[layout.mean_slice(RATE.name)] if layout.has(RATE) else np.zeros(3)
    findings: list[Finding] = []
    for block in layout.members:
        if block.name not in POSE_BLOCKS:
            at = layout.slice(block.name)
            own = covariance[at, at] / np.outer(std[at], std[at])
            findings += _findings(block, own, axis)
    return findings


def component_name(ordering: VariableOrdering, number: int) -> str:
    """Name of an unknown by its number in elimination order."""
    v, p = len(ordering.tridiagonal), len(ordering.pose)
    assembled, has_landmarks = ordering.epochs * v, ordering.epochs * p
    if number < assembled:
        component, where = ordering.tridiagonal[number % v], f" in epoch {number // v}"
    elif number < assembled + has_landmarks:
        component, where = ordering.pose[(number - assembled) % p], f" in epoch {(number - assembled) // p}"
    else:
        component, where = (
            ordering.constant[min(number - assembled - has_landmarks, len(ordering.constant) - 1)],
            "",
        )
    return ordering.layout.block_of(int(component)).phrase + where


def _findings(
    block: StateBlock, covariance: Float[np.ndarray, "b b"], axis: Float[np.ndarray, " 3"]
) -> list[Finding]:
    """Findings of one block whose covariance is in units of the prior's."""
    values, vectors = np.linalg.eigh(covariance)
    left = values > LEFT**2
    count, size = int(left.sum()), len(values)
    if not count:
        return []
    name = "the inertia" if block == MASS_DISTRIBUTION else block.phrase
    sentence = f"{name} is not determined: the data constrain {size - count} of its {size} parameters"
    if count == size:
        sentence = f"{name} is not determined by any measurement"
    elif size == 3 and count == 1:
        sentence = f"{name} is not determined {_direction(vectors[:, left][:, 0], axis)}"
    return [
        Finding(
            f"{CHECK}:{block.name}",
            sentence,
            CURES.get(block.name, MORE_DATA),
            {"constrained": size - count, "parameters": size},
            OF_BLOCKS.get(block.name, NOTHING),
        )
    ]


def _direction(vector: Float[np.ndarray, " 3"], axis: Float[np.ndarray, " 3"]) -> str:
    length = float(np.linalg.norm(axis))
    if length > 0 and abs(float(vector @ axis)) > ALONG * length:
        return "along the axis of rotation"
    x, y, z = with_largest_positive(vector)
    return f"along ({x:.2f}, {y:.2f}, {z:.2f}) in frame g"
