"""Where members of registries stand that layers below them ask for: sensors, and parameters of their calibration.

Files are read and written by the formats of all sensors, and a sensor is one module above the files. The package binds them here,
when it is imported; the modules are imported when somebody asks.
"""

from spinfilters.core.plugins import bind_members


def _own_sensors() -> tuple[object, ...]:
    from spinfilters.models.sensor_registry import OWN_SENSORS

    return OWN_SENSORS


def _own_calibration() -> tuple[object, ...]:
    from spinfilters.models.calibration import OWN_CALIBRATION

    return OWN_CALIBRATION


def bind_registries() -> None:
    """Bind the sensors and the calibration parameters of this package."""
    bind_members("spinfilters.sensors", _own_sensors)
    bind_members("spinfilters.calibration", _own_calibration)
