"""Which landmarks a filter holds, how often each was of use, and which has to go when there is no more room."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.errors import InputError
from spinfilters.estimators.landmarks.gauge_rules import gauge_rule
from spinfilters.models.anchored_point import ANCHOR_DIM, anchored_points

LARGEST_WAITING_LIST = 4096
"""Landmarks outside the map whose sightings are counted; the ones seen longest ago are forgotten."""
MEMORY = 20.0
"""Frames after which a landmark's own record counts as much as what is usual in the map."""
USUAL_RATE = 0.3
"""Sightings per frame expected of a landmark of which nothing is known."""
WORTH_REPLACING = 0.5
"""A landmark gives way to a newcomer when it is expected to be seen less than this share as often."""
CONFIRMED = 2
"""Sightings that agree, from which on a landmark is believed more than a sighting that does not."""
WRONG_IN_A_ROW = 3
"""Sightings in a row outside the gate after which the landmark, not the sightings, is taken to be wrong."""
PRECISIONS = ("float64", "float32")


@dataclass(frozen=True)
class LandmarkOptions:
    """How a filter holds landmarks.

    Attributes
    ----------
    capacity: landmarks at most.   replaced_per_frame: at most, which bounds the time of a frame.
    gauge: how errors are carried over an update, see `spinfilters.estimators.landmarks.gauge_rules`.
    precision: of the joint factor, "float64" or "float32".
    """

    capacity: int = 150
    replaced_per_frame: int = 10
    gauge: str = "invariant"
    precision: str = "float64"

    def __post_init__(self) -> None:
        if self.capacity < 4 or self.replaced_per_frame < 1:
            raise InputError(
                f"landmarks.capacity is {self.capacity}, landmarks.replaced_per_frame is {self.replaced_per_frame}; "
                "give at least 4 and 1"
            )
        gauge_rule(self.gauge)
        if self.precision not in PRECISIONS:
            raise InputError(f"precision {self.precision!r} is unknown; use one of {', '.join(PRECISIONS)}")


