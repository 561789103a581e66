"""Landmarks of a filter: positions, dependence on the shared modes, own covariances.

Modes change in every epoch. Landmarks that are not observed are not touched: for each of the latest `SLOTS` epochs it is kept how
the modes of then follow from those of now,

    m_then = transform m_now + shift + f,   cov f = spread,

and a landmark is brought up to date when it is observed next, or when its turn comes: every epoch takes a share of the map in turn,
so that hardly any falls behind by as many epochs as there are slots, and no epoch costs more than another.
"""

from itertools import repeat

import numpy as np
from jaxtyping import Float, Int

from spinfilters.estimators.landmarks.compiled_steps import steps_of
from spinfilters.estimators.landmarks.numpy_steps import next_epoch
from spinfilters.estimators.landmarks.steps import SLOTS, LandmarkArrays

CONFIRMED = 2
"""Observations that agree, from which on a landmark is believed more than an observation that does not."""
WRONG_IN_A_ROW = 3
"""Observations in a row outside the gate after which the landmark, not the observations, is taken to be wrong."""
FIELDS = ("ids", "points", "modes", "roots", "epoch", "hits", "wrong", "last")


class LandmarkMap(LandmarkArrays):
    """Landmarks in rows, the first ``count`` of arrays that grow in steps."""

    def __init__(self, rank: int, precision: str = "float64") -> None:
        super().__init__(rank, precision, steps_of(rank, precision))
        self._rows: dict[int, int] = {}

    def __len__(self) -> int:
        return self.count

    def locate(self, ids: Int[np.ndarray, " q"]) -> Int[np.ndarray, " q"]:
        """Row of every id, -1 where the map does not hold it."""
        return np.fromiter(map(self._rows.get, ids.tolist(), repeat(-1)), np.int64, len(ids))

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
        modes: by those of the present epoch.   confirmed: observations that agree about each of them.
        """
        begin, end = self.count, self.count + len(ids)
        self._make_room(end)
        values = (ids, points, modes, roots, self.now, confirmed, 0, self.now)
        for name, value in zip(FIELDS, values, strict=True):
            getattr(self, name)[begin:end] = value
        self._rows.update(zip(ids.tolist(), range(begin, end), strict=True))
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
        holes = np.flatnonzero(~stay[:count])
        movers = count + np.flatnonzero(stay[count:])
        self.refresh(movers)
        for name in FIELDS:
            array = getattr(self, name)
            array[holes] = array[movers]
        self.count = count
        for key in removed.tolist():
            del self._rows[key]
        self._rows.update(zip(self.ids[holes].tolist(), holes.tolist(), strict=True))
        return removed

    def stalest(self, largest: int) -> Int[np.ndarray, " q"]:
        """Rows observed longest ago, beyond the ``largest`` number of landmarks.

        So many that a sixteenth is free again.
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
        kept |= {name: getattr(self, name).copy() for name in ("transform", "spread", "shift")}
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
        for name in ("transform", "spread", "shift"):
            setattr(result, name, snapshot[f"map.{name}"].copy())
        result.now, result.turn = int(snapshot["map.now"]), int(snapshot["map.turn"])
        result.count = len(modes)
        result._rows = {key: row for row, key in enumerate(result.ids[: result.count].tolist())}
        return result

    def _make_room(self, wanted: int) -> None:
        room = len(self.ids)
        if wanted <= room:
            return
        extra = max(wanted, 2 * room) - room
        for name in FIELDS:
            array = getattr(self, name)
            setattr(self, name, np.concatenate([array, np.zeros((extra, *array.shape[1:]), array.dtype)]))
