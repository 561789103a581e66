"""Products of whitened rows by noise component: scores, information, and their distributions where the model is right.

The root of a function of one number is found as by SciPy's `brentq`, step by step. The import of `scipy.optimize` takes a third of
a second: more than all that a comparison needs it for.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import copysign, isnan
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import ndtr

from spinfilters.core.chi_square import chi_square_tail, fisher_tail
from spinfilters.filters.noise_levels import ComponentRows
from spinfilters.smoother.epoch_rows import EpochRows
from spinfilters.verdict.model_errors.linear_rows import (
    Columns,
    Gradient,
    LinearRows,
    SeenErrors,
    flat,
    summed,
)

_ABSOLUTE: Final = 2e-12
_RELATIVE: Final = 8.881784197001252e-16  # four units in the last place
_MOST_STEPS: Final = 100


def root_between(function: Callable[[float], float], low: float, high: float) -> float:
    """Root of a continuous function within an interval at whose ends its signs differ (Brent 1973, chapter 4).

    Parameters
    ----------
    function : Callable[[float], float]
        Its root is sought to 2e-12 and to rounding of the root.
    low, high : float
        Ends of the interval.

    Returns
    -------
    float
        The root.

    Raises
    ------
    ArithmeticError
        The signs at both ends are equal, a value is not a number, or 100 steps are not enough.
    """
    # x is the best point, `opposite` the last one of the other sign, `before` the one before x; y are the values there.
    before, x = low, high
    y_before, y = _number(function, before), _number(function, x)
    if y_before == 0:
        return before
    if y == 0:
        return x
    if _same_sign(y_before, y):
        raise ArithmeticError(f"no two signs: {y_before:g} at {low:g} and {y:g} at {high:g}")
    opposite = y_opposite = last_step = step = 0.0
    for _ in range(_MOST_STEPS):
        if y_before != 0 and y != 0 and not _same_sign(y_before, y):
            opposite, y_opposite = before, y_before
            last_step = step = x - before
        if abs(y_opposite) < abs(y):
            before, x, opposite = x, opposite, x
            y_before, y, y_opposite = y, y_opposite, y
        tolerance = (_ABSOLUTE + _RELATIVE * abs(x)) / 2
        half = (opposite - x) / 2
        if y == 0 or abs(half) < tolerance:
            return x
        tried = half
        if abs(last_step) > tolerance and abs(y) < abs(y_before):
            if before == opposite:  # a secant
                tried = -y * (x - before) / (y - y_before)
            else:  # inverse quadratic interpolation through all three points
                to_before, to_opposite = (y_before - y) / (before - x), (y_opposite - y) / (opposite - x)
                tried = -y * (y_opposite * to_opposite - y_before * to_before)
                tried /= to_opposite * to_before * (y_opposite - y_before)
        if 2 * abs(tried) < min(abs(last_step), 3 * abs(half) - tolerance):
            last_step, step = step, tried
        else:  # bisection
            last_step = step = half
        before, y_before = x, y
        x += step if abs(step) > tolerance else copysign(tolerance, half)
        y = _number(function, x)
    raise ArithmeticError(f"no root found between {low:g} and {high:g} in {_MOST_STEPS} steps")


def _number(function: Callable[[float], float], x: float) -> float:
    """Value of a function; ArithmeticError where it is not a number."""
    value = function(x)
    if isnan(value):
        raise ArithmeticError(f"the value at {x:g} is not a number")
    return value


def _same_sign(one: float, other: float) -> bool:
    return copysign(1.0, one) == copysign(1.0, other)


NEAR_MEAN: Final = 1e-4
"""Signed root of the likelihood ratio below which the saddlepoint is at the mean, where its own formula is 0 / 0."""
FEWEST: Final = 2.0
"""Degrees of freedom left for a noise level, at least."""


def weighted_chi_square_tail(weights: Float[np.ndarray, " n"], value: float, dof: float) -> float:
    """P(sum of w z^2 > value chi2_dof / dof), weights w positive, ``dof`` infinite for a known noise level."""
    w = weights[weights > 0]
    if not w.size or not value > 0:
        return 1.0
    if not np.isfinite(dof):
        return _tail(w, np.ones(len(w)), value)
    return _tail(np.append(w, -value / dof), np.append(np.ones(len(w)), dof), 0.0)


def _tail(w: Float[np.ndarray, " n"], count: Float[np.ndarray, " n"], value: float) -> float:
    """P(sum of w chi2_count > value)."""

    def slope(t: float) -> float:
        """Slope of the exponent at t."""
        return float((count * w / (1 - 2 * t * w)).sum()) - value

    low, high = -0.5 / abs(w.min()) if w.min() < 0 else -_far(slope, w), 0.5 / w.max()
    margin = 1e-12
    t = root_between(slope, low * (1 - margin), high * (1 - margin))
    cumulant = -0.5 * float((count * np.log1p(-2 * t * w)).sum())
    curvature = 2 * float((count * (w / (1 - 2 * t * w)) ** 2).sum())
    r = float(np.sign(t) * np.sqrt(max(2 * (t * value - cumulant), 0.0)))
    if abs(r) < NEAR_MEAN:  # of Edgeworth's expansion
        third = 8 * float((count * w**3).sum())
        return 0.5 - third / (6 * np.sqrt(2 * np.pi) * curvature**1.5)
    v = t * np.sqrt(curvature)
    return float(np.clip(ndtr(-(r + np.log(v / r) / r)), 0.0, 1.0))


def _far(slope: Callable[[float], float], w: Float[np.ndarray, " n"]) -> float:
    """A t so far below zero that the slope is negative there."""
    t = 1 / w.max()
    while slope(-t) > 0:
        t *= 4
    return t


def gain_tail(gain: float, count: float, dof: float) -> float:
    """Probability of a greater gain by ``count`` constant errors, noise levels known to ``dof`` degrees of freedom."""
    if not np.isfinite(dof):
        return float(chi_square_tail(gain, count))
    left = max(dof - count, FEWEST)
    return fisher_tail(float(np.expm1(min(gain / dof, 500.0))) * left / count, count, left)


TELLING: Final = 20.0
"""Redundancy of a component from which a ratio of its squared residuals is informative."""
LEAST_SHARE: Final = -0.9
"""Of its degrees of freedom by which a level is less likely with an error removed, at least."""


@dataclass(frozen=True)
class Gain:
    """Fall of -2 ln likelihood, profiled over the noise levels.

    Attributes
    ----------
    dof : float
        Degrees of freedom that identify these levels; infinite of known ones.
    level : float
        By how much ln variance falls of the level that falls most, among those that are identified from the same residuals:
        not those that are known or barely identified, and none with a level that represents a correlated error.
    """

    value: float
    dof: float
    level: float


@dataclass(frozen=True)
class NoiseComponents:
    """Which rows each noise level scales.

    Attributes
    ----------
    components : tuple[ComponentRows, ...]
        Of sensors.
    factors : tuple[(k - 1, d, i) float array, ...]
        Of each disturbance, L^-1 G of its share G G' of a step's covariance L L'.
    redundancy : (c,) float array
        S of each, expected squared residuals, sensors first.
    known : (c,) bool array
        Whether a level is stated, not identified.
    correlation : (c,) float array
        Samples that count as one, of a level that represents a correlated error as white noise of its weight; else 1.
    telling : (c,) float array
        Degrees of freedom of the residuals that identify each level: its redundancy; of a correlated error what the states,
        which are as slow, leave of its independent samples.
    inflation : (c,) float array
        Of stated variances for errors that rows have in common, at least 1.
    """

    components: tuple[ComponentRows, ...]
    factors: tuple[Float[np.ndarray, "k d _"], ...]
    redundancy: Float[np.ndarray, " c"]
    known: Bool[np.ndarray, " c"]
    correlation: Float[np.ndarray, " c"]
    telling: Float[np.ndarray, " c"]
    inflation: Float[np.ndarray, " c"]

    def squares(self, rest: Columns) -> Float[np.ndarray, " c"]:
        """Squared residuals of each component, of one column."""
        return self.products(rest, rest)[:, 0, 0]

    def products(self, one: Columns, other: Columns) -> Float[np.ndarray, "c m o"]:
        """Products of columns by component, over the rows of each component that the columns have."""
        found = np.zeros((len(self.redundancy), one.count, other.count))
        for k, each in enumerate(self.components):
            for sensor, rows in each.sensors.items() if one.sensors else ():
                found[k] += _product(one.sensors[sensor], other.sensors[sensor], rows)
            if each.landmarks and one.observations is not None and other.observations is not None:
                found[k] += flat(one.observations).T @ flat(other.observations)
        for k, W in enumerate(self.factors, start=len(self.components)):
            explained = [flat(W.swapaxes(1, 2) @ each.steps) for each in (one, other)]
            found[k] = explained[0].T @ explained[1]
        return found

    @property
    def correlated(self) -> Bool[np.ndarray, " c"]:
        """Whether a level represents an error that is correlated."""
        return self.correlation > 1

    def beside_all(self, statistic: float, count: float, left: Float[np.ndarray, " c"]) -> float:
        """Probability of a greater statistic of ``count`` errors, relative to what all residuals leave.

        Where a level represents a correlated error, which an error of the models may have been taken for; else 1. Its white noise
        makes residuals smaller than their redundancy, by the samples that count as one.

        Parameters
        ----------
        left : (c,) float array
            Squared residuals by component, the error in them.
        """
        if not self.correlated.any() or statistic <= 0:
            return 1.0
        dof = max(float(self.redundancy.sum() / self.correlation.max()), count + FEWEST)
        rest = max(float(left.sum()) - statistic, np.finfo(float).tiny)
        return fisher_tail(statistic / count * (dof - count) / rest, count, dof - count)

    @property
    def dof(self) -> Float[np.ndarray, " c"]:
        """Degrees of freedom by which each level is determined, its prior's included; infinite for known levels."""
        return np.where(self.known, np.inf, self.telling + 1)

    @property
    def sensor_dof(self) -> float:
        """Of the sensors' level that fewest identify."""
        return float(self.dof[: len(self.components)].min(initial=np.inf))

    def gain(self, before: Float[np.ndarray, " c"], after: Float[np.ndarray, " c"]) -> Gain:
        """Gain from the `squares` of one residual to those of another.

        Its degrees of freedom are those of the levels that fall, by their shares of the fall.
        The squares of a correlated error identify the level that represents it less than the recording did from which it comes.
        """
        r, left, dof = before, after, self.dof
        finite = np.where(self.known, 1.0, dof)
        shares = np.maximum((r - left) / finite, LEAST_SHARE)
        falls = np.where(self.correlated, np.log1p(shares), np.log((r + 1) / (left + 1)))
        each = np.where(self.known, r - left, finite * falls)
        falls = np.maximum(each, 0.0)
        per_dof = float((falls / dof).sum())
        shared = (self.redundancy > TELLING) & ~self.known & ~self.correlated.any()
        level = float((falls / finite)[shared].max(initial=0.0))
        return Gain(float(each.sum()), float(falls.sum()) / per_dof if per_dof > 0 else np.inf, level)


