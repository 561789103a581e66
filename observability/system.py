"""System to analyse: a chart, sensors with their usual noise, and known inputs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction
from functools import cached_property
from types import MappingProxyType
from typing import Final

import casadi as ca
import numpy as np

from observability.coordinates import Chart, Values
from observability.exact_numbers import Rationals, rationals
from observability.tape import Tape, tape_of
from spinfilters.core.errors import InputError, ShapeError
from spinfilters.core.working_time import built_property
from spinfilters.io.input_file import nearest_text
from spinfilters.io.sensor_format import kind_called, sensor_called
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.sensor import AnalysedSensor, model_over
from spinfilters.models.sensor_registry import all_sensors
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout

AXES_OF_G: Final[tuple[Rationals, ...]] = tuple(
    tuple(Fraction(int(row == column)) for row in range(3)) for column in range(3)
)
NEEDED = {"a": "q"}
"""Blocks of a filter's state under the names that expressions know them by."""


class Input(StrEnum):
    """Known inputs, each along one axis.

    Torques about axes of the body (`System.torque_axes`), the inspector's accelerations along the axes of frame i, the camera
    at the first frame (x right, y down, z forward).
    """

    TORQUE_X = "torque about x"
    TORQUE_Y = "torque about y"
    TORQUE_Z = "torque about z"
    INSPECTOR_X = "inspector's acceleration along x"
    INSPECTOR_Y = "inspector's acceleration along y"
    INSPECTOR_Z = "inspector's acceleration along z"

    @property
    def is_torque(self) -> bool:
        """Whether it turns the body; if not, it moves the camera."""
        return self.value.startswith("torque")

    @property
    def unit(self) -> str:
        """Its unit."""
        return "N m" if self.is_torque else "m/s^2"

    @property
    def axis(self) -> int:
        """0, 1 or 2."""
        return "xyz".index(self.value[-1])


@dataclass(frozen=True)
class SystemSensor:
    """A sensor of the filters, once per item of its parameters.

    Attributes
    ----------
    model : MeasurementModel
        The sensor, over any layout: only its expressions are used.
    parameters : tuple[Rationals, ...]
        Of every item (landmark, calibration, noise).
    unknown : int
        How many of the leading parameters are unknown constants: 3 for a landmark to be mapped, 0 for a known
        map.
    """

    model: MeasurementModel
    parameters: tuple[Rationals, ...]
    unknown: int = 0

    def __post_init__(self) -> None:
        wrong = [len(item) for item in self.parameters if len(item) != self.model.parameter_dim]
        if wrong:
            raise ShapeError(
                f"a measurement of {self.model.name} has {self.model.parameter_dim} parameters, got {wrong[0]} of them"
            )
        if not self.parameters:
            raise InputError(
                f"{self.model.name} measures nothing; give at least one item (a landmark, a sample)"
            )
        if not 0 <= self.unknown <= self.model.parameter_dim:
            raise InputError(
                f"{self.unknown} of {self.model.parameter_dim} parameters of {self.model.name} cannot be unknown"
            )

    @property
    def count(self) -> int:
        """Items."""
        return len(self.parameters)


