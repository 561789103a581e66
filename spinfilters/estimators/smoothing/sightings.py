"""Sightings of landmarks over many frames as one flat list, landmark after landmark, and their linearisation.

The rows of all sightings are evaluated side by side from the expression of their sensor (`LandmarkSensor.sighting_rows`).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.errors import InputError
from spinfilters.estimators.smoothing.robust_kernels import RobustKernel
from spinfilters.estimators.timeline import Frame, Timeline
from spinfilters.models.landmark_sensor import LandmarkSensor
from spinfilters.state.layout import POSE_BLOCKS

ROWS = 3
"""Components of a sighting's innovation, at most; a sensor with fewer leaves rows of zeros."""
COLUMNS = 10
"""Of a row: six by the pose, three by the landmark, and the innovation."""
SIGHTINGS_NEEDED = 2
"""Of one landmark: a single sighting by a stereo pair says where the landmark is and nothing else."""

NOTHING_TWICE = "no landmark of the map is seen twice in these frames; check the landmark ids"


@dataclass(frozen=True)
class SensorGroup:
    """Sightings by one sensor: which of the flat list, what was measured, and its parameters without the point."""

    model: LandmarkSensor
    rows: Int[np.ndarray, " g"]
    values: Float[np.ndarray, "g v"]
    parameters: Float[np.ndarray, "g p"]


@dataclass(frozen=True)
class Sightings:
    """N sightings, sorted by landmark, then by frame.

    Attributes
    ----------
    frame, landmark: (N,) number of the frame and of the landmark.
    place: (N,) where a sighting stands among all of its frame.   counts: (k,) how many sightings each frame has.
    landmarks: how many landmarks there are.
    """

    frame: Int[np.ndarray, " N"]
    landmark: Int[np.ndarray, " N"]
    place: Int[np.ndarray, " N"]
    counts: Int[np.ndarray, " k"]
    landmarks: int
    groups: tuple[SensorGroup, ...]
    scale: float = 1.0
    """Of the standard deviations that the models state."""

    def __len__(self) -> int:
        return len(self.frame)

    @cached_property
    def start(self) -> Int[np.ndarray, " l"]:
        """Where each landmark's sightings begin, and the end of the last."""
        count = np.bincount(self.landmark, minlength=self.landmarks)
        return np.concatenate([[0], np.cumsum(count)])

    def by_frame(self, chosen: Bool[np.ndarray, " N"]) -> tuple[Bool[np.ndarray, " _"], ...]:
        """A choice as one array per frame, over all sightings of the frame."""
        flags = np.zeros(int(self.counts.sum()), dtype=bool)
        ends = np.cumsum(self.counts)
        flags[(ends - self.counts)[self.frame[chosen]] + self.place[chosen]] = True
        return tuple(np.split(flags, ends[:-1]))


@dataclass(frozen=True)
class LinearSightings:
    """Whitened about a trial.

    Attributes
    ----------
    rows: (N, 3, 10), see `COLUMNS`.
    square: (N,) squared length of the innovation, infinite where the sensor's model does not apply.
    """

    rows: Float[np.ndarray, "N 3 10"]
    square: Float[np.ndarray, " N"]

    @property
    def innovation(self) -> Float[np.ndarray, "N 3"]:
        """Whitened."""
        return self.rows[:, :, -1]

    @property
    def size(self) -> Float[np.ndarray, " N"]:
        """Length of the innovation in standard deviations."""
        return np.sqrt(self.square)

    def cost(self, kernel: RobustKernel, used: Bool[np.ndarray, " N"]) -> float:
        """Of those that are used."""
        return float(kernel.cost(self.square)[used].sum())


@dataclass(frozen=True)
class _Seen:
    """Sightings as they lie in the frames."""

    frame: Int[np.ndarray, " s"]
    place: Int[np.ndarray, " s"]
    ids: Int[np.ndarray, " s"]
    counts: Int[np.ndarray, " k"]
    groups: tuple[SensorGroup, ...]


