"""The registry of sensors: every module of this package with a ``SENSOR``, and entry points `spinfilters.sensors`."""

from collections.abc import Iterable

from spinfilters.data.measurement_log import MeasurementLog
from spinfilters.data.sensor_format import SENSORS
from spinfilters.errors import InputError
from spinfilters.sensors.sensor import Sensor
from spinfilters.state.block import StateBlock


def all_sensors() -> tuple[Sensor, ...]:
    """Every sensor, those without data sets too.

    Raises
    ------
    InputError: a plug-in that cannot be loaded, or is no sensor.
    """
    found = []
    for entry in SENSORS.entries:
        if not isinstance(entry, Sensor):
            raise InputError(f"the registered {type(entry).__name__} is no Sensor; mend or uninstall it")
        found.append(entry)
    return tuple(found)


def sensor_of(name: str) -> Sensor:
    """The sensor of that name. InputError: an unknown one."""
    sensors = {sensor.name: sensor for sensor in all_sensors()}
    if name not in sensors:
        raise InputError(f"sensor {name!r} is unknown; use one of {', '.join(sensors)}")
    return sensors[name]


def has_error(kinds: Iterable[str], block: StateBlock) -> bool:
    """Whether the sensor of one of these kinds of data sets has this constant error."""
    having = {each.format.kind for each in all_sensors() if each.format and block in each.error_blocks}
    return not having.isdisjoint(kinds)


def sensors_in(log: MeasurementLog) -> tuple[Sensor, ...]:
    """The sensors of a log, in the order of its streams."""
    return tuple(sensor_of(name) for name in log.sensors)
