"""Sightings of landmarks over the first frames as one flat list, and which of them to believe.

A sighting counts with the square of its whitened residual up to a gate, and as a constant beyond (truncated least squares): a wrong
association pulls at nothing. While the trial is still far off the gate is wider, with a straight line between (Huber), so that the
fit is drawn in from afar and only then made strict.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Measurement
from spinfilters.estimators.timeline import Frame, Timeline
from spinfilters.models.landmark_sensor import LandmarkSensor

SIGHTINGS_NEEDED = 2
"""Of one landmark: a single sighting by a stereo pair says where the landmark is and nothing else."""

NOTHING_TWICE = "no landmark of the map is seen twice in the first frames; check the landmark ids"


@dataclass(frozen=True)
class _Group:
    """Sightings of one sensor in one frame: rows of the flat list, and which of the measurement's values they are."""

    frame: int
    model: LandmarkSensor
    values: Float[np.ndarray, "k v"]
    parameters: Float[np.ndarray, "k p"]
    rows: slice


@dataclass(frozen=True)
class Sightings:
    """N sightings of landmarks that occur at least twice.

    Attributes
    ----------
    frame, landmark: (N,) number of the frame and of the landmark.
    place: (N,) where a sighting stands among all of its frame.   counts: (k,) how many sightings each frame has.
    """

    frame: Int[np.ndarray, " N"]
    landmark: Int[np.ndarray, " N"]
    place: Int[np.ndarray, " N"]
    counts: Int[np.ndarray, " k"]
    groups: tuple[_Group, ...]

    def by_frame(self, chosen: Bool[np.ndarray, " N"]) -> tuple[Bool[np.ndarray, " _"], ...]:
        """A choice as one array per frame, over all sightings of the frame."""
        flags = [np.zeros(count, dtype=bool) for count in self.counts]
        for frame, place in zip(self.frame[chosen], self.place[chosen], strict=True):
            flags[frame][place] = True
        return tuple(flags)


@dataclass(frozen=True)
class Gate:
    """Which sightings count: squares up to ``inner`` standard deviations, linearly up to ``outer``, of those ``among`` (N,)."""

    inner: float
    outer: float
    among: Bool[np.ndarray, " N"]


@dataclass(frozen=True)
class LinearSightings:
    """Whitened about a trial.

    Attributes
    ----------
    innovation: (N, r).   by_pose: (N, r, 6) by t and a.   by_landmark: (N, r, 3).
    size: (N,) length of the innovation in standard deviations, infinite where the sensor's model does not apply.
    """

    innovation: Float[np.ndarray, "N r"]
    by_pose: Float[np.ndarray, "N r 6"]
    by_landmark: Float[np.ndarray, "N r 3"]
    size: Float[np.ndarray, " N"]

    def robust_costs(self, gate: Gate) -> Float[np.ndarray, " N"]:
        """Squares up to the gate's inner size, a straight line up to its outer one, constant beyond."""
        size = np.minimum(self.size, gate.outer)
        return np.where(size <= gate.inner, size**2, gate.inner * (2 * size - gate.inner))

    def weights(self, gate: Gate) -> Float[np.ndarray, " N"]:
        """Of the squares of a least-squares problem with the same slope as `robust_costs`."""
        slope = gate.inner / np.maximum(self.size, gate.inner)
        return np.where(gate.among & (self.size < gate.outer), slope, 0.0)


def collect_sightings(frames: Timeline, ids: Int[np.ndarray, " L"]) -> Sightings:
    """Sightings of the landmarks of these ids that occur at least twice.

    Raises
    ------
    InputError: when there are none, or a sensor of landmarks sees more than the pose.
    """
    found = [seen for k, frame in enumerate(frames) for seen in _seen_in(k, frame)]
    if not found or not len(ids):
        raise InputError(NOTHING_TWICE)
    order = np.argsort(ids)
    every = np.concatenate([seen.ids for seen in found])
    row = order[np.clip(np.searchsorted(ids, every, sorter=order), 0, len(ids) - 1)]
    landmark = np.where(ids[row] == every, row, -1)
    count = np.bincount(landmark[landmark >= 0], minlength=len(ids))
    keep = (landmark >= 0) & (count[landmark] >= SIGHTINGS_NEEDED)
    if not keep.any():
        raise InputError(NOTHING_TWICE)
    return _flat(found, landmark, keep, len(frames))


@dataclass(frozen=True)
class _Seen:
    """A measurement of landmarks in one frame, with the number of sightings of the frame before it."""

    frame: int
    before: int
    ids: Int[np.ndarray, " s"]
    model: LandmarkSensor
    measurement: Measurement


def _seen_in(number: int, frame: Frame) -> list[_Seen]:
    result: list[_Seen] = []
    before = 0
    for measurement in frame.measurements:
        if measurement.ids is not None:
            model = measurement.model
            if not isinstance(model, LandmarkSensor) or model.needs != ("t", "a"):
                raise InputError(
                    f"sensor {model.name} sees {model.needs}, a start with landmarks needs a LandmarkSensor of (t, a)"
                )
            result.append(_Seen(number, before, measurement.ids, model, measurement))
            before += len(measurement.ids)
    return result


def _flat(
    found: list[_Seen], landmark: Int[np.ndarray, " s"], keep: Bool[np.ndarray, " s"], count: int
) -> Sightings:
    groups, frame, place, counts = [], [], [], np.zeros(count, dtype=int)
    first, done = 0, 0
    for seen in found:
        chosen = np.flatnonzero(keep[first : first + len(seen.ids)])
        rows = slice(done, done + len(chosen))
        values, parameters = seen.measurement.values[chosen], seen.measurement.parameters[chosen]
        groups.append(_Group(seen.frame, seen.model, values, parameters, rows))
        frame.append(np.full(len(chosen), seen.frame))
        place.append(seen.before + chosen)
        counts[seen.frame] += len(seen.ids)
        first, done = first + len(seen.ids), rows.stop
    groups = tuple(group for group in groups if len(group.values))
    return Sightings(np.concatenate(frame), landmark[keep], np.concatenate(place), counts, groups)


def linearise_sightings(
    sightings: Sightings, trajectory: Float[np.ndarray, "k m"], points: Float[np.ndarray, "L 3"]
) -> LinearSightings:
    """All sightings about a trajectory and points (m, frame g)."""
    parts = []
    for group in sightings.groups:
        parameters = group.parameters.copy()
        parameters[:, :3] = points[sightings.landmark[group.rows]]
        parts.append(group.model.linearise_landmarks(trajectory[group.frame], parameters, group.values))
    innovation = np.concatenate([part.innovation for part in parts])
    usable = np.concatenate([part.valid for part in parts]) & np.isfinite(innovation).all(axis=1)
    size = np.where(usable, np.linalg.norm(np.where(usable[:, None], innovation, 0.0), axis=1), np.inf)
    by_pose = np.concatenate([part.jacobian for part in parts])
    return LinearSightings(innovation, by_pose, np.concatenate([part.by_landmark for part in parts]), size)