@dataclass(frozen=True)
class System:
    """x' = f(x) + sum_k g_k(x) u_k with known u, seen by sensors.

    Attributes
    ----------
    chart : Chart
        Coordinates of the motion.
    sensors : Sequence[SystemSensor]
        At least one.
    inputs : Sequence[Input]
        What acts and is known as a function of time.
    torque_axes : Sequence[Rationals]
        Directions in axes g of the torques about x, y and z. They are known: where g lies in the body is then
        no longer free, but for a rotation about a single such axis.
    """

    chart: Chart
    sensors: Sequence[SystemSensor]
    inputs: Sequence[Input] = ()
    torque_axes: Sequence[Rationals] = AXES_OF_G

    def __post_init__(self) -> None:
        if not self.sensors:
            raise InputError("nothing is measured: give the system at least one sensor")
        _check_axes(self.torque_axes)
        x = self.chart.unpack(ca.SX.sym("x", self.chart.mean_dim))
        for sensor in self.sensors:
            lacking = {NEEDED.get(block, block) for block in sensor.model.needs} - set(self.chart.seen(x))
            if lacking:
                raise InputError(
                    f"{sensor.model.name} needs {', '.join(sorted(lacking))}, which the chart {self.chart.name} does not hold; "
                    "take a chart with attitude and place"
                )
        if not all(each.is_torque for each in self.inputs) and "v" not in x:
            raise InputError(
                f"an inspector's manoeuvre needs a velocity; the chart {self.chart.name} holds none"
            )

    @property
    def dimension(self) -> int:
        """Unknowns: directions of the chart and unknown parameters."""
        return self.chart.error_dim + sum(sensor.unknown * sensor.count for sensor in self.sensors)

    @built_property
    def motion(self) -> Tape:
        """(x, u) -> x'."""
        x, u = ca.SX.sym("x", self.chart.mean_dim), ca.SX.sym("u", len(self.inputs))
        return tape_of("the motion", [x, u], self.rate(x, u))

    def rate(self, x: ca.SX, u: ca.SX) -> ca.SX:
        """x' as an expression."""
        values = self.chart.unpack(x)
        rates = self.chart.rates(values)
        for index, each in enumerate(self.inputs):
            for name, column in self._field(values, each).items():
                rates[name] = rates[name] + column * u[index]
        return self.chart.pack(rates)

    @built_property
    def directions(self) -> Tape:
        """x -> change of a point per error component, column by column."""
        x = ca.SX.sym("x", self.chart.mean_dim)
        return tape_of("the chart", [x], ca.vec(self.chart.directions(self.chart.unpack(x))))

    @built_property
    def outputs(self) -> tuple[Tape, ...]:
        """Functions (x, parameters) -> value, one per sensor."""
        return tuple(self._output(sensor) for sensor in self.sensors)

    def measured(self, sensor: SystemSensor, x: ca.SX, parameters: ca.SX) -> ca.SX:
        """A sensor's value as an expression."""
        return sensor.model.symbolic(self.chart.seen(self.chart.unpack(x)), parameters)

    def _field(self, values: Values, given: Input) -> Values:
        """One input's column of the dynamics.

        A torque by the chart's inertia, a manoeuvre as the opposite acceleration of what is seen.
        """
        if given.is_torque:
            axis = ca.DM([float(number) for number in self.torque_axes[given.axis]])
            return {name: columns @ axis for name, columns in self.chart.torque_field(values).items()}
        return {"v": -ca.DM(np.eye(3)[:, given.axis])}

    def _output(self, sensor: SystemSensor) -> Tape:
        x, p = ca.SX.sym("x", self.chart.mean_dim), ca.SX.sym("p", sensor.model.parameter_dim)
        return tape_of(f"the sensor {sensor.model.name}", [x, p], ca.SX(self.measured(sensor, x, p)))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all unknowns, in order.

        The chart's directions, then sensor by sensor and item by item the unknown parameters.
        """
        own = [
            f"{sensor.model.name} {item + 1} {'xyz'[k] if sensor.unknown == 3 else k + 1}"
            for sensor in self.sensors
            for item in range(sensor.count)
            for k in range(sensor.unknown)
        ]
        return (*self.chart.components, *own)


def _check_axes(axes: Sequence[Rationals]) -> None:
    """Refuse axes that are no exact fractions."""
    numbers = [number for axis in axes for number in axis]
    if len(numbers) != 9 or rationals([float(number) for number in numbers]) != tuple(numbers):
        raise InputError(
            "torque axes are three directions of three fractions with small denominators; others are not exact as constants"
        )


LAYOUT: Final = StateLayout(FULL_BLOCKS)


def analysed_sensors() -> Mapping[str, AnalysedSensor]:
    """Analyser's properties of every registered sensor that can be analysed, by its one name."""
    return {each.name: each.analysis for each in all_sensors() if each.analysis is not None}


def analysed(name: str) -> AnalysedSensor:
    """Analyser's properties of a sensor. InputError: unknown, or cannot be analysed."""
    found, name = analysed_sensors(), sensor_called(name)
    if name not in found and any(each.name == name for each in all_sensors()):
        raise InputError(
            f"sensor {name!r} has no `analysis`, by which it is analysed; state one (`AnalysedSensor`), or use one of "
            f"{', '.join(found)}"
        )
    if name not in found:
        kinds = [kind_called(each) for each in found]
        hint = nearest_text(name, kinds)
        raise InputError(
            f"sensor {name!r} is unknown; use one of {', '.join(kinds)}{'; ' if hint else ''}{hint}"
        )
    return found[name]


def watching(
    name: str,
    points: Sequence[Rationals] = (),
    known: bool = False,
    noise: Mapping[str, float] = MappingProxyType({}),
    layout: StateLayout = LAYOUT,
) -> SystemSensor:
    """A sensor of the registry.

    Parameters
    ----------
    points : Sequence[Rationals]
        Landmarks (frame g, m) of a sensor that sees some; to be mapped, unless the map is ``known``.
    noise : Mapping[str, float]
        Standard deviations by option, in place of the analyser's own.
    layout : StateLayout
        Of the state, which decides whether a bias is one of its unknowns.
    """
    sensor = analysed(name)
    model, rest = model_over(sensor.model, layout), rationals(with_noise_options(sensor, noise))
    if not sensor.sees_points:
        return SystemSensor(model, (rest,))
    return SystemSensor(model, tuple((*point, *rest) for point in points), 0 if known else 3)


def with_noise_options(sensor: AnalysedSensor, noise: Mapping[str, float]) -> tuple[float, ...]:
    """Parameters of a sensor's measurements with these standard deviations, by option, in place of its own."""
    parameters = list(sensor.parameters)
    for option in sensor.noise.keys() & noise.keys():
        for place in sensor.noise[option]:
            parameters[place] = noise[option]
    return tuple(parameters)


def is_linear_in_body_axes(model: MeasurementModel) -> bool:
    """Whether a model is a registered sensor's that is linear in axes which rotate with the body."""
    return any(type(model) is each.model and each.is_linear for each in analysed_sensors().values())
