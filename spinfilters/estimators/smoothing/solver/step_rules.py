"""Step rules with capped steps: halved Gauss-Newton, Levenberg-Marquardt, and Powell's dogleg.

Landmarks and velocities follow the poses and constants exactly, whatever the rule (variable projection): what is damped or held
within a radius is the system that remains.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.smoothing.linear.schur_system import SchurSystem
from spinfilters.estimators.smoothing.problem.least_squares import NormalEquations
from spinfilters.state.layout import StateLayout

DAMPINGS = (0.0, 1e-9, 1e-6, 1e-3, 1e-1)
"""Added to a diagonal relative to itself, in this order, until a system can be factored (Levenberg 1944)."""
Solve = Callable[[float], NormalEquations]
"""The linear problem with a damping."""


@dataclass(frozen=True)
class Step:
    """Proposed step of a rule.

    Attributes
    ----------
    errors: (k, n) of the epochs.   points: (L, 3) m.   normal: the linear problem it came from.
    predicted: by how much the linear problem's cost falls, at least.   size: of the rule's own measure.
    """

    errors: Float[np.ndarray, "k n"]
    points: Float[np.ndarray, "L 3"] | None
    normal: NormalEquations
    predicted: float
    size: float


class StepRule(ABC):
    """Step rule with one adapted control parameter: share, damping or radius."""

    tries: int = 12
    """Steps from one point before it is given up."""

    @property
    @abstractmethod
    def first(self) -> float:
        """Initial control parameter."""

    @abstractmethod
    def propose(self, solve: Solve, layout: StateLayout, number: float) -> Step | None:
        """A step; None when the linear problem has no solution."""

    @abstractmethod
    def adapted(self, number: float, gain: float, step: Step) -> float:
        """Control parameter after a step with this gain ratio.

        The cost fell by ``gain`` times the predicted reduction; not positive: the step is not taken.
        """


@dataclass(frozen=True)
class GaussNewton(StepRule):
    """The whole step, halved until the cost does not rise."""

    @property
    def first(self) -> float:
        """The whole step."""
        return 1.0

    def propose(self, solve: Solve, layout: StateLayout, number: float) -> Step | None:
        """A share of the whole step."""
        normal = _solvable(solve)
        if normal is None:
            return None
        errors = normal.system.errors
        return _shared(normal, errors, min(number, _cap(layout, errors)))

    def adapted(self, number: float, gain: float, step: Step) -> float:
        """Half the share after a failure, else the whole step."""
        return step.size / 2 if gain <= 0 else 1.0


@dataclass(frozen=True)
class LevenbergMarquardt(StepRule):
    """Levenberg-Marquardt damping by a share of the diagonal.

    A good step lowers it, a bad one raises it (Marquardt 1963; Nielsen 1999).
    """

    damping: float = 1e-4
    raised: float = 10.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.damping) and self.damping > 0):
            raise InputError(f"levenberg-marquardt damping is {self.damping}; give a positive number")

    @property
    def first(self) -> float:
        """The first damping."""
        return self.damping

    def propose(self, solve: Solve, layout: StateLayout, number: float) -> Step | None:
        """The step of the damped linear problem."""
        normal = solve(number)
        if normal.solution is None:
            return None
        errors = normal.solution.errors
        return _shared(normal, errors, _cap(layout, errors))

    def adapted(self, number: float, gain: float, step: Step) -> float:
        """The damping raised after a failure, else by Nielsen's rule."""
        if gain <= 0:
            return number * self.raised
        return max(number * max(1 / 3, 1 - (2 * min(gain, 2.0) - 1) ** 3), 1e-12)


@dataclass(frozen=True)
class Dogleg(StepRule):
    """Dogleg steps within a trust radius in scaled units.

    Along steepest descent, then towards Gauss-Newton (Powell 1970; Rosen et al. 2014).
    """

    radius: float = 1e4

    def __post_init__(self) -> None:
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise InputError(f"dogleg radius is {self.radius}; give a positive number")

    @property
    def first(self) -> float:
        """The first radius."""
        return self.radius

    def propose(self, solve: Solve, layout: StateLayout, number: float) -> Step | None:
        """The dogleg step within the radius."""
        normal = _solvable(solve)
        if normal is None:
            return None
        solution = normal.system
        separator_step, share = _dogleg(solution, number)
        errors = solution.ordering.errors(separator_step, solution.tridiagonal.back(separator_step))
        cap = _cap(layout, errors)
        size = solution.ordering.epochs * len(solution.ordering.pose)
        poses = cap * separator_step[:size].reshape(solution.ordering.epochs, -1)
        points = None if normal.eliminated is None else normal.eliminated.points_step(poses)
        errors = solution.ordering.errors(
            cap * separator_step, solution.tridiagonal.back(cap * separator_step)
        )
        lost = np.tril(solution.information_sqrt).T @ (solution.separator_step - cap * separator_step)
        return Step(errors, points, normal, normal.predicted_reduction - float(lost @ lost), share * cap)

    def adapted(self, number: float, gain: float, step: Step) -> float:
        """A quarter of the radius after a poor step, twice after a good one."""
        if gain < 0.25:
            return number / 4
        return number * 2 if gain > 0.75 else number


def _dogleg(solution: SchurSystem, radius: float) -> tuple[Float[np.ndarray, " r"], float]:
    """The dogleg step within a radius, and its length over the radius."""
    information_sqrt = np.tril(solution.information_sqrt)
    scale = np.sqrt(np.einsum("ij,ij->i", information_sqrt, information_sqrt))
    newton = scale * solution.separator_step
    if np.linalg.norm(newton) <= radius:
        return solution.separator_step, float(np.linalg.norm(newton)) / radius
    down = solution.gradient / scale
    along = information_sqrt.T @ (down / scale)
    cauchy = down * float(down @ down) / float(along @ along)
    if np.linalg.norm(cauchy) >= radius:
        return cauchy / scale * radius / np.linalg.norm(cauchy), 1.0
    rest = newton - cauchy
    a, b, c = rest @ rest, cauchy @ rest, cauchy @ cauchy - radius**2
    share = (-b + np.sqrt(b**2 - a * c)) / a
    return (cauchy + share * rest) / scale, 1.0


def _solvable(solve: Solve) -> NormalEquations | None:
    """Normal equations with the least damping that gives a solution."""
    for damping in DAMPINGS:
        normal = solve(damping)
        if normal.solved:
            return normal
    return None


def _cap(layout: StateLayout, errors: Float[np.ndarray, "k n"]) -> float:
    """Share of a step within the range of validity of the linear model."""
    share = 1.0
    for block in layout.members:
        if np.isfinite(block.largest_step):
            longest = float(np.abs(errors[:, layout.slice(block.name)]).max(initial=0.0))
            share = min(share, block.largest_step / max(longest, np.finfo(float).tiny))
    return share


def _shared(normal: NormalEquations, errors: Float[np.ndarray, "k n"], share: float) -> Step:
    """Part of the whole step, landmarks and velocities too."""
    points = None
    if normal.eliminated is not None:
        points = share * normal.eliminated.points_step(normal.system.poses)
    predicted = share * (2 - share) * normal.predicted_reduction
    return Step(share * errors, points, normal, predicted, share)
