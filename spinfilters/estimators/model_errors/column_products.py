"""Products of what a solution leaves of right-hand sides, by noise component.

With e = P J'H a solution leaves M H = H - J e. Its products over the rows of one sensor need no column of the length of all
measurements but those of H itself, only sums by epoch,

    (M H)'M H = H'H - e'J'H - H'J e + e'J'J e,     (M H)'rho = H'rho - e'J'rho,

and H is zero in measurements for all errors of the motion's model.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.linear_rows import LinearRows
from spinfilters.estimators.model_errors.noise_components import NoiseComponents
from spinfilters.estimators.model_errors.solved_columns import Gradient, flat
from spinfilters.estimators.smoothing.factors.epoch_rows import EpochRows


@dataclass(frozen=True)
class ColumnProducts:
    """Of m right-hand sides H beside rho, what the solution leaves of the measurements.

    Attributes
    ----------
    places: of each of the given right-hand sides among the m.   squares: (m,) H'H.   score: (m,) H'rho.
    information: (m, m) of M H.   left: (c,) rho'rho by noise component.   shared: (c, m) rho'M H.   own: (c, m, m) of M H.
    """

    places: tuple[slice, ...]
    squares: Float[np.ndarray, " m"]
    score: Float[np.ndarray, " m"]
    information: Float[np.ndarray, "m m"]
    left: Float[np.ndarray, " c"]
    shared: Float[np.ndarray, "c m"]
    own: Float[np.ndarray, "c m m"]

    @classmethod
    def of(cls, rows: LinearRows, noise: NoiseComponents, given: Sequence[Columns]) -> "ColumnProducts":
        """Of all right-hand sides together; those of measurements stand first."""
        order = sorted(range(len(given)), key=lambda k: not given[k].is_measured)
        ends = np.cumsum([0, *(given[k].count for k in order)]).tolist()
        places = {k: slice(a, b) for k, a, b in zip(order, ends, ends[1:], strict=False)}
        driven = [replace(each, sensors=()) for each in given if not each.is_measured]
        groups = [[each for each in given if each.is_measured], driven]
        solved = _Solved.of(rows, [Columns.joined(group) for group in groups if group])
        shared, own = solved.by_component(noise)
        return cls(
            tuple(places[k] for k in range(len(given))),
            np.concatenate([each.squares for each in solved.right]),
            np.concatenate([each.gram(_alike(rows.left, each))[:, 0] for each in solved.right]),
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
class _Solved:
    """Right-hand sides of measurements, then of the motion, with the solution for both.

    Attributes
    ----------
    states: (k, n, m) e of every epoch.   beside: M H of all rows but those of sensors.
    """

    rows: LinearRows
    right: tuple[Columns, ...]
    states: Float[np.ndarray, "k n m"]
    beside: Columns

    @classmethod
    def of(cls, rows: LinearRows, groups: Sequence[Columns]) -> "_Solved":
        """Solved together."""
        e = rows.solved(Gradient.joined([rows.gradient(each) for each in groups]))
        beside = Columns.joined([replace(each, sensors=()) for each in groups])
        right = tuple(each if each.is_measured else each.of_motion for each in groups)
        return cls(rows, right, rows.states(e), beside.minus(rows.explained_beside_sensors(e)))

    @property
    def information(self) -> Float[np.ndarray, "m m"]:
        """Products over all rows."""
        found = self.beside.gram(self.beside)
        return found + sum(self._of_sensor(k)[1] for k in range(len(self.rows.by_epoch)))

    def by_component(
        self, noise: NoiseComponents
    ) -> tuple[Float[np.ndarray, "c m"], Float[np.ndarray, "c m m"]]:
        """Products with rho, and of M H with itself, over the rows of each noise component."""
        shared = noise.products(replace(self.rows.left, sensors=()), self.beside)[:, 0]
        own = noise.products(self.beside, self.beside)
        for k, each in enumerate(noise.components):
            for number, rows in each.sensors.items():
                with_left, with_own = self._of_sensor(number, rows)
                shared[k] += with_left
                own[k] += with_own
        return shared, own

    def _of_sensor(
        self, number: int, chosen: tuple[int, ...] | None = None
    ) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m m"]]:
        """Products over the chosen rows of every measurement of a sensor, or all."""
        rows, left = self.rows.by_epoch[number], self.rows.left.sensors[number]
        measured = next((each.sensors[number] for each in self.right if each.sensors), None)
        if chosen is not None and chosen != tuple(range(left.shape[1])):
            rows = EpochRows(rows.rows[:, list(chosen)], rows.epoch)
            left = left[:, list(chosen)]
            measured = None if measured is None else measured[:, list(chosen)]
        sensor = self.rows.problem.motion.sensors[number]
        e, count = self.states[:, self.rows.columns_of(sensor)], len(self.states)
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


def _alike(left: Columns, right: Columns) -> Columns:
    """Residuals in the rows that right-hand sides have."""
    return left if right.is_measured else left.of_motion