@dataclass
class LandmarkMap:
    """The landmarks of a filter, one row each, in the order of the joint state; and the waiting list.

    Attributes
    ----------
    ids: (k,).   anchors: (k, 7), coordinates: (k, 3), see `spinfilters.models.anchored_point`.   first: (k, 3) as first estimated.
    hits: (k,) sightings that agree.   since: (k,) frame of the first sighting.   wrong: (k,) rejected sightings in a row.
    frame: frames so far.
    waiting: rows (id, sightings, frame of the first, frame of the last) of landmarks outside.
    """

    ids: Int[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    anchors: Float[np.ndarray, "k 7"] = field(default_factory=lambda: np.zeros((0, ANCHOR_DIM)))
    coordinates: Float[np.ndarray, "k 3"] = field(default_factory=lambda: np.zeros((0, 3)))
    first: Float[np.ndarray, "k 3"] = field(default_factory=lambda: np.zeros((0, 3)))
    hits: Int[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    since: Int[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    wrong: Int[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    frame: int = 0
    waiting: Int[np.ndarray, "w 4"] = field(default_factory=lambda: np.zeros((0, 4), dtype=np.int64))

    def __len__(self) -> int:
        return len(self.ids)

    def locate(self, ids: Int[np.ndarray, " q"]) -> Int[np.ndarray, " q"]:
        """Row of every id, -1 where the map does not hold it."""
        if not len(self.ids):
            return np.full(len(ids), -1)
        order = np.argsort(self.ids, kind="stable")
        at = np.clip(np.searchsorted(self.ids, ids, sorter=order), 0, len(order) - 1)
        rows = order[at]
        return np.where(self.ids[rows] == ids, rows, -1)

    def record(self, rows: Int[np.ndarray, " q"], accepted: Bool[np.ndarray, " q"]) -> None:
        """Count sightings of landmarks of the map."""
        self.hits[rows[accepted]] += 1
        self.wrong[rows[accepted]] = 0
        self.wrong[rows[~accepted]] += 1

    @property
    def mistaken(self) -> Bool[np.ndarray, " k"]:
        """Landmarks that disagree with everything lately seen of them, or with the second sighting there ever was: made anew."""
        return (self.wrong >= WRONG_IN_A_ROW) | ((self.wrong > 0) & (self.hits < CONFIRMED))

    def keep(self, which: Bool[np.ndarray, " k"]) -> None:
        """Drop the others."""
        for name in ("ids", "anchors", "coordinates", "first", "hits", "since", "wrong"):
            setattr(self, name, getattr(self, name)[which])

    def append(
        self,
        ids: Int[np.ndarray, " q"],
        anchors: Float[np.ndarray, "q 7"],
        coordinates: Float[np.ndarray, "q 3"],
        confirmed: int = 1,
    ) -> None:
        """New landmarks; what the waiting list knew of them goes with them.

        Parameters
        ----------
        confirmed: sightings that agree about each of them.
        """
        since = self._record_of(ids)[1]
        hits = np.full(len(ids), confirmed)
        self.waiting = self.waiting[~np.isin(self.waiting[:, 0], ids)]
        added = {"ids": ids, "anchors": anchors, "coordinates": coordinates, "first": coordinates}
        for name, rows in (added | {"hits": hits, "since": since, "wrong": 0 * hits}).items():
            setattr(self, name, np.concatenate([getattr(self, name), rows]))

    @property
    def points(self) -> Float[np.ndarray, "k 3"]:
        """The landmarks in frame g, m."""
        return anchored_points(self.anchors, self.coordinates)[0]

    def note(self, ids: Int[np.ndarray, " q"]) -> None:
        """Count sightings of landmarks outside the map."""
        known = np.isin(ids, self.waiting[:, 0])
        again = np.isin(self.waiting[:, 0], ids)
        self.waiting[again, 1] += 1
        self.waiting[again, 3] = self.frame
        fresh = ids[~known]
        rows = np.stack(
            [fresh, *(np.full(len(fresh), value) for value in (1, self.frame, self.frame))], axis=1
        )
        self.waiting = np.concatenate([self.waiting, rows])
        if len(self.waiting) > LARGEST_WAITING_LIST:
            latest = np.argsort(self.waiting[:, 3], kind="stable")[-LARGEST_WAITING_LIST:]
            self.waiting = self.waiting[np.sort(latest)]

    def expected_rate(self, hits: np.ndarray, since: np.ndarray) -> Float[np.ndarray, " q"]:
        """Sightings per frame expected of landmarks with such records; for few frames, what is usual."""
        return (hits + USUAL_RATE * MEMORY) / (self.frame - since + 1 + MEMORY)

    def admission(
        self, ids: Int[np.ndarray, " q"], options: LandmarkOptions
    ) -> tuple[np.ndarray, np.ndarray]:
        """Which of the newcomers come in (rows of ``ids``, best first), and which landmarks stay (mask)."""
        rates = self.expected_rate(*self._record_of(ids))
        order = np.argsort(-rates, kind="stable")
        stay = np.ones(len(self), dtype=bool)
        free = max(options.capacity - len(self), 0)
        if len(ids) <= free:
            return order, stay
        own = self.expected_rate(self.hits, self.since)
        worst = np.argsort(own, kind="stable")[: options.replaced_per_frame]
        rivals = rates[order[free : free + len(worst)]]
        pairs = min(len(rivals), len(worst))
        replaced = worst[:pairs][own[worst[:pairs]] < WORTH_REPLACING * rivals[:pairs]]
        stay[replaced] = False
        return order[: free + len(replaced)], stay

    def _record_of(self, ids: Int[np.ndarray, " q"]) -> tuple[np.ndarray, np.ndarray]:
        """Sightings and frame of the first, from the waiting list; one now for those that are not on it."""
        hits, since = np.ones(len(ids), dtype=np.int64), np.full(len(ids), self.frame)
        order = np.argsort(self.waiting[:, 0], kind="stable")
        listed = self.waiting[order]
        if len(listed):
            at = np.clip(np.searchsorted(listed[:, 0], ids), 0, len(listed) - 1)
            found = listed[at, 0] == ids
            hits[found], since[found] = listed[at[found], 1], listed[at[found], 2]
        return hits, since