def _product(
    one: Float[np.ndarray, "r i m"], other: Float[np.ndarray, "r i o"], rows: tuple[int, ...]
) -> Float[np.ndarray, "m o"]:
    """Product over some of the i rows of every measurement."""
    if rows != tuple(range(one.shape[1])):
        one, other = one[:, list(rows)], other[:, list(rows)]
    return flat(one).T @ flat(other)


_MEASURED, _SEEN, _DRIVEN = range(3)


def _kind(columns: Columns) -> int:
    """Whether sensors' rows of right-hand sides are numbers, errors of states that they see, or zero."""
    if not columns.is_measured:
        return _DRIVEN
    return _SEEN if columns.seen else _MEASURED


@dataclass(frozen=True)
class ColumnProducts:
    """Of m right-hand sides H and of rho, what the solution leaves of the measurements.

    Attributes
    ----------
    places : tuple[slice, ...]
        Of each of the given right-hand sides among the m.
    squares : (m,) float array
        H'H.
    score : (m,) float array
        H'rho.
    information : (m, m) float array
        Of M H.
    left : (c,) float array
        Rho'rho by noise component.
    shared : (c, m) float array
        Rho'M H.
    own : (c, m, m) float array
        Of M H.
    """

    places: tuple[slice, ...]
    squares: Float[np.ndarray, " m"]
    score: Float[np.ndarray, " m"]
    information: Float[np.ndarray, "m m"]
    left: Float[np.ndarray, " c"]
    shared: Float[np.ndarray, "c m"]
    own: Float[np.ndarray, "c m m"]

    @classmethod
    def of(cls, rows: LinearRows, noise: NoiseComponents, given: list[Columns]) -> "ColumnProducts":
        """Of all right-hand sides together; those of measurements stand first.

        In the list, those of measured numbers become views of what joins them: there is no room for both.
        """
        order = sorted(range(len(given)), key=lambda k: _kind(given[k]))
        ends = np.cumsum([0, *(given[k].count for k in order)]).tolist()
        places = {k: slice(a, b) for k, a, b in zip(order, ends, ends[1:], strict=False)}
        groups = [[each for each in given if _kind(each) == kind] for kind in range(_DRIVEN)]
        groups.append([each.of_motion for each in given if _kind(each) == _DRIVEN])
        together = [Columns.joined(group) for group in groups if group]
        groups.clear()
        for k, each in enumerate(given):
            if _kind(each) == _MEASURED:
                view = together[0].part(places[k])
                given[k] = view if each.states is not None else replace(view, states=None)
        solved = _SolvedRows.of(rows, together)
        shared, own = solved.by_component(noise)
        return cls(
            tuple(places[k] for k in range(len(given))),
            np.concatenate([each.squares for each in solved.right]),
            np.concatenate([rows.score(each) for each in solved.right]),
            solved.information,
            noise.squares(rows.left),
            shared,
            own,
        )

    def left_without(self, place: slice, size: Float[np.ndarray, " m"]) -> Float[np.ndarray, " c"]:
        """Squared residuals of each noise component without errors of these sizes."""
        gone = 2 * self.shared[:, place] @ size - size @ self.own[:, place, place] @ size
        return np.maximum(self.left - gone, 0.0)


