"""Whitened rows of a linearised smoothing problem, and what its solution leaves of any right-hand sides.

At the solution of min |J e - y|^2 a right-hand side H leaves M H with M = I - J P J', P = (J'J)^-1. Columns of H are solved for
together, from the factors that the problem's own solution left behind: landmarks, chained errors, then poses and constants.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import solve_triangular
from scipy.sparse import csr_array

from spinfilters.estimators.model_errors.solved_columns import Gradient, HalfSolved, Sensitivity, flat
from spinfilters.estimators.smoothing.factors.motion_factors import SensorRows, prior_rows
from spinfilters.estimators.smoothing.linear.schur_system import SchurSystem
from spinfilters.estimators.smoothing.problem.least_squares import (
    LinearizationPoint,
    NormalEquations,
    Problem,
)


@dataclass(frozen=True)
class Columns:
    """m right-hand sides: numbers for every whitened row.

    Attributes
    ----------
    sensors: (r, i, m) of every sensor without landmarks.   steps: (k - 1, d, m).
    observations: (N, 3, m), or None without any.   prior: (n, m) of the first state.
    """

    sensors: tuple[Float[np.ndarray, "_ _ m"], ...]
    steps: Float[np.ndarray, "k d m"]
    observations: Float[np.ndarray, "N 3 m"] | None
    prior: Float[np.ndarray, "n m"]

    @property
    def count(self) -> int:
        """Of right-hand sides."""
        return self.steps.shape[2]

    @property
    def parts(self) -> tuple[Float[np.ndarray, "_ _ m"], ...]:
        """All rows by kind: sensors, steps, observations, prior."""
        seen = () if self.observations is None else (self.observations,)
        return (*self.sensors, self.steps, *seen, self.prior[None])

    def gram(self, other: "Columns") -> Float[np.ndarray, "m o"]:
        """Products of columns, summed over all rows."""
        return sum(
            (flat(a).T @ flat(b) for a, b in zip(self.parts, other.parts, strict=True)),
            np.zeros((self.count, other.count)),
        )

    def scaled(self, factor: float) -> "Columns":
        """All columns times a number."""
        return self.times(factor * np.eye(self.count))

    def times(self, coefficients: Float[np.ndarray, "m o"]) -> "Columns":
        """Combinations of the columns."""
        seen = None if self.observations is None else self.observations @ coefficients
        sensors = tuple(part @ coefficients for part in self.sensors)
        return Columns(sensors, self.steps @ coefficients, seen, self.prior @ coefficients)

    def minus(self, other: "Columns") -> "Columns":
        """Difference."""
        seen = None
        if self.observations is not None and other.observations is not None:
            seen = self.observations - other.observations
        sensors = tuple(a - b for a, b in zip(self.sensors, other.sensors, strict=True))
        return Columns(sensors, self.steps - other.steps, seen, self.prior - other.prior)

    def part(self, columns: slice) -> "Columns":
        """Some of them."""
        seen = None if self.observations is None else self.observations[:, :, columns]
        sensors = tuple(part[:, :, columns] for part in self.sensors)
        return Columns(sensors, self.steps[:, :, columns], seen, self.prior[:, columns])

    @classmethod
    def joined(cls, parts: "list[Columns]") -> "Columns":
        """Columns side by side."""
        seen = None
        if parts[0].observations is not None:
            seen = np.concatenate([each.observations for each in parts if each.observations is not None], 2)
        sensors = tuple(
            np.concatenate(each, axis=2) for each in zip(*(p.sensors for p in parts), strict=True)
        )
        steps = np.concatenate([each.steps for each in parts], axis=2)
        return cls(sensors, steps, seen, np.concatenate([each.prior for each in parts], axis=1))


def summed(
    index: Int[np.ndarray, " r"], count: int, part: Float[np.ndarray, "r a m"]
) -> Float[np.ndarray, "k a m"]:
    """Sums of the rows of each index."""
    rows = len(index)
    which = csr_array((np.ones(rows), index, np.arange(rows + 1)), shape=(rows, count)).T
    flat = part.reshape(rows, part.shape[1] * part.shape[2])  # of no rows, -1 would tell no width
    return (which @ flat).reshape(count, *part.shape[1:])


@dataclass(frozen=True)
class LinearRows:
    """A solved linear problem; its rows must be in memory (`Problem.is_long` is false)."""

    problem: Problem
    here: LinearizationPoint
    normal: NormalEquations

    @property
    def solution(self) -> SchurSystem:
        """Factors of the normal equations."""
        assert isinstance(self.normal.solution, SchurSystem)
        return self.normal.solution

    @cached_property
    def right(self) -> Columns:
        """y, one column."""
        sensors = tuple(rows[:, :, -1:] for rows in self.sensor_rows)
        seen = None if self.observation_rows is None else self.observation_rows[:, :, -1:]
        return Columns(sensors, self.here.dynamics.rows[:, :, -1:], seen, self.prior_rows[:, -1:])

    @cached_property
    def sensor_rows(self) -> tuple[Float[np.ndarray, "_ _ _"], ...]:
        """Rows [J | y] of every sensor that sees no landmark."""
        motion, here = self.problem.motion, self.here
        made = (motion.sensor_rows(s, here.trajectory, here.pose_only_loss) for s in motion.sensors)
        return tuple(rows for rows, _, _ in made)

    @cached_property
    def observation_rows(self) -> Float[np.ndarray, "N 3 10"] | None:
        """Rows [J | y] of observations by pose and landmark, zero of outliers."""
        fit, linear = self.normal.eliminated, self.here.linear
        if fit is None or linear is None:
            return None
        weight = np.where(fit.used, np.sqrt(fit.weight), 0.0)
        return np.where(fit.used[:, None, None], linear.rows, 0.0) * weight[:, None, None]

    def nothing(self, count: int) -> Columns:
        """Zeros."""
        sensors = tuple(np.zeros((*rows.shape[:2], count)) for rows in self.sensor_rows)
        seen = None if self.observation_rows is None else np.zeros((len(self.observation_rows), 3, count))
        steps = np.zeros((*self.here.dynamics.rows.shape[:2], count))
        return Columns(sensors, steps, seen, np.zeros((len(self.prior_rows), count)))

    def sensitivity(self, right: Columns) -> Sensitivity:
        """P J'H: by how much the solution moves per unit of each right-hand side."""
        ordering, solved = self.problem.ordering, self._solved(self._gradient(right))
        states = np.empty((ordering.epochs, len(ordering.order), right.count))
        states[:, ordering.moving] = solved.moving
        states[:, ordering.constant] = solved.constant
        return Sensitivity(states, solved.landmarks)

    def residual(self, right: Columns) -> Columns:
        """M H."""
        return right.minus(self._explained(self._solved(self._gradient(right)), right.count))

    @cached_property
    def prior_rows(self) -> Float[np.ndarray, "n n1"]:
        ordering, prior = self.problem.ordering, self.problem.motion.prior
        if prior is None:
            return np.zeros((0, len(ordering.order) + 1))
        return prior_rows(ordering, self.here.trajectory[0], prior)

    def columns_of(self, sensor: SensorRows) -> Int[np.ndarray, " c"]:
        """Columns of the state's error that a sensor depends on."""
        return self.problem.motion.sensor_columns(sensor)[:-1]

    def _gradient(self, right: Columns) -> Gradient:
        ordering, m = self.problem.ordering, right.count
        d, J = len(ordering.moving), self.here.dynamics.rows[:, :, :-1]
        every = np.zeros((ordering.epochs, len(ordering.order), m))
        for sensor, rows, part in zip(
            self.problem.motion.sensors, self.sensor_rows, right.sensors, strict=True
        ):
            by_row = np.swapaxes(rows[:, :, :-1], 1, 2) @ part
            every[:, self.columns_of(sensor)] += summed(sensor.epoch, ordering.epochs, by_row)
        by_step = np.swapaxes(J, 1, 2) @ right.steps
        every[:-1, :d] += by_step[:, :d]
        every[1:, :d] += by_step[:, d : 2 * d]
        every[0] += self.prior_rows[:, :-1].T @ right.prior
        constant = every[:, d:].sum(axis=0) + by_step[:, 2 * d :].sum(axis=0)
        landmarks = np.zeros((len(self.here.points), 3, m))
        if self.observation_rows is not None and right.observations is not None:
            fit = self.normal.eliminated
            assert fit is not None
            by_row = np.swapaxes(self.observation_rows[:, :, :-1], 1, 2) @ right.observations
            every[:, :6] += summed(fit.observations.epoch, ordering.epochs, by_row[:, :6])
            landmarks += summed(fit.observations.landmark, len(landmarks), by_row[:, 6:])
        return Gradient(every[:, :d], constant, landmarks)

    def half_solved(self, b: Gradient) -> HalfSolved:
        """A^-1 b."""
        ordering, fit, s = self.problem.ordering, self.normal.eliminated, self.solution
        K, p, m = ordering.epochs, len(ordering.pose), b.constant.shape[1]
        pose, g = b.moving[:, :p].copy(), b.landmarks
        if fit is not None:
            g = np.linalg.solve(self._landmark_sqrts, np.where(fit.is_constrained[:, None, None], g, 0.0))
            pose -= (self._coupling @ g.reshape(-1, m)).reshape(pose.shape)
        chained, X = self._forward(b.moving[:, p:]), s.tridiagonal.coupling[:, :, :-1]
        rest = np.concatenate([pose.reshape(K * p, m), b.constant])
        rest -= X.reshape(-1, X.shape[2]).T @ chained.reshape(-1, m)
        half = solve_triangular(s.information_sqrt, rest, lower=True, check_finite=False)
        return HalfSolved(g, chained, half)

    def _solved(self, b: Gradient) -> Gradient:
        """P b."""
        ordering, fit, s = self.problem.ordering, self.normal.eliminated, self.solution
        K, p, m = ordering.epochs, len(ordering.pose), b.constant.shape[1]
        half = self.half_solved(b)
        g, chained, X = half.landmarks, half.chained, s.tridiagonal.coupling[:, :, :-1]
        kept = solve_triangular(s.information_sqrt, half.kept, lower=True, trans=1, check_finite=False)
        moving = np.empty_like(b.moving)
        moving[:, :p] = kept[: K * p].reshape(K, p, m)
        moving[:, p:] = self._back(chained - X @ kept)
        if fit is not None:
            follow = (self._coupling.T @ moving[:, :p].reshape(-1, m)).reshape(g.shape)
            g = np.linalg.solve(np.swapaxes(self._landmark_sqrts, 1, 2), g - follow)
            g[~fit.is_constrained] = 0.0
        return Gradient(moving, kept[K * p :], g)

    def _forward(self, b: Float[np.ndarray, "k v m"]) -> Float[np.ndarray, "k v m"]:
        """n_k = L_k^-1 (b_k - F_k-1' n_k-1)."""
        inverses, F, n = self._inverses, self.solution.tridiagonal.next, b.copy()
        for k in range(len(n)):
            if k:
                n[k] -= F[k - 1].T @ n[k - 1]
            n[k] = inverses[k] @ n[k]
        return n

    def _back(self, n: Float[np.ndarray, "k v m"]) -> Float[np.ndarray, "k v m"]:
        """e_k = L_k^-T (n_k - F_k e_k+1)."""
        inverses, F = self._inverses, self.solution.tridiagonal.next
        for k in range(len(n) - 1, -1, -1):
            if k + 1 < len(n):
                n[k] -= F[k] @ n[k + 1]
            n[k] = inverses[k].T @ n[k]
        return n

    @cached_property
    def _landmark_sqrts(self) -> Float[np.ndarray, "L 3 3"]:
        """L of the landmarks that are told, the identity of others."""
        fit = self.normal.eliminated
        assert fit is not None
        return np.where(fit.is_constrained[:, None, None], fit.information_sqrt, np.eye(3))

    @cached_property
    def _coupling(self) -> csr_array:
        """Of poses (rows, epoch by epoch) with landmarks (columns), as factors of the latter leave it."""
        fit = self.normal.eliminated
        assert fit is not None
        p, seen, landmark = len(self.problem.ordering.pose), fit.observations.epoch, fit.observations.landmark
        rows = np.broadcast_to((p * seen[:, None] + np.arange(p))[:, None], fit.coupling.shape)
        columns = np.broadcast_to((3 * landmark[:, None] + np.arange(3))[:, :, None], fit.coupling.shape)
        shape = p * self.problem.ordering.epochs, 3 * len(self.here.points)
        told = np.where(fit.is_constrained[landmark, None, None], fit.coupling, 0.0)
        return csr_array((told.ravel(), (rows.ravel(), columns.ravel())), shape=shape)

    @cached_property
    def _inverses(self) -> Float[np.ndarray, "k v v"]:
        """L_k^-1."""
        return np.linalg.inv(np.tril(self.solution.tridiagonal.information_sqrts))

    def _explained(self, e: Gradient, count: int) -> Columns:
        """J e."""
        constant = np.broadcast_to(e.constant, (len(e.moving), *e.constant.shape))
        states = np.concatenate([e.moving, constant], axis=1)
        sensors = tuple(
            rows[:, :, :-1] @ states[sensor.epoch[:, None], self.columns_of(sensor)]
            for sensor, rows in zip(self.problem.motion.sensors, self.sensor_rows, strict=True)
        )
        both = np.concatenate([e.moving[:-1], e.moving[1:], constant[:-1]], axis=1)
        steps = self.here.dynamics.rows[:, :, :-1] @ both
        seen, fit = None, self.normal.eliminated
        if fit is not None and self.observation_rows is not None:
            poses, points = e.moving[fit.observations.epoch, :6], e.landmarks[fit.observations.landmark]
            seen = self.observation_rows[:, :, :-1] @ np.concatenate([poses, points], axis=1)
        return Columns(sensors, steps, seen, self.prior_rows[:, :-1] @ states[0])
