"""The map of a filter: landmarks with their errors, and the updates that keep it correlated with the state.

`LandmarkMap` holds positions, dependence on the shared modes and own covariances; `HeldMap` adds its update. Modes change in
every epoch. Landmarks that are not observed are not touched: for each of the latest `SLOTS` epochs it is kept how the modes of
then follow from those of now,

    m_then = transform m_now + shift + f,   cov f = spread,

and a landmark is brought up to date when it is observed next, or when its turn comes: every epoch takes a share of the map in turn,
so that hardly any falls behind by as many epochs as there are slots, and no epoch costs more than another.
"""

from functools import cache
from itertools import repeat
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.errors import InputError
from spinfilters.filters.compiled_steps import steps_of
from spinfilters.filters.estimator import NO_IDS, LandmarkBelief, MapChange, Measurement
from spinfilters.filters.landmark_observations import SolvedObservations
from spinfilters.filters.landmark_steps import (
    FIRST_ROOM,
    SLOTS,
    Closing,
    LandmarkArrays,
    MapObservations,
    next_epoch,
)
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.models.gauge import GAUGE_DIM
from spinfilters.models.measurement import LandmarkSensor, NewLandmarks
from spinfilters.models.state_blocks import ATTITUDE
from spinfilters.models.state_layout import StateLayout

CONFIRMED = 2
"""Observations that agree, from which on an observation that disagrees is the outlier, not the landmark."""
WRONG_IN_A_ROW = 3
"""Observations in a row outside the gate after which the landmark, not the observations, is taken to be wrong."""
FIELDS = ("ids", "points", "modes", "roots", "epoch", "hits", "wrong", "last")
TRANSFORMATIONS = ("transform", "spread", "shift", "attitude")
LARGEST_TABLE = 1 << 18
"""Ids from zero on whose rows are found in a table, of 2 MB at most; others are looked up one by one."""


class RowsOfIds:
    """Rows of landmarks by their ids."""

    def __init__(self) -> None:
        self._rows: dict[int, int] = {}
        self._table = np.full(FIRST_ROOM, -1)  # the same of small ids, -1 where there is none

    def find(self, ids: Int[np.ndarray, " q"]) -> Int[np.ndarray, " q"]:
        """Row of every id, -1 where there is none."""
        if self._are_in_table(ids):
            return self._table[ids]
        return self._look_up(ids)

    def note(self, ids: Int[np.ndarray, " q"], rows: Int[np.ndarray, " q"]) -> None:
        """Give ids these rows, whether or not they had others."""
        self._rows.update(zip(ids.tolist(), rows.tolist(), strict=True))
        small = ids[(ids >= 0) & (ids < LARGEST_TABLE)]
        largest = int(small.max(initial=0))
        if largest >= len(self._table):
            room = min(max(2 * len(self._table), largest + 1), LARGEST_TABLE)
            self._table = np.concatenate([self._table, np.full(room - len(self._table), -1)])
        self._table[small] = rows if len(small) == len(ids) else self._look_up(small)

    def forget(self, ids: Int[np.ndarray, " q"]) -> None:
        """Remove ids."""
        for key in ids.tolist():
            del self._rows[key]
        self._table[ids[(ids >= 0) & (ids < len(self._table))]] = -1

    def _are_in_table(self, ids: Int[np.ndarray, " q"]) -> bool:
        # a negative id is large as a number without sign
        return ids.dtype == np.int64 and len(ids) > 0 and int(ids.view(np.uint64).max()) < len(self._table)

    def _look_up(self, ids: Int[np.ndarray, " q"]) -> Int[np.ndarray, " q"]:
        return np.fromiter(map(self._rows.get, ids.tolist(), repeat(-1)), np.int64, len(ids))


