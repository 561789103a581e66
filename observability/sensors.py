"""The registered sensors with usual noise, ready for a `System`."""

from collections.abc import Mapping, Sequence
from typing import Final

from observability.rational import Rationals, rationals
from observability.system import SystemSensor
from spinfilters.errors import InputError
from spinfilters.models.measurement import MeasurementModel
from spinfilters.sensors.sensor import AnalysedSensor
from spinfilters.sensors.sensor_registry import all_sensors
from spinfilters.state.layout import FULL_BLOCKS, StateLayout

LAYOUT: Final = StateLayout(FULL_BLOCKS)


def analysed_sensors() -> Mapping[str, AnalysedSensor]:
    """Analyser's properties of every registered sensor that can be analysed, by name."""
    return {each.name: each.analysis for each in all_sensors() if each.analysis is not None}


def analysed(name: str) -> AnalysedSensor:
    """Analyser's properties of a sensor. InputError: unknown, or cannot be analysed."""
    found = analysed_sensors()
    if name not in found:
        raise InputError(f"sensor {name!r} is unknown; use one of {', '.join(found)}")
    return found[name]


def watching(name: str, points: Sequence[Rationals] = (), known: bool = False) -> SystemSensor:
    """A sensor of the registry.

    Parameters
    ----------
    points: landmarks (frame g, m) of a sensor that sees some; to be mapped, unless the map is ``known``.
    """
    sensor = analysed(name)
    model, rest = sensor.model(LAYOUT), rationals(sensor.parameters)
    if not sensor.sees_points:
        return SystemSensor(model, (rest,))
    return SystemSensor(model, tuple((*point, *rest) for point in points), 0 if known else 3)


def is_linear_in_body_axes(model: MeasurementModel) -> bool:
    """Whether a model is linear in axes that turn with the body.

    It is that of a registered sensor.
    """
    return any(type(model) is each.model and each.is_linear for each in analysed_sensors().values())
