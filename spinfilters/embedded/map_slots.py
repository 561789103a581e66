"""Assignment of a data set's landmarks to slots of an embedded filter's map."""

import numpy as np
from jaxtyping import Int


class MapSlots:
    """Slots of landmarks by id; a full map drops the least recently observed."""

    def __init__(self, capacity: int) -> None:
        self._ids = np.full(capacity, -1, dtype=np.int64)
        self._last = np.full(capacity, -1, dtype=np.int64)
        self._places: dict[int, int] = {}
        self._now = 0

    def places(self, ids: Int[np.ndarray, " k"]) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " f"]]:
        """Slots of distinct ids, and which of them are new."""
        self._now += 1
        found = np.array([self._places.get(key, -1) for key in ids.tolist()], dtype=np.int64)
        self._last[found[found >= 0]] = self._now
        missing = np.flatnonzero(found < 0)
        fresh = np.argsort(self._last, kind="stable")[: len(missing)]
        for index, place in zip(missing.tolist(), fresh.tolist(), strict=True):
            if self._last[place] >= 0:
                del self._places[int(self._ids[place])]
            self._ids[place] = ids[index]
            self._places[int(ids[index])] = place
            self._last[place] = self._now
            found[index] = place
        return found, fresh

    @property
    def ids(self) -> Int[np.ndarray, " c"]:
        """Landmark id of every slot; meaningless in unused ones."""
        return self._ids.copy()

    @property
    def taken(self) -> Int[np.ndarray, " t"]:
        """Slots that hold a landmark."""
        return np.flatnonzero(self._last >= 0)

    def snapshot(self) -> dict[str, np.ndarray]:
        """Its whole state."""
        return {
            "slots.ids": self._ids.copy(),
            "slots.last": self._last.copy(),
            "slots.now": np.array(self._now),
        }

    def restore(self, snapshot: dict[str, np.ndarray]) -> None:
        """Continue from a `snapshot`."""
        self._ids, self._last = snapshot["slots.ids"].copy(), snapshot["slots.last"].copy()
        self._now = int(snapshot["slots.now"])
        self._places = {int(self._ids[place]): place for place in self.taken.tolist()}
