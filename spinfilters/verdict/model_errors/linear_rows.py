"""Whitened rows of a linearised smoothing problem, and what its solution leaves of any right-hand sides.

At the solution of min |J e - y|^2 a right-hand side H leaves M H with M = I - J P J', P = (J'J)^-1. Columns of H are solved for
together, from the factors that the problem's own solution left behind: landmarks, chained errors, then poses and constants.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import solve_triangular

from spinfilters.core.compiled import address
from spinfilters.core.linear_algebra import STRETCH
from spinfilters.inference.noise_model import StepsAfter, steps_after
from spinfilters.smoother.epoch_rows import EpochRows
from spinfilters.smoother.kernels import kernels
from spinfilters.smoother.linear_system import Marginals, SchurSystem
from spinfilters.smoother.motion_factors import SensorRows, prior_rows
from spinfilters.smoother.problem import LinearizationPoint, NormalEquations, Problem

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def flat(part: Float[np.ndarray, "a b m"]) -> Float[np.ndarray, "c m"]:
    """All rows of a part below one another."""
    return part.reshape(-1, part.shape[2])


@dataclass(frozen=True)
class Gradient:
    """J'H: (k, d, m) of moving components, (c, m) of constants, (L, 3, m) of landmarks."""

    moving: Float[np.ndarray, "k d m"]
    constant: Float[np.ndarray, "c m"]
    landmarks: Float[np.ndarray, "L 3 m"]

    @classmethod
    def joined(cls, parts: "Sequence[Gradient]") -> "Gradient":
        """Side by side."""
        return cls(
            np.concatenate([each.moving for each in parts], axis=2),
            np.concatenate([each.constant for each in parts], axis=1),
            np.concatenate([each.landmarks for each in parts], axis=2),
        )


@dataclass(frozen=True)
class HalfSolved:
    """A^-1 b with J'J = A A': (L, 3, m) of landmarks, (k, v, m) of chained errors, (n, m) of poses and constants."""

    landmarks: Float[np.ndarray, "L 3 m"]
    chained: Float[np.ndarray, "k v m"]
    kept: Float[np.ndarray, "n m"]

    @property
    def gram(self) -> Float[np.ndarray, "m m"]:
        """b'P b."""
        parts = (flat(self.landmarks), flat(self.chained), self.kept)
        return sum((part.T @ part for part in parts), np.zeros((self.kept.shape[1],) * 2))


@dataclass(frozen=True)
class Sensitivity:
    """Errors of a solution by m right-hand sides.

    Attributes
    ----------
    states : (k, n, m) float array
        Of every epoch, components in the order of the layout.
    landmarks : (L, 3, m) float array
        Zero of those not given.
    """

    states: Float[np.ndarray, "k n m"]
    landmarks: Float[np.ndarray, "L 3 m"]


@dataclass(frozen=True)
class SeenErrors:
    """Right-hand sides J e of a sensor, which sees m errors e of the state at every epoch: a map of hundreds of points need not be
    gone through for products of them.

    Attributes
    ----------
    rows : EpochRows
        With the sensor's Jacobian J.
    errors : (k, c, m) float array
        Of the columns that the sensor depends on.
    """

    rows: EpochRows
    errors: Float[np.ndarray, "k c m"]

    @cached_property
    def gradient(self) -> Float[np.ndarray, "k c m"]:
        """J'J e."""
        found = np.zeros_like(self.errors)
        seen = self.rows.epoch[self.rows.first]
        found[seen] = self.rows.information[:, :-1, :-1] @ self.errors[seen]
        return found

    @property
    def squares(self) -> Float[np.ndarray, " m"]:
        """Squared length of every right-hand side."""
        return np.einsum("kcm,kcm->m", self.errors, self.gradient)

    @property
    def formed(self) -> Float[np.ndarray, "r i m"]:
        """The numbers of every row."""
        return self.rows.products(self.errors)

    def times(self, coefficients: Float[np.ndarray, "m o"]) -> "SeenErrors":
        """Combinations of the right-hand sides."""
        return replace(self, errors=self.errors @ coefficients)

    def part(self, columns: slice) -> "SeenErrors":
        """Some of them."""
        return replace(self, errors=self.errors[:, :, columns])


