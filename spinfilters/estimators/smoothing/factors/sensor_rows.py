"""Pose-only observations of a timeline, by sensor."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.estimators.timeline import Timeline, by_sensor
from spinfilters.models.measurement import MeasurementModel

STRETCH = 2048
"""Epochs whose rows are in memory together: rows of an epoch take ten times the room of what they add to the linear problem."""


class WeightedRows(NamedTuple):
    """One sensor's measurements about a trajectory, whitened and weighted by a robust loss.

    Attributes
    ----------
    rows: (r, i, c + 1) Jacobian by the model's columns, with the right-hand side as the last column.
    costs: (r,) robust costs.   squares: (r,) squared lengths of the whitened innovations; infinite where the model does not apply.
    counted: (r,) whether they have a weight; rows of others are zero.
    """

    rows: Float[np.ndarray, "r i c1"]
    costs: Float[np.ndarray, " r"]
    squares: Float[np.ndarray, " r"]
    counted: Bool[np.ndarray, " r"]


@dataclass(frozen=True)
class SensorRows:
    """All measurements of one sensor that sees no landmark."""

    model: MeasurementModel
    epoch: Int[np.ndarray, " r"]
    values: Float[np.ndarray, "r v"]
    parameters: Float[np.ndarray, "r p"]
    scale: Float[np.ndarray, " i"] | None = None
    """Of the standard deviations that the model states, by component of the innovation; None for 1."""

    @classmethod
    def joined(cls, parts: Sequence["SensorRows"]) -> "SensorRows":
        """Parts of one sensor, one after the other."""
        columns = ([getattr(part, name) for part in parts] for name in ("epoch", "values", "parameters"))
        return cls(parts[0].model, *map(np.concatenate, columns))

    def part(self, rows: slice, first: int = 0) -> "SensorRows":
        """Some of the measurements, their frames counted from epoch ``first`` on."""
        epoch = self.epoch[rows] - first
        return SensorRows(self.model, epoch, self.values[rows], self.parameters[rows], self.scale)

    def chosen(self, which: Bool[np.ndarray, " r"]) -> "SensorRows":
        """The measurements that are true in ``which``."""
        return replace(
            self, epoch=self.epoch[which], values=self.values[which], parameters=self.parameters[which]
        )

    def counted_among(self, some: "SensorRows", counted: Bool[np.ndarray, " s"]) -> Bool[np.ndarray, " r"]:
        """Which of these measurements count among ``some`` of them."""
        if len(some.epoch) == len(self.epoch):
            return counted
        chosen = {key for key, own in zip(some._keys(), counted, strict=True) if own}
        return np.array([key in chosen for key in self._keys()], dtype=bool)

    def _keys(self) -> list[bytes]:
        """Keys by which measurements differ."""
        return [row.tobytes() for row in np.column_stack([self.epoch, self.values, self.parameters])]

    def within(self, begin: int, end: int) -> "SensorRows":
        """The measurements of the epochs from ``begin`` to before ``end``, counted from ``begin`` on."""
        first, last = np.searchsorted(self.epoch, (begin, end))
        return self.part(slice(int(first), int(last)), begin)


def without_refused(epochs: Timeline, refused: Mapping[MeasurementModel, Bool[np.ndarray, " r"]]) -> Timeline:
    """Epochs without the measurements that are true in ``refused``, by sensor in the order of time."""
    if not any(each.any() for each in refused.values()):
        return epochs
    left, found = dict(refused), []
    for epoch in epochs:
        kept = []
        for m in epoch.measurements:
            if m.model in left:
                own, left[m.model] = np.split(left[m.model], [len(m.values)])
                m = replace(m, values=m.values[~own], parameters=m.parameters[~own])
            kept.append(m)
        found.append(replace(epoch, measurements=tuple(kept)))
    return found


def collect_sensors(epochs: Timeline) -> tuple[SensorRows, ...]:
    """Measurements without ids, by sensor; of a long timeline one stretch after the other."""
    parts: dict[int, list[SensorRows]] = {}
    for begin in range(0, len(epochs), STRETCH):
        for rows in _collected(epochs[begin : begin + STRETCH], begin):
            parts.setdefault(id(rows.model), []).append(rows)
    return tuple(map(SensorRows.joined, parts.values()))


def _collected(epochs: Timeline, begin: int) -> list[SensorRows]:
    """Sensors' measurements of a stretch whose first epoch has the number ``begin``."""
    return [
        SensorRows(m.model, found.epoch + begin, m.values, m.parameters)
        for found in by_sensor(epochs)
        if (m := found.measurement).ids is None and len(m.values)
    ]