def collect_sightings(frames: Timeline, ids: Int[np.ndarray, " L"], needed: int) -> Sightings:
    """Sightings of the landmarks of these ids (ascending) that occur at least ``needed`` times.

    Raises
    ------
    InputError: when a sensor of landmarks sees more than the pose.
    """
    seen = _seen(frames)
    row = np.clip(np.searchsorted(ids, seen.ids), 0, max(len(ids) - 1, 0))
    known = ids[row] == seen.ids if len(ids) else np.zeros(len(row), dtype=bool)
    landmark = np.where(known, row, -1)
    count = np.bincount(landmark[known], minlength=len(ids))
    keep = known.copy()
    keep[known] = count[landmark[known]] >= needed
    kept = np.flatnonzero(keep)
    order = kept[np.lexsort((seen.frame[kept], landmark[kept]))]
    groups = tuple(_chosen(group, order, len(keep)) for group in seen.groups)
    return Sightings(
        seen.frame[order],
        landmark[order],
        seen.place[order],
        seen.counts,
        len(ids),
        tuple(group for group in groups if len(group.rows)),
    )


def seen_ids(frames: Timeline) -> Int[np.ndarray, " s"]:
    """Ids of all sightings of some frames, one after the other."""
    found = [m.ids for frame in frames for m in frame.measurements if m.ids is not None]
    return np.concatenate([np.zeros(0, dtype=int), *found])


def _chosen(group: SensorGroup, order: Int[np.ndarray, " N"], count: int) -> SensorGroup:
    """A group's part of a choice, in the order of the choice."""
    inside = np.full(count, -1)
    inside[group.rows] = np.arange(len(group.rows))
    taken = inside[order]
    rows = np.flatnonzero(taken >= 0)
    return replace(
        group, rows=rows, values=group.values[taken[rows]], parameters=group.parameters[taken[rows]]
    )


def _seen(frames: Timeline) -> _Seen:
    frame: list[np.ndarray] = [np.zeros(0, dtype=int)]
    place, ids = [np.zeros(0, dtype=int)], [np.zeros(0, dtype=int)]
    counts = np.zeros(len(frames), dtype=int)
    parts: dict[int, tuple[LandmarkSensor, list[np.ndarray], list[np.ndarray], list[np.ndarray]]] = {}
    done = 0
    for k, here in enumerate(frames):
        for model, values, parameters, of in _landmark_measurements(here):
            count = len(of)
            frame.append(np.full(count, k))
            place.append(counts[k] + np.arange(count))
            ids.append(of)
            counts[k] += count
            group = parts.setdefault(id(model), (model, [], [], []))
            group[1].append(np.arange(done, done + count))
            group[2].append(values)
            group[3].append(parameters[:, 3:])
            done += count
    groups = tuple(SensorGroup(model, *map(np.concatenate, lists)) for model, *lists in parts.values())
    return _Seen(np.concatenate(frame), np.concatenate(place), np.concatenate(ids), counts, groups)


def _landmark_measurements(frame: Frame) -> list[tuple[LandmarkSensor, np.ndarray, np.ndarray, np.ndarray]]:
    found = []
    for m in frame.measurements:
        if m.ids is None:
            continue
        if not isinstance(m.model, LandmarkSensor) or m.model.needs != POSE_BLOCKS or m.model.dim > ROWS:
            raise InputError(
                f"sensor {m.model.name} sees {m.model.needs}; a smoother takes a LandmarkSensor of (t, a) with at most "
                f"{ROWS} components"
            )
        found.append((m.model, m.values, m.parameters, m.ids))
    return found


def linearise_sightings(
    sightings: Sightings, trajectory: Float[np.ndarray, "k m"], points: Float[np.ndarray, "L 3"]
) -> LinearSightings:
    """All sightings about a trajectory and points (m, frame g)."""
    whole = len(sightings.groups) == 1 and sightings.groups[0].model.dim == ROWS
    rows = np.empty((0, ROWS, COLUMNS)) if whole else np.zeros((len(sightings), ROWS, COLUMNS))
    square = np.full(len(sightings), np.inf)
    for group in sightings.groups:
        every = slice(None) if whole else group.rows
        frame, landmark = sightings.frame[every], sightings.landmark[every]
        made, positive, length, _ = group.model.sighting_rows(
            trajectory, points, group.parameters, group.values, rows=(frame, landmark, None, None)
        )
        made = made.reshape(len(made), group.model.dim, COLUMNS)
        if whole:
            rows = made
        else:
            rows[every, : group.model.dim] = made
        good = (positive[:, 0] > 0) & np.isfinite(length[:, 0])
        square[every] = np.where(good, length[:, 0], np.inf)
    if sightings.scale != 1.0:
        rows, square = rows / sightings.scale, square / sightings.scale**2
    return LinearSightings(rows, square)