@dataclass(frozen=True)
class Columns:
    """m right-hand sides: numbers for every whitened row.

    Attributes
    ----------
    sensors : tuple[(r, i, m) float array, ...]
        Of every sensor without landmarks; none where they are `seen`.
    steps : (k, d, m) float array
        (k, d, m) with k = K - 1 steps between K epochs.
    observations : (N, 3, m) float array or None
        Or None without any.
    prior : (n, m) float array
        Of the first state.
    is_measured : bool
        False where all numbers of sensors and observations are zero.
    states : (K, d, m) float array or None
        Moving components a of the states, less which the rows are, H - J a; None of rows as they are.
    seen : tuple[SeenErrors, ...]
        Of every sensor, in place of their rows.
    """

    sensors: tuple[Float[np.ndarray, "_ _ m"], ...]
    steps: Float[np.ndarray, "k d m"]
    observations: Float[np.ndarray, "N 3 m"] | None
    prior: Float[np.ndarray, "n m"]
    is_measured: bool = True
    states: Float[np.ndarray, "K d m"] | None = None
    seen: tuple[SeenErrors, ...] = ()

    @property
    def count(self) -> int:
        """Of right-hand sides."""
        return self.steps.shape[2]

    @property
    def parts(self) -> tuple[Float[np.ndarray, "_ _ m"], ...]:
        """All rows by kind: sensors, steps, observations, prior."""
        seen = () if self.observations is None else (self.observations,)
        return (*self.formed.sensors, self.steps, *seen, self.prior[None])

    @cached_property
    def formed(self) -> "Columns":
        """With the rows of sensors as numbers."""
        if not self.seen:
            return self
        return replace(self, sensors=tuple(each.formed for each in self.seen), seen=())

    @property
    def of_motion(self) -> "Columns":
        """The rows of steps and prior alone."""
        return Columns((), self.steps, None, self.prior, is_measured=False)

    def gram(self, other: "Columns") -> Float[np.ndarray, "m o"]:
        """Products of columns, summed over all rows."""
        return sum(
            (flat(a).T @ flat(b) for a, b in zip(self.parts, other.parts, strict=True)),
            np.zeros((self.count, other.count)),
        )

    @property
    def squares(self) -> Float[np.ndarray, " m"]:
        """Squared length of every column."""
        rest = replace(self, seen=())
        found = sum(np.einsum("abm,abm->m", part, part) for part in rest.parts)
        return np.asarray(found + sum(each.squares for each in self.seen))

    def scaled(self, factor: float) -> "Columns":
        """All columns times a number."""
        return self.times(factor * np.eye(self.count))

    def times(self, coefficients: Float[np.ndarray, "m o"]) -> "Columns":
        """Combinations of the columns."""
        seen = None if self.observations is None else _times(self.observations, coefficients)
        sensors = tuple(_times(part, coefficients) for part in self.sensors)
        states = None if self.states is None else _times(self.states, coefficients)
        steps, prior = _times(self.steps, coefficients), self.prior @ coefficients
        errors = tuple(each.times(coefficients) for each in self.seen)
        return Columns(sensors, steps, seen, prior, self.is_measured, states, errors)

    def minus(self, other: "Columns") -> "Columns":
        """Difference."""
        seen = None
        if self.observations is not None and other.observations is not None:
            seen = self.observations - other.observations
        sensors = tuple(a - b for a, b in zip(self.formed.sensors, other.formed.sensors, strict=True))
        return Columns(sensors, self.steps - other.steps, seen, self.prior - other.prior)

    def part(self, columns: slice) -> "Columns":
        """Some of them."""
        seen = None if self.observations is None else self.observations[:, :, columns]
        sensors = tuple(part[:, :, columns] for part in self.sensors)
        states = None if self.states is None else self.states[:, :, columns]
        errors = tuple(each.part(columns) for each in self.seen)
        steps, prior = self.steps[:, :, columns], self.prior[:, columns]
        return Columns(sensors, steps, seen, prior, self.is_measured, states, errors)

    @classmethod
    def joined(cls, parts: "list[Columns]") -> "Columns":
        """Columns side by side."""
        if not all(each.seen for each in parts):
            parts = [each.formed for each in parts]
        seen = None
        if parts[0].observations is not None:
            seen = np.concatenate([each.observations for each in parts if each.observations is not None], 2)
        sensors = tuple(
            np.concatenate(each, axis=2) for each in zip(*(p.sensors for p in parts), strict=True)
        )
        steps = np.concatenate([each.steps for each in parts], axis=2)
        prior, measured = np.concatenate([e.prior for e in parts], axis=1), any(e.is_measured for e in parts)
        given = next((each.states for each in parts if each.states is not None), None)
        states = None
        if given is not None:
            shape = given.shape[:2]
            states = np.concatenate(
                [np.zeros((*shape, e.count)) if e.states is None else e.states for e in parts], axis=2
            )
        errors = tuple(
            SeenErrors(each[0].rows, np.concatenate([e.errors for e in each], axis=2))
            for each in zip(*(p.seen for p in parts), strict=True)
        )
        return cls(sensors, steps, seen, prior, measured, states, errors)