class LandmarkMap(LandmarkArrays):
    """Landmarks in rows, the first ``count`` of arrays that grow in steps."""

    def __init__(self, rank: int, precision: str = "float64") -> None:
        super().__init__(rank, precision, steps_of(rank, precision))
        self._rows = RowsOfIds()

    def __len__(self) -> int:
        return self.count

    def locate(self, ids: Int[np.ndarray, " q"]) -> Int[np.ndarray, " q"]:
        """Row of every id, -1 where the map does not hold it."""
        return self._rows.find(ids)

    def append(
        self,
        ids: Int[np.ndarray, " q"],
        points: Float[np.ndarray, "q 3"],
        modes: Float[np.ndarray, "q 3 r"],
        roots: Float[np.ndarray, "q 3 3"],
        confirmed: int = 1,
    ) -> None:
        """New landmarks.

        Parameters
        ----------
        modes : ndarray of float, shape (q, 3, r)
            By those of the present epoch.
        confirmed : int
            Observations that agree about each of them.
        """
        begin, end = self.count, self.count + len(ids)
        self._make_room(end)
        values = (ids, points, modes, roots, self.now, confirmed, 0, self.now)
        for name, value in zip(FIELDS, values, strict=True):
            getattr(self, name)[begin:end] = value
        self._rows.note(ids, np.arange(begin, end))
        self.count = end

    def refuse(self, rows: Int[np.ndarray, " q"]) -> Int[np.ndarray, " m"]:
        """Count refused observations per landmark; returns rows of landmarks that must be wrong themselves.

        A landmark is, that disagrees with everything lately observed of it, or with the second observation there ever was.
        """
        self.wrong[rows] += 1
        self.last[rows] = self.now
        return rows[(self.wrong[rows] >= WRONG_IN_A_ROW) | (self.hits[rows] < CONFIRMED)]

    def remove(self, rows: Int[np.ndarray, " q"]) -> Int[np.ndarray, " q"]:
        """Remove the landmarks of these rows, and return their ids. The last rows take their places."""
        removed = self.ids[rows]
        if not len(rows):
            return removed
        stay = np.ones(self.count, dtype=bool)
        stay[rows] = False
        count = self.count - len(rows)
        # Removed rows among the first `count` are filled by the remaining rows behind, which are as many.
        holes = np.flatnonzero(~stay[:count])
        movers = count + np.flatnonzero(stay[count:])
        self.refresh(movers)
        for name in FIELDS:
            array = getattr(self, name)
            array[holes] = array[movers]
        self.count = count
        self._rows.forget(removed)
        self._rows.note(self.ids[holes], holes)
        return removed

    def stalest(self, largest: int) -> Int[np.ndarray, " q"]:
        """Rows of the landmarks observed longest ago, to remove once there are more than ``largest``.

        So many are named that afterwards a sixteenth of ``largest`` is free again.
        """
        if self.count <= largest:
            return np.zeros(0, dtype=np.int64)
        going = self.count - largest + largest // 16
        return np.argsort(self.last[: self.count], kind="stable")[:going]

    def refresh(self, rows: Int[np.ndarray, " q"]) -> None:
        """Bring landmarks up to the present epoch's modes."""
        self.steps.refresh(self, rows)

    def advance(
        self,
        transform: Float[np.ndarray, "r r"],
        dropped: Float[np.ndarray, "r c"],
        shift: Float[np.ndarray, " r"],
    ) -> None:
        """Advance to the next epoch.

        m_before = shift + transform m + dropped f, f of unit covariance.
        """
        begin, end = self.take_turn()
        late = np.flatnonzero(self.epoch[: self.count] < self.now - (SLOTS - 2))  # where the map has grown
        self.refresh(np.union1d(np.arange(begin, end), late))
        next_epoch(self, transform, dropped, shift)

    def take_turn(self) -> tuple[int, int]:
        """First and last row of the share of the map to refresh next.

        All of it is refreshed in fewer epochs than there are slots.
        """
        begin = self.turn
        end = min(begin - (-self.count // (SLOTS - 4)), self.count)
        self.turn = 0 if end == self.count else end
        return begin, end

    def snapshot(self) -> dict[str, np.ndarray]:
        """Its whole state as arrays named ``map.<what>``."""
        kept = {name: getattr(self, name)[: self.count].copy() for name in FIELDS}
        kept |= {name: getattr(self, name).copy() for name in TRANSFORMATIONS}
        kept |= {"now": np.array(self.now), "turn": np.array(self.turn)}
        return {f"map.{name}": array for name, array in kept.items()}

    @classmethod
    def restored(cls, snapshot: dict[str, np.ndarray]) -> "LandmarkMap":
        """The map whose `snapshot` is among these arrays."""
        modes = snapshot["map.modes"]
        result = cls(modes.shape[2], modes.dtype.name)
        result._make_room(len(modes))
        for name in FIELDS:
            getattr(result, name)[: len(modes)] = snapshot[f"map.{name}"]
        for name in TRANSFORMATIONS:
            setattr(result, name, snapshot[f"map.{name}"].copy())
        result.now, result.turn = int(snapshot["map.now"]), int(snapshot["map.turn"])
        result.count = len(modes)
        result._rows.note(result.ids[: result.count], np.arange(result.count))
        return result

    def _make_room(self, wanted: int) -> None:
        room = len(self.ids)
        if wanted <= room:
            return
        extra = max(wanted, 2 * room) - room
        for name in FIELDS:
            array = getattr(self, name)
            setattr(self, name, np.concatenate([array, np.zeros((extra, *array.shape[1:]), array.dtype)]))


MEMORY = 0.9
"""Of what modes explain, from one epoch to the next: landmarks that were observed lately will be again."""


class _Newcomers(NamedTuple):
    """New landmarks with their errors.

    Ids (q,), points (q, 3), by_pose (q, 3, c) about the point before the update, roots (q, 3, 3).
    """

    ids: Int[np.ndarray, " q"]
    points: Float[np.ndarray, "q 3"]
    by_pose: Float[np.ndarray, "q 3 c"]
    roots: Float[np.ndarray, "q 3 3"]


class HeldMap:
    """Landmarks, the modes that they share, and the move of their frame."""

    def __init__(self, landmarks: LandmarkMap, options: LandmarkOptions) -> None:
        self.landmarks, self._options = landmarks, options
        self.move = np.zeros(GAUGE_DIM)
        self._explained = np.zeros(landmarks.rank)
        self._columns: dict[str, np.ndarray] = {}

    @classmethod
    def empty(cls, options: LandmarkOptions) -> "HeldMap":
        """A map without a landmark."""
        return cls(LandmarkMap(options.modes, options.precision), options)

    @classmethod
    def of(cls, belief: LandmarkBelief, options: LandmarkOptions) -> "HeldMap":
        """The map of a belief."""
        result = cls(LandmarkMap(belief.modes.shape[2], options.precision), options)
        result.landmarks.append(
            belief.ids.astype(np.int64), belief.points, belief.modes, belief.roots, CONFIRMED
        )
        result.move = belief.move.copy()
        return result

    @property
    def ids(self) -> Int[np.ndarray, " k"]:
        """Ids of the landmarks, in the map's order."""
        return self.landmarks.ids[: len(self.landmarks)].copy()

    def has_move(self, factor: Float[np.ndarray, "N N"], layout: StateLayout) -> bool:
        """Whether a factor holds the errors of the move behind those of state and modes."""
        return len(factor) > layout.error_dim + self.landmarks.rank

    def belief(
        self, layout: StateLayout, mean: Float[np.ndarray, " m"], factor: Float[np.ndarray, "N N"]
    ) -> LandmarkBelief:
        """Belief of state and landmarks, brought up to date in copies."""
        now, rows = LandmarkMap.restored(self.landmarks.snapshot()), np.arange(len(self.landmarks))
        now.refresh(rows)
        modes, roots = now.modes[rows].astype(float), now.roots[rows].astype(float)
        return LandmarkBelief(layout, mean, now.ids[rows], now.points[rows], modes, roots, factor, self.move)

    def follow(self, error: Float[np.ndarray, " w"]) -> None:
        """Apply a correction by a landmark-free sensor to modes and move."""
        rank = self.landmarks.rank
        self.landmarks.advance(np.eye(rank), np.zeros((rank, 0)), error[:rank])
        if len(error) > rank:
            self.move = self.move + error[rank:]

    def observations(
        self, layout: StateLayout, measurement: Measurement, rows: Int[np.ndarray, " m"], scale: float
    ) -> MapObservations:
        """A measurement as one of landmarks in the map.

        Parameters
        ----------
        rows : ndarray of int, shape (m,)
            Of the map, of the measurement's landmarks; -1 where it does not hold one.

        Raises
        ------
        InputError
            For a sensor that cannot see landmarks.
        """
        sensor, held = measurement.model.landmark_sensor, self.landmarks
        if sensor is None:
            raise InputError(
                f"sensor {measurement.model.name!r} names landmarks, but cannot see them; leave out their ids"
            )
        known = rows >= 0
        values, parameters = measurement.values, measurement.parameters
        if np.count_nonzero(known) < len(known):
            rows, values, parameters = rows[known], values[known], parameters[known]
        held.refresh(rows)
        columns = self._columns_of(layout, sensor)
        return MapObservations(layout, sensor, values, parameters, rows, known, held, columns, scale)

    def _columns_of(self, layout: StateLayout, sensor: LandmarkSensor) -> Int[np.ndarray, " q"]:
        """Errors that a sensor observes: those of the pose, then the modes."""
        if sensor.name not in self._columns:
            sensor.build()
            n = layout.error_dim
            modes = np.arange(n, n + self.landmarks.rank)
            self._columns[sensor.name] = np.concatenate([sensor.columns, modes])
        return self._columns[sensor.name]

    def _find_refused(
        self, o: MapObservations, solved: SolvedObservations
    ) -> tuple[Int[np.ndarray, " w"], Bool[np.ndarray, " k"]]:
        """Landmarks refused too often, and which observations are of none that stays."""
        fresh = ~o.known
        if len(solved.used) == len(o.at):
            return NO_IDS, fresh
        wrong = self.landmarks.refuse(np.delete(o.at, solved.used))
        fresh[np.flatnonzero(o.known)[np.isin(o.at, wrong)]] = True
        return wrong, fresh

    def after(
        self,
        observations: MapObservations,
        measurement: Measurement,
        solved: SolvedObservations,
        mean: Float[np.ndarray, " m"],
    ) -> tuple[Float[np.ndarray, "N N"], MapChange]:
        """Factor and change of the map after an update that led to this mean."""
        o, held, correction = observations, self.landmarks, solved.correction
        at, n = solved.rows_of(o.at), o.layout.error_dim
        used, weights = held.ids[at], o.scale * solved.weights
        wrong, fresh = self._find_refused(o, solved)
        reset = o.layout.reset_jacobian(correction.error[:n])
        new = self._newcomers(o, measurement, fresh, mean, reset)
        closing = Closing(
            *(at, solved.whitened, correction, o.columns, reset, new.by_pose, new.roots),
            *(MEMORY * self._explained, held.take_turn()),
        )
        modes, dependence, roots, factor = held.steps.close(held, closing)
        self._explained = modes.explained
        pose, turn = o.sensor.columns, o.layout.slice(ATTITUDE.name)
        held.attitude = reset[turn, pose] @ modes.kept[: len(pose)]
        removed = held.remove(wrong)
        if len(new.ids):
            held.append(new.ids, new.points, dependence, roots)
            removed = np.concatenate([removed, held.remove(held.stalest(self._options.largest_map))])
        if self.has_move(factor, o.layout):
            self.move = self.move + correction.error[n + held.rank :]
        return factor, MapChange(used, weights, new.ids, removed)

    def _newcomers(
        self,
        o: MapObservations,
        measurement: Measurement,
        which: np.ndarray,
        mean: Float[np.ndarray, " m"],
        reset: Float[np.ndarray, "n n"],
    ) -> _Newcomers:
        assert measurement.ids is not None
        rows, pose = np.flatnonzero(which), o.sensor.columns
        if not len(rows):
            return _no_newcomers(len(pose))
        fresh = o.sensor.new_landmarks(mean, measurement.parameters[rows], measurement.values[rows])
        good = fresh.determined & np.isfinite(fresh.points).all(axis=1)
        if np.count_nonzero(good) < len(good):
            fresh, rows = NewLandmarks(*[array[good] for array in fresh]), rows[good]
        by_pose = fresh.jacobian @ reset[pose][:, pose]
        return _Newcomers(measurement.ids[rows], fresh.points, by_pose, np.sqrt(o.scale) * fresh.root)

    def snapshot(self) -> dict[str, np.ndarray]:
        """Its whole state as arrays named ``map.<what>``."""
        own = {"map.move": self.move.copy(), "map.explained": self._explained.copy()}
        return self.landmarks.snapshot() | own

    @classmethod
    def restored(cls, snapshot: dict[str, np.ndarray], options: LandmarkOptions) -> "HeldMap | None":
        """The map whose `snapshot` is among these arrays; None where there is none."""
        if "map.ids" not in snapshot:
            return None
        result = cls(LandmarkMap.restored(snapshot), options)
        result.move, result._explained = snapshot["map.move"].copy(), snapshot["map.explained"].copy()
        return result


@cache
def _no_newcomers(columns: int) -> _Newcomers:
    return _Newcomers(NO_IDS, np.zeros((0, 3)), np.zeros((0, 3, columns)), np.zeros((0, 3, 3)))
