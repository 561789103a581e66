"""How far to go: Gauss-Newton with halved steps, Levenberg-Marquardt, and Powell's dogleg, each with capped steps.

Landmarks and velocities follow the poses and constants exactly, whatever the rule (variable projection): what is damped or held
within a radius is the system that remains.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.smoothing.problem import Normal
from spinfilters.estimators.smoothing.reduced import Reduced
from spinfilters.state.layout import StateLayout

DAMPINGS = (0.0, 1e-9, 1e-6, 1e-3, 1e-1)
"""Added to a diagonal relative to itself, in this order, until a system can be factored (Levenberg 1944)."""
Solve = Callable[[float], Normal]
"""The linear problem with a damping."""


@dataclass(frozen=True)
class Step:
    """Where a rule wants to go.

    Attributes
    ----------
    errors: (k, n) of the frames.   points: (L, 3) m.   normal: the linear problem it came from.
    predicted: by how much the linear problem's cost falls, at least.   size: of the rule's own measure.
    """

    errors: Float[np.ndarray, "k n"]
    points: Float[np.ndarray, "L 3"] | None
    normal: Normal
    predicted: float
    size: float


class StepRule(ABC):
    """A rule with one number that it adapts: a share, a damping, a radius."""

    tries: int = 12
    """Steps from one point before it is given up."""

    @property
    @abstractmethod
    def first(self) -> float:
        """The number to begin with."""

    @abstractmethod
    def propose(self, solve: Solve, layout: StateLayout, number: float) -> Step | None:
        """A step; None when the linear problem has no solution."""

    @abstractmethod
    def adapted(self, number: float, gain: float, step: Step) -> float:
        """The number after a step whose cost fell by ``gain`` times what was predicted; not positive: the step is not taken."""


@dataclass(frozen=True)
class GaussNewton(StepRule):
    """The whole step, halved until the cost does not rise."""

    @property
    def first(self) -> float:
        return 1.0

    def propose(self, solve: Solve, layout: StateLayout, number: float) -> Step | None:
        normal = _solvable(solve)
        if normal is None:
            return None
        errors = _solution(normal).errors
        return _shared(normal, errors, min(number, _cap(layout, errors)))

    def adapted(self, number: float, gain: float, step: Step) -> float:
        return step.size / 2 if gain <= 0 else 1.0


@dataclass(frozen=True)
class LevenbergMarquardt(StepRule):
    """Damped by a share of the diagonal that a good step lowers and a bad one raises (Marquardt 1963; Nielsen 1999)."""

    damping: float = 1e-4
    raised: float = 10.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.damping) and self.damping > 0):
            raise InputError(f"levenberg-marquardt damping is {self.damping}; give a positive number")

    @property
    def first(self) -> float:
        return self.damping

    def propose(self, solve: Solve, layout: StateLayout, number: float) -> Step | None:
        normal = solve(number)
        if isinstance(normal.solution, int):
            return None
        errors = normal.solution.errors
        return _shared(normal, errors, _cap(layout, errors))

    def adapted(self, number: float, gain: float, step: Step) -> float:
        if gain <= 0:
            return number * self.raised
        return max(number * max(1 / 3, 1 - (2 * min(gain, 2.0) - 1) ** 3), 1e-12)


@dataclass(frozen=True)
class Dogleg(StepRule):
    """Along steepest descent, then towards Gauss-Newton, within a radius in scaled units (Powell 1970; Rosen et al. 2014)."""

    radius: float = 1e4

    def __post_init__(self) -> None:
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise InputError(f"dogleg radius is {self.radius}; give a positive number")

    @property
    def first(self) -> float:
        return self.radius

    def propose(self, solve: Solve, layout: StateLayout, number: float) -> Step | None:
        normal = _solvable(solve)
        if normal is None:
            return None
        solution = _solution(normal)
        kept, share = _dogleg(solution, number)
        errors = solution.unknowns.errors(kept, solution.chain.back(kept))
        cap = _cap(layout, errors)
        size = solution.unknowns.frames * len(solution.unknowns.pose)
        poses = cap * kept[:size].reshape(solution.unknowns.frames, -1)
        points = None if normal.eliminated is None else normal.eliminated.points_step(poses)
        errors = solution.unknowns.errors(cap * kept, solution.chain.back(cap * kept))
        lost = np.tril(solution.root).T @ (solution.kept - cap * kept)
        return Step(errors, points, normal, normal.decrement - float(lost @ lost), share * cap)

    def adapted(self, number: float, gain: float, step: Step) -> float:
        if gain < 0.25:
            return number / 4
        return number * 2 if gain > 0.75 else number


def _dogleg(solution: Reduced, radius: float) -> tuple[Float[np.ndarray, " r"], float]:
    """The dogleg step within a radius, and its length over the radius."""
    root = np.tril(solution.root)
    scale = np.sqrt(np.einsum("ij,ij->i", root, root))
    newton = scale * solution.kept
    if np.linalg.norm(newton) <= radius:
        return solution.kept, float(np.linalg.norm(newton)) / radius
    down = solution.gradient / scale
    along = root.T @ (down / scale)
    cauchy = down * float(down @ down) / float(along @ along)
    if np.linalg.norm(cauchy) >= radius:
        return cauchy / scale * radius / np.linalg.norm(cauchy), 1.0
    rest = newton - cauchy
    a, b, c = rest @ rest, cauchy @ rest, cauchy @ cauchy - radius**2
    share = (-b + np.sqrt(b**2 - a * c)) / a
    return (cauchy + share * rest) / scale, 1.0


def _solvable(solve: Solve) -> Normal | None:
    """With the least damping that gives a solution."""
    for damping in DAMPINGS:
        normal = solve(damping)
        if not isinstance(normal.solution, int):
            return normal
    return None


def _solution(normal: Normal) -> Reduced:
    assert not isinstance(normal.solution, int)
    return normal.solution


def _cap(layout: StateLayout, errors: Float[np.ndarray, "k n"]) -> float:
    """The share of a step that keeps every block within what a linear model tells anything of."""
    share = 1.0
    for block in layout.members:
        if np.isfinite(block.largest_step):
            longest = float(np.abs(errors[:, layout.slice(block.name)]).max(initial=0.0))
            share = min(share, block.largest_step / max(longest, np.finfo(float).tiny))
    return share


def _shared(normal: Normal, errors: Float[np.ndarray, "k n"], share: float) -> Step:
    """Part of the whole step, landmarks and velocities too."""
    points = None
    if normal.eliminated is not None:
        points = share * normal.eliminated.points_step(_solution(normal).poses)
    predicted = share * (2 - share) * normal.decrement
    return Step(share * errors, points, normal, predicted, share)