@dataclass(frozen=True)
class _SolvedRows:
    """Right-hand sides of measurements, then of the motion, with the solution for both.

    Attributes
    ----------
    states : (k, n, m) float array
        e of every epoch.
    beside : Columns
        M H of all rows but those of sensors.
    """

    rows: LinearRows
    right: tuple[Columns, ...]
    states: Float[np.ndarray, "k n m"]
    beside: Columns
    _whole: dict[int, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    @classmethod
    def of(cls, rows: LinearRows, groups: Sequence[Columns]) -> "_SolvedRows":
        """Solved together."""
        e = rows.solved(Gradient.joined([rows.gradient(each) for each in groups]))
        return cls(rows, tuple(groups), rows.states(e), rows.left_beside_sensors(groups, e))

    @property
    def _seen(self) -> Iterator[tuple[slice, tuple[SeenErrors, ...]]]:
        """Right-hand sides that sensors see as errors of the states, with their places."""
        begin = 0
        for each in self.right:
            if each.seen:
                yield slice(begin, begin + each.count), each.seen
            begin += each.count

    @property
    def information(self) -> Float[np.ndarray, "m m"]:
        """Products over all rows."""
        found = self.beside.gram(self.beside)
        return found + sum(self._of_whole_sensor(k)[1] for k in range(len(self.rows.by_epoch)))

    def by_component(
        self, noise: NoiseComponents
    ) -> tuple[Float[np.ndarray, "c m"], Float[np.ndarray, "c m m"]]:
        """Products with rho, and of M H with itself, over the rows of each noise component."""
        shared = noise.products(replace(self.rows.left, sensors=()), self.beside)[:, 0]
        own = noise.products(self.beside, self.beside)
        for k, each in enumerate(noise.components):
            for number, rows in each.sensors.items():
                every = rows == tuple(range(self.rows.left.sensors[number].shape[1]))
                with_left, with_own = (
                    self._of_whole_sensor(number) if every else self._of_sensor(number, rows)
                )
                shared[k] += with_left
                own[k] += with_own
        return shared, own

    def _of_whole_sensor(self, number: int) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m m"]]:
        """Products over all rows of every measurement of a sensor, computed once."""
        if number not in self._whole:
            self._whole[number] = self._of_sensor(
                number, tuple(range(self.rows.left.sensors[number].shape[1]))
            )
        return self._whole[number]

    def _of_sensor(
        self, number: int, chosen: tuple[int, ...]
    ) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m m"]]:
        """Products over the chosen rows of every measurement of a sensor."""
        rows, left = self.rows.by_epoch[number], self.rows.left.sensors[number]
        measured = next((each.sensors[number] for each in self.right if each.sensors), None)
        if chosen != tuple(range(left.shape[1])):
            rows = EpochRows(rows.rows[:, list(chosen)], rows.epoch)
            left = left[:, list(chosen)]
            measured = None if measured is None else measured[:, list(chosen)]
        sensor = self.rows.problem.motion.sensors[number]
        e, count = self.states[:, self.rows.columns_of(sensor)], len(self.states)
        for place, seen in self._seen:  # of these J e stands for M H = J a - J e
            e[:, :, place] -= seen[number].errors
        information = np.zeros((count, e.shape[1], e.shape[1]))
        information[rows.epoch[rows.first]] = rows.information[:, :-1, :-1]
        own = flat(e).T @ flat(information @ e)
        shared = -(flat(e).T @ flat(rows.gradient(left, count)))[:, 0]
        if measured is not None:
            m, across = measured.shape[2], flat(rows.gradient(measured, count)).T @ flat(e)
            own[:m] -= across
            own[:, :m] -= across.T
            own[:m, :m] += flat(measured).T @ flat(measured)
            shared[:m] += flat(measured).T @ flat(left)[:, 0]
        return shared, own


def information_by_epoch(
    rows: LinearRows, columns: Columns, chosen: Int[np.ndarray, " c"]
) -> Float[np.ndarray, "n n"]:
    """F among the errors of the chosen epochs, epoch by epoch, of measured columns."""
    q, count = columns.count, len(chosen)
    # F = H'H - (J'H)' P (J'H): the second term couples all epochs, in blocks of q errors of each chosen epoch
    F = -rows.half_solved(_gradient(rows, columns, chosen)).gram
    own = np.zeros((rows.problem.ordering.epochs, q, q))
    for seen in columns.seen:
        own += np.swapaxes(seen.errors, 1, 2) @ seen.gradient
    sensors = rows.problem.motion.sensors
    for sensor, part in zip(sensors, columns.sensors, strict=not columns.seen):
        each = EpochRows(part, sensor.epoch)
        own[sensor.epoch[each.first]] += each.information
    observations = rows.problem.observations
    if observations is not None and columns.observations is not None:
        products = np.swapaxes(columns.observations, 1, 2) @ columns.observations
        own += summed(observations.epoch, len(own), products)
    # the first term has the blocks on the diagonal alone, for a row is of one epoch
    number = np.arange(count)
    blocks = F.reshape(count, q, count, q)
    blocks[number, :, number] += own[chosen]
    return F


def _gradient(rows: LinearRows, columns: Columns, chosen: Int[np.ndarray, " c"]) -> Gradient:
    """J'H, a column for each chosen epoch and error."""
    ordering, fit, q, count = rows.problem.ordering, rows.normal.eliminated, columns.count, len(chosen)
    K, d, number = ordering.epochs, len(ordering.moving), np.arange(count)
    # (epoch, component of its state, chosen epoch, error): a measurement of chosen epoch number c fills epoch chosen[c] alone
    every = np.zeros((K, len(ordering.order), count, q))
    by_sensor = [seen.gradient for seen in columns.seen]
    if not by_sensor:
        made = zip(rows.by_epoch, columns.sensors, strict=True)
        by_sensor = [each.gradient(part, K) for each, part in made]
    for sensor, gradient in zip(rows.problem.motion.sensors, by_sensor, strict=True):
        every[chosen[:, None], rows.columns_of(sensor), number[:, None]] += gradient[chosen]
    landmarks = np.zeros((len(rows.here.points), 3, count * q))
    if fit is not None and rows.observation_rows is not None and columns.observations is not None:
        # observations of the chosen epochs, with the number of their epoch among these
        place = np.full(K, -1)
        place[chosen] = number
        own = np.flatnonzero(place[fit.observations.epoch] >= 0)
        at, landmark = place[fit.observations.epoch[own]], fit.observations.landmark[own]
        by_row = np.swapaxes(rows.observation_rows[own, :, :-1], 1, 2) @ columns.observations[own]
        # their rows have the columns [pose (6) | landmark (3)]; a landmark sums over the observations of each epoch by itself
        every[chosen, :6, number] += summed(at, count, by_row[:, :6])
        seen = summed(landmark * count + at, len(landmarks) * count, by_row[:, 6:])
        seen = seen.reshape(len(landmarks), count, 3, q)
        landmarks = np.swapaxes(seen, 1, 2).reshape(len(landmarks), 3, count * q)
    flat = every.reshape(K, -1, count * q)
    return Gradient(flat[:, :d], flat[:, d:].sum(axis=0), landmarks)