def _times(part: Float[np.ndarray, "a b m"], coefficients: Float[np.ndarray, "m o"]) -> np.ndarray:
    """One product of all rows."""
    return (flat(part) @ coefficients).reshape(*part.shape[:2], -1)


def summed(
    index: Int[np.ndarray, " r"], count: int, part: Float[np.ndarray, "r a m"]
) -> Float[np.ndarray, "k a m"]:
    """Sums of the rows of each index."""
    from scipy.sparse import csr_array

    rows = len(index)
    which = csr_array((np.ones(rows), index, np.arange(rows + 1)), shape=(rows, count)).T
    flat = part.reshape(rows, part.shape[1] * part.shape[2])  # of no rows, -1 would give no width
    return (which @ flat).reshape(count, *part.shape[1:])


def _stretches(count: int) -> Iterator[slice]:
    """Observations whose products are in memory together."""
    return (slice(first, first + STRETCH) for first in range(0, count, STRETCH))


def _forward(L: Float[np.ndarray, "k n n"], right: Float[np.ndarray, "k n m"]) -> Float[np.ndarray, "k n m"]:
    """L^-1 of many right-hand sides of many small lower triangles, row by row."""
    found = np.empty_like(right)
    for i in range(L.shape[1]):
        rest = right[:, i] - sum(L[:, i, j, None] * found[:, j] for j in range(i))
        found[:, i] = rest / L[:, i, i, None]
    return found


def _backward(L: Float[np.ndarray, "k n n"], right: Float[np.ndarray, "k n m"]) -> Float[np.ndarray, "k n m"]:
    """L^-T of them."""
    found, n = np.empty_like(right), L.shape[1]
    for i in range(n - 1, -1, -1):
        rest = right[:, i] - sum(L[:, j, i, None] * found[:, j] for j in range(i + 1, n))
        found[:, i] = rest / L[:, i, i, None]
    return found


