"""Further sensors beside a stated set: which directions each determines more, and how far the bounds fall with it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from textwrap import wrap
from typing import Any, Final

import numpy as np

from observability.cases import Case
from observability.cramer_rao import BLOCK_NAMES, Quantity
from observability.prior_dependence import QuantityBound, quantity_bounds
from observability.system import analysed_sensors
from spinfilters.core.errors import SpinfiltersError
from spinfilters.core.working_time import building
from spinfilters.io.sensor_format import kind_called

IN_G: Final = (BLOCK_NAMES["a"], BLOCK_NAMES["c"])
"""Quantities that depend on what fixes frame g: the first epoch by definition, or a sensor with its own axes."""
ATTITUDE: Final = BLOCK_NAMES["a"]
CELL: Final = 12
"""Letters of a line in a column's heading."""

PARTIAL: Final = (
    "(2 of 3): directions determined, along which the bound holds; only the prior tells the others."
)
OTHER_AXES: Final = "*: in other axes than without the sensor, which fixes frame g by its own; not compared."


@dataclass(frozen=True)
class SensorSet:
    """A set of sensors, with what they determine of the motion.

    Attributes
    ----------
    case : Case
        The question.
    rank, dimension : int
        Unknowns that are determined, exactly, and unknowns in all.
    bounds : dict[Quantity, QuantityBound]
        Of every quantity that is asked for, after the last epoch.
    """

    case: Case
    rank: int
    dimension: int
    bounds: dict[Quantity, QuantityBound]

    def determined(self, quantity: Quantity) -> int:
        """Directions of a quantity of which the measurements tell, not the prior alone; 0 where it is not asked for."""
        each = self.bounds.get(quantity)
        return 0 if each is None else each.dimension - len(each.prior_directions)

    def std(self, quantity: Quantity) -> float | None:
        """Bound along these directions; None where there is none."""
        return self.bounds[quantity].std_across if self.determined(quantity) else None


@dataclass(frozen=True)
class FurtherSensor:
    """One more sensor in a set.

    Attributes
    ----------
    name : str
        Of the sensor.
    before, after : SensorSet
        Without and with it.
    """

    name: str
    before: SensorSet
    after: SensorSet

    @property
    def kind(self) -> str:
        """Of its data sets, the name that commands take."""
        return kind_called(self.name)

    @cached_property
    def becomes_determined(self) -> dict[Quantity, int]:
        """Directions of each quantity that are determined with the sensor only."""
        more = {
            name: self.after.determined(name) - self.before.determined(name) for name in self.after.bounds
        }
        return {name: count for name, count in more.items() if count > 0}

    def is_comparable(self, quantity: Quantity) -> bool:
        """Whether the quantity is the same without and with the sensor: as many directions, and an equal definition of g."""
        count, (first, then) = self.after.determined(quantity), (self.before.case, self.after.case)
        if quantity in IN_G and (first.free_rotations, first.place_is_defined) != (
            then.free_rotations,
            then.place_is_defined,
        ):
            return False
        return count > 0 and count == self.before.determined(quantity)

    @cached_property
    def gains(self) -> dict[Quantity, float]:
        """Bound without over bound with the sensor, of every quantity that is comparable."""
        pairs = {name: (self.before.std(name), self.after.std(name)) for name in self.after.bounds}
        return {
            name: without / with_it
            for name, (without, with_it) in pairs.items()
            if without and with_it and self.is_comparable(name)
        }

    @property
    def mean_gain(self) -> float:
        """Geometric mean of the gains; 1 where no quantity is comparable."""
        return float(np.exp(np.mean(np.log(list(self.gains.values()))))) if self.gains else 1.0

    @property
    def use(self) -> tuple[int, float]:
        """How much it helps: directions that become determined, then the mean gain."""
        return sum(self.becomes_determined.values()), self.mean_gain

    def document(self) -> dict[str, Any]:
        """For JSON."""
        names = dict.fromkeys((*self.before.bounds, *self.after.bounds))
        return {
            "sensor": self.name,
            "rank": [self.before.rank, self.after.rank],
            "dimension": [self.before.dimension, self.after.dimension],
            "becomes_determined": {_key(name): count for name, count in self.becomes_determined.items()},
            "mean_gain": self.mean_gain,
            "bounds": {
                _key(name): {
                    "before": self.before.std(name),
                    "after": self.after.std(name),
                    "gain": self.gains.get(name),
                    "directions_determined": [self.before.determined(name), self.after.determined(name)],
                    "comparable": self.is_comparable(name),
                }
                for name in names
            },
        }


def is_partial(sensors: SensorSet, quantity: Quantity) -> bool:
    """Whether the set determines some directions of a quantity and leaves others to the prior."""
    each = sensors.bounds.get(quantity)
    return (
        each is not None
        and sensors.std(quantity) is not None
        and sensors.determined(quantity) < each.dimension
    )


def is_in_other_axes(sensors: SensorSet, added: FurtherSensor | None, quantity: Quantity) -> bool:
    """Whether a quantity is determined without and with an added sensor, but in axes of g that differ."""
    if added is None or sensors.bounds.get(quantity) is None or sensors.std(quantity) is None:
        return False
    alike = added.before.determined(quantity) == sensors.determined(quantity)
    return alike and not added.is_comparable(quantity)


