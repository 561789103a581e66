"""The sensors: our own in a tuple, those of installed distributions after them; a new one gets a line here."""

from collections.abc import Iterable
from typing import Final

from spinfilters.core.errors import InputError
from spinfilters.core.plugins import entries_of_kind, installed_plugins
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.sensor_format import StoredSensor, sensor_called
from spinfilters.models.sensor import Sensor
from spinfilters.models.sensors.attitude import ATTITUDE
from spinfilters.models.sensors.gyro import GYRO
from spinfilters.models.sensors.lidar_points import LIDAR_POINTS
from spinfilters.models.sensors.magnetometer import MAGNETOMETER
from spinfilters.models.sensors.monocular import MONOCULAR
from spinfilters.models.sensors.pose import LIDAR_POSES, POSE
from spinfilters.models.sensors.stereo import STEREO
from spinfilters.models.state_blocks import StateBlock

OWN_SENSORS: Final[tuple[Sensor, ...]] = (
    ATTITUDE,
    GYRO,
    LIDAR_POINTS,
    LIDAR_POSES,
    MAGNETOMETER,
    MONOCULAR,
    POSE,
    STEREO,
)


def all_sensors() -> tuple[Sensor, ...]:
    """Every sensor: our own, and those of the entry points ``spinfilters.sensors``; those without data sets too.

    Raises
    ------
    InputError
        A plug-in that cannot be loaded, or is no sensor.
    """
    return entries_of_kind((*OWN_SENSORS, *installed_plugins("spinfilters.sensors", StoredSensor)), Sensor)


def sensor_of(name: str) -> Sensor:
    """The sensor of that name, kind or former name. InputError: an unknown one."""
    sensors = {sensor.name: sensor for sensor in all_sensors()}
    name = sensor_called(name)
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