@dataclass(frozen=True)
class LinearRows:
    """A solved linear problem; its rows must be in memory (`Problem.is_long` is false)."""

    problem: Problem
    here: LinearizationPoint
    normal: NormalEquations

    @property
    def solution(self) -> SchurSystem:
        """Factors of the normal equations."""
        return self.normal.system

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
        return tuple(here.sensor_rows(motion, k).rows for k in range(len(motion.sensors)))

    @cached_property
    def by_epoch(self) -> tuple[EpochRows, ...]:
        """`sensor_rows` with their epochs."""
        motion, here = self.problem.motion, self.here
        return tuple(here.sensor_rows(motion, k).by_epoch for k in range(len(motion.sensors)))

    @property
    def counted(self) -> tuple[Bool[np.ndarray, " _"], ...]:
        """Which measurements of every such sensor have a weight."""
        motion, here = self.problem.motion, self.here
        return tuple(here.sensor_rows(motion, k).counted for k in range(len(motion.sensors)))

    @cached_property
    def left(self) -> Columns:
        """M y = y - J e, what the solution e leaves of the measurements."""
        fit, ordering, errors = self.normal.eliminated, self.problem.ordering, self.solution.errors
        landmarks = np.zeros((0, 3)) if fit is None else fit.points_step(self.solution.poses)
        parts = (errors[:, ordering.moving], errors[0, ordering.constant], landmarks)
        return self.right.minus(self._explained_rows(Gradient(*(part[..., None] for part in parts))))

    @cached_property
    def observation_rows(self) -> Float[np.ndarray, "N 3 10"] | None:
        """Rows [J | y] of observations by pose and landmark, zero of outliers."""
        fit, linear = self.normal.eliminated, self.here.linear
        if fit is None or linear is None:
            return None
        weight = np.where(fit.used, np.sqrt(fit.weight), 0.0)
        return np.where(fit.used[:, None, None], linear.rows, 0.0) * weight[:, None, None]

    def nothing(self, count: int, is_measured: bool = True) -> Columns:
        """Zeros, of which those of the measurements stay so unless ``is_measured``."""
        observed = None if self.observation_rows is None else np.zeros((len(self.observation_rows), 3, count))
        steps, prior = (
            np.zeros((*self.here.dynamics.rows.shape[:2], count)),
            np.zeros((len(self.prior_rows), count)),
        )
        if is_measured:
            sensors = tuple(np.zeros((*rows.shape[:2], count)) for rows in self.sensor_rows)
            return Columns(sensors, steps, observed, prior)
        epochs = self.problem.ordering.epochs
        errors = [np.zeros((epochs, rows.shape[2] - 1, count)) for rows in self.sensor_rows]
        seen = tuple(map(SeenErrors, self.by_epoch, errors))
        return Columns((), steps, observed, prior, is_measured=False, seen=seen)

    def sensitivity(self, right: Columns) -> Sensitivity:
        """P J'H: by how much the solution moves per unit of each right-hand side."""
        ordering, solved = self.problem.ordering, self.solved(self.gradient(right))
        states = np.empty((ordering.epochs, len(ordering.order), right.count))
        states[:, ordering.moving] = solved.moving
        if right.states is not None:
            states[:, ordering.moving] += right.states  # P J'H = P J'(H - J a) + a
        states[:, ordering.constant] = solved.constant
        return Sensitivity(states, solved.landmarks)

    def residual(self, right: Columns) -> Columns:
        """M H."""
        e = self.solved(self.gradient(right))
        if not right.seen:
            return right.minus(self._explained_rows(e))
        states = self.states(e)
        # the sensors' J a - J e, of errors a that they see
        sensors = tuple(
            seen.rows.products(seen.errors - states[:, self.columns_of(sensor)])
            for sensor, seen in zip(self.problem.motion.sensors, right.seen, strict=True)
        )
        left = replace(right, seen=(), states=None).minus(self.explained_beside_sensors(e))
        return replace(left, sensors=sensors)

    @cached_property
    def left_gradients(self) -> tuple[Float[np.ndarray, "k _"], ...]:
        """J'rho of every sensor by epoch, rho what the solution leaves."""
        count, left = self.problem.ordering.epochs, self.left.sensors
        parts = zip(self.by_epoch, left, strict=True)
        return tuple(rows.gradient(part, count)[:, :, 0] for rows, part in parts)

    @cached_property
    def steps_after(self) -> StepsAfter:
        """What the solution leaves of the steps."""
        return steps_after(self.problem, self.here, Marginals(self.solution, self.normal.eliminated))

    def score(self, right: Columns) -> Float[np.ndarray, " m"]:
        """H'rho over the rows that the right-hand sides have, rho what the solution leaves."""
        if not right.is_measured:
            return right.gram(self.left.of_motion)[:, 0]
        if not right.seen:
            return right.gram(self.left)[:, 0]
        found = replace(right, seen=()).gram(replace(self.left, sensors=()))[:, 0]
        for seen, gradient in zip(right.seen, self.left_gradients, strict=True):
            found += np.einsum("kcm,kc->m", seen.errors, gradient)
        return found

    def less_states(self, right: Columns, states: Float[np.ndarray, "k d m"]) -> Columns:
        """H - J a of moving components a, in the place of H: the same error, for M J = 0."""
        nothing = np.zeros((len(self.problem.ordering.constant), right.count))
        landmarks = np.zeros((len(self.here.points), 3, right.count))
        less = right.minus(self._explained_rows(Gradient(states, nothing, landmarks)))
        return replace(less, states=states)

    @cached_property
    def prior_rows(self) -> Float[np.ndarray, "n n1"]:
        """Whitened rows [J | y] of the first state's prior; none without one."""
        ordering, prior = self.problem.ordering, self.problem.motion.prior
        if prior is None:
            return np.zeros((0, len(ordering.order) + 1))
        return prior_rows(ordering, self.here.trajectory[0], prior)

    def columns_of(self, sensor: SensorRows) -> Int[np.ndarray, " c"]:
        """Columns of the state's error that a sensor depends on."""
        return self.problem.motion.sensor_columns(sensor)[:-1]

    def gradient(self, right: Columns) -> Gradient:
        """J'H."""
        ordering, m = self.problem.ordering, right.count
        d, J = len(ordering.moving), self.here.dynamics.rows[:, :, :-1]
        every = np.zeros((ordering.epochs, len(ordering.order), m))
        sensors = self.problem.motion.sensors
        for sensor, errors in zip(sensors, right.seen, strict=bool(right.seen)):
            every[:, self.columns_of(sensor)] += errors.gradient
        if right.is_measured and not right.seen:
            for sensor, rows, part in zip(sensors, self.by_epoch, right.sensors, strict=True):
                every[:, self.columns_of(sensor)] += rows.gradient(part, ordering.epochs)
        # A step k has the columns [moving k | moving k + 1 | constants]: each part of J'H goes to its own epoch.
        by_step = np.swapaxes(J, 1, 2) @ right.steps
        every[:-1, :d] += by_step[:, :d]
        every[1:, :d] += by_step[:, d : 2 * d]
        every[0] += self.prior_rows[:, :-1].T @ right.prior
        constant = every[:, d:].sum(axis=0) + by_step[:, 2 * d :].sum(axis=0)
        landmarks = np.zeros((len(self.here.points), 3, m))
        if self.observation_rows is not None and right.is_measured and right.observations is not None:
            fit = self.normal.eliminated
            assert fit is not None
            # An observation has the columns [pose (6) | landmark (3)].
            for some in _stretches(len(self.observation_rows)):
                by_row = np.swapaxes(self.observation_rows[some, :, :-1], 1, 2) @ right.observations[some]
                every[:, :6] += summed(fit.observations.epoch[some], ordering.epochs, by_row[:, :6])
                landmarks += summed(fit.observations.landmark[some], len(landmarks), by_row[:, 6:])
        return Gradient(every[:, :d], constant, landmarks)

    def half_solved(self, b: Gradient) -> HalfSolved:
        """A^-1 b."""
        ordering, fit, s = self.problem.ordering, self.normal.eliminated, self.solution
        K, p, m = ordering.epochs, len(ordering.pose), b.constant.shape[1]
        pose, g = b.moving[:, :p].copy(), b.landmarks
        # Landmarks first: g = L^-1 b of each, and their share off the poses that observe them.
        if fit is not None:
            g = _forward(self._landmark_sqrts, np.where(fit.is_constrained[:, None, None], g, 0.0))
            pose -= (self._coupling @ g.reshape(-1, m)).reshape(pose.shape)
        # Chained errors along time, then their coupling X off the separator [poses | constants].
        chained, X = self._forward(b.moving[:, p:]), s.tridiagonal.coupling[:, :, :-1]
        rest = np.concatenate([pose.reshape(K * p, m), b.constant])
        rest -= X.reshape(-1, X.shape[2]).T @ chained.reshape(-1, m)
        half = solve_triangular(s.information_sqrt, rest, lower=True, check_finite=False)
        return HalfSolved(g, chained, half)

    def solved(self, b: Gradient) -> Gradient:
        """P b."""
        ordering, fit, s = self.problem.ordering, self.normal.eliminated, self.solution
        K, p, m = ordering.epochs, len(ordering.pose), b.constant.shape[1]
        half = self.half_solved(b)
        g, chained, X = half.landmarks, half.chained, s.tridiagonal.coupling[:, :, :-1]
        # Backwards through the elimination: poses and constants, chained errors, landmarks.
        kept = solve_triangular(s.information_sqrt, half.kept, lower=True, trans=1, check_finite=False)
        moving = np.empty_like(b.moving)
        moving[:, :p] = kept[: K * p].reshape(K, p, m)
        moving[:, p:] = self._solve_backwards(chained - X @ kept)
        if fit is not None:
            follow = (self._coupling.T @ moving[:, :p].reshape(-1, m)).reshape(g.shape)
            g = _backward(self._landmark_sqrts, g - follow)
            g[~fit.is_constrained] = 0.0
        return Gradient(moving, kept[K * p :], g)

    def _forward(self, b: Float[np.ndarray, "k v m"]) -> Float[np.ndarray, "k v m"]:
        """n_k = L_k^-1 (b_k - F_k-1' n_k-1)."""
        chain, library, n = self.solution.tridiagonal, kernels(), np.array(b, dtype=float, order="C")
        if library is not None:
            library.chain_forward(*n.shape, *map(address, (chain.information_sqrts, chain.next, n)))
            return n
        inverses, F = self._inverses, chain.next
        for k in range(len(n)):
            if k:
                n[k] -= F[k - 1].T @ n[k - 1]
            n[k] = inverses[k] @ n[k]
        return n

    def _solve_backwards(self, n: Float[np.ndarray, "k v m"]) -> Float[np.ndarray, "k v m"]:
        """e_k = L_k^-T (n_k - F_k e_k+1)."""
        chain, library, n = self.solution.tridiagonal, kernels(), np.array(n, dtype=float, order="C")
        if library is not None:
            library.chain_backward(*n.shape, *map(address, (chain.information_sqrts, chain.next, n)))
            return n
        inverses, F = self._inverses, chain.next
        for k in range(len(n) - 1, -1, -1):
            if k + 1 < len(n):
                n[k] -= F[k] @ n[k + 1]
            n[k] = inverses[k].T @ n[k]
        return n

    @cached_property
    def _landmark_sqrts(self) -> Float[np.ndarray, "L 3 3"]:
        """L of the landmarks that are determined, the identity of others."""
        fit = self.normal.eliminated
        assert fit is not None
        return np.where(fit.is_constrained[:, None, None], fit.information_sqrt, np.eye(3))

    @cached_property
    def _coupling(self) -> "csr_array":
        """Of poses (rows, epoch by epoch) with landmarks (columns), as factors of the latter leave it."""
        from scipy.sparse import csr_array

        fit = self.normal.eliminated
        assert fit is not None
        p, seen, landmark = len(self.problem.ordering.pose), fit.observations.epoch, fit.observations.landmark
        # blocks (N, 3, p) of observations: entry (n, i, j) stands in row j of its epoch's pose and column i of its landmark
        rows = np.broadcast_to((p * seen[:, None] + np.arange(p))[:, None], fit.coupling.shape)
        columns = np.broadcast_to((3 * landmark[:, None] + np.arange(3))[:, :, None], fit.coupling.shape)
        shape = p * self.problem.ordering.epochs, 3 * len(self.here.points)
        blocks = np.where(fit.is_constrained[landmark, None, None], fit.coupling, 0.0)
        return csr_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=shape)

    @cached_property
    def _inverses(self) -> Float[np.ndarray, "k v v"]:
        """L_k^-1."""
        return np.linalg.inv(np.tril(self.solution.tridiagonal.information_sqrts))

    def _explained_rows(self, e: Gradient) -> Columns:
        """J e."""
        states = self.states(e)
        sensors = tuple(
            rows.products(states[:, self.columns_of(sensor)])
            for sensor, rows in zip(self.problem.motion.sensors, self.by_epoch, strict=True)
        )
        return replace(self.explained_beside_sensors(e), sensors=sensors)

    def seen(self, states: Float[np.ndarray, "k n m"]) -> Columns:
        """Measured rows of errors of the states, components as in `VariableOrdering.order`."""
        sensors, observed = self.problem.motion.sensors, None
        errors = [states[:, self.columns_of(sensor)] for sensor in sensors]
        fit = self.normal.eliminated
        if self.observation_rows is not None and fit is not None:
            observed = self.observation_rows[:, :, :6] @ states[fit.observations.epoch, :6]
        return self.seen_by(errors, observed, states.shape[2])

    def seen_by(
        self,
        errors: Sequence[Float[np.ndarray, "k _ m"]],
        observed: Float[np.ndarray, "N 3 m"] | None,
        count: int,
    ) -> Columns:
        """Right-hand sides J e of every sensor, which sees these errors of its own columns, and those of observations."""
        nothing, seen = self.nothing(count, is_measured=False), tuple(map(SeenErrors, self.by_epoch, errors))
        return replace(nothing, observations=observed, is_measured=True, seen=seen)

    def explained_beside_sensors(self, e: Gradient) -> Columns:
        """J e of all rows but those of the sensors that see no landmark."""
        states, seen, fit = self.states(e), None, self.normal.eliminated
        both = np.concatenate(
            [
                e.moving[:-1],
                e.moving[1:],
                np.broadcast_to(e.constant, (len(e.moving) - 1, *e.constant.shape)),
            ],
            axis=1,
        )
        if fit is not None and self.observation_rows is not None:
            seen = np.empty((len(self.observation_rows), 3, states.shape[2]))
            for some in _stretches(len(seen)):
                poses, points = fit.observations.epoch[some], fit.observations.landmark[some]
                errors = np.concatenate([e.moving[poses, :6], e.landmarks[points]], axis=1)
                np.matmul(self.observation_rows[some, :, :-1], errors, out=seen[some])
        steps = self.here.dynamics.rows[:, :, :-1] @ both
        return Columns((), steps, seen, self.prior_rows[:, :-1] @ states[0])

    def left_beside_sensors(self, groups: Sequence[Columns], e: Gradient) -> Columns:
        """M H of all rows but those of such sensors: of groups of right-hand sides side by side, which e solves."""
        left, end = self.explained_beside_sensors(e), 0
        for part in left.parts:
            np.negative(part, out=part)
        for each in groups:  # in its place: of observations there is room for few such arrays
            own, end = slice(end, end + each.count), end + each.count
            left.steps[:, :, own] += each.steps
            left.prior[:, own] += each.prior
            if left.observations is not None and each.observations is not None:
                left.observations[:, :, own] += each.observations
        return left

    def states(self, e: Gradient) -> Float[np.ndarray, "k n m"]:
        """Errors of every epoch, components as in `VariableOrdering.order`."""
        constant = np.broadcast_to(e.constant, (len(e.moving), *e.constant.shape))
        return np.concatenate([e.moving, constant], axis=1)