@dataclass(frozen=True, repr=False)
class FurtherSensors:
    """Every further sensor that the analyser knows, beside a stated set; printed, it is a table.

    Attributes
    ----------
    stated : SensorSet
        The set.
    sensors : tuple[FurtherSensor, ...]
        The most useful one first.
    refused : dict[str, str]
        Sensors that cannot be analysed in this set, with the reason.
    """

    stated: SensorSet
    sensors: tuple[FurtherSensor, ...]
    refused: dict[str, str]

    @cached_property
    def quantities(self) -> tuple[Quantity, ...]:
        """All quantities of the set and of those with a further sensor."""
        sets = (self.stated, *(each.after for each in self.sensors))
        return tuple(dict.fromkeys(name for each in sets for name in each.bounds))

    @cached_property
    def sentences(self) -> list[str]:
        """The table, line by line, with its explanation."""
        names = ", ".join(map(kind_called, self.stated.case.sensors))
        if not self.sensors:
            lines = [f"Further sensors: none can be added to {names}."]
            return [*lines, *self._refusals]
        lines = [
            f"Further sensors beside {names}, the most useful first: by directions that become determined, then by mean gain.",
            "The gain is the bound without over the bound with the sensor; the mean is geometric.",
            *self._table(),
        ]
        sets = (self.stated, *(each.after for each in self.sensors))
        if any(is_partial(each, name) for each in sets for name in self.quantities):
            lines.append(PARTIAL)
        if self.in_other_axes:
            lines.append(OTHER_AXES)
        return [*lines, *self._refusals]

    @property
    def in_other_axes(self) -> bool:
        """Whether a sensor changes the axes of g in which a quantity is determined."""
        return any(
            is_in_other_axes(each.after, each, name) for each in self.sensors for name in self.quantities
        )

    @property
    def _refusals(self) -> list[str]:
        return [f"{kind_called(name)} cannot be added: {reason}." for name, reason in self.refused.items()]

    def _table(self) -> list[str]:
        """Rows of equal width: the set, then each further sensor."""
        names = [
            "mean gain",
            "unknowns",
            *(name if unit == "1" else f"{name} [{unit}]" for name, unit in self.quantities),
        ]
        rows = [["none", "", _unknowns(self.stated), *self._cells(self.stated, None), ""]]
        for each in self.sensors:
            gain = f"{each.mean_gain:.3g}" if each.gains else "-"
            new = ", ".join(f"{name} {count}" for (name, _), count in each.becomes_determined.items())
            rows.append(
                [each.kind, gain, _unknowns(each.after), *self._cells(each.after, each), new or "nothing"]
            )
        headings = [wrap(text, CELL) for text in ("sensor", *names, "becomes determined (directions)")]
        headings[-1] = ["becomes determined (directions)"]
        height = max(map(len, headings))
        lines = [[column[k] if k < len(column) else "" for column in headings] for k in range(height)] + rows
        widths = [max(len(row[column]) for row in lines) for column in range(len(headings))]
        return [
            "  " + "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
            for row in lines
        ]

    def _cells(self, sensors: SensorSet, added: FurtherSensor | None) -> list[str]:
        return [self.cell(sensors, added, name) for name in self.quantities]

    def cell(self, sensors: SensorSet, added: FurtherSensor | None, quantity: Quantity) -> str:
        """A bound as the table shows it.

        Parameters
        ----------
        sensors : SensorSet
            Whose bound it is.
        added : FurtherSensor or None
            By which the set differs from the stated one; None of that one.
        quantity : Quantity
            Name and unit.

        Returns
        -------
        str
            "-" of what is not asked for, "prior" of what nothing measures.
        """
        each = sensors.bounds.get(quantity)
        if each is None:
            return "-"
        std = sensors.std(quantity)
        if std is None:
            return "prior"
        part = (
            f" ({sensors.determined(quantity)} of {each.dimension})" if is_partial(sensors, quantity) else ""
        )
        return f"{std:.3g}{part}{' *' if is_in_other_axes(sensors, added, quantity) else ''}"

    def document(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "beside": list(self.stated.case.sensors),
            "sensors": [each.document() for each in self.sensors],
            "refused": self.refused,
        }

    def __str__(self) -> str:
        return "\n".join(self.sentences)

    __repr__ = __str__


@building()
def further_sensors(
    case: Case, frames: int, interval: float, progress: Callable[[str, int, int], None]
) -> FurtherSensors:
    """Each sensor that the analyser knows, added to the set of a case, one at a time.

    Parameters
    ----------
    case : Case
        With the set, the motion, and the noise, which holds for the further sensors too.
    frames : int
        Epochs, in which every sensor measures.
    interval : float
        Between them, s.
    progress : Callable[[str, int, int], None]
        Called with what is being done, sensors done and sensors in all.

    Returns
    -------
    FurtherSensors
        The most useful one first.
    """
    stated = sensor_set(case, frames, interval)
    names = [name for name in analysed_sensors() if name not in case.sensors]
    found, refused = [], {}
    for done, name in enumerate(names):
        progress("further sensors", done, len(names))
        try:
            after = sensor_set(replace(case, sensors=(*case.sensors, name)), frames, interval)
        except SpinfiltersError as error:
            refused[name] = str(error)
        else:
            found.append(FurtherSensor(name, stated, after))
    progress("further sensors", len(names), len(names))
    return FurtherSensors(stated, tuple(sorted(found, key=lambda each: each.use, reverse=True)), refused)


def sensor_set(case: Case, frames: int, interval: float) -> SensorSet:
    """Rank and bounds of a case after so many epochs at such an interval, s."""
    certificate, reference = case.certificate(), case.reference(frames, interval)
    bounds = quantity_bounds(case, reference, case.bound(reference), longer=False)
    if not case.holds_attitude:  # that of the first epoch is a definition, and no sensor sees it
        del bounds[ATTITUDE]
    return SensorSet(case, certificate.rank, certificate.dimension, bounds)


def _unknowns(sensors: SensorSet) -> str:
    return f"{sensors.rank} of {sensors.dimension}"


def _key(name: Quantity) -> str:
    return f"{name[0]} [{name[1]}]"
