"""Our consider parameters of calibrations; a new one gets a line here."""

from typing import Final

from spinfilters.sensors.calibration.baseline import BASELINE
from spinfilters.sensors.calibration.clock_scale import CLOCK_SCALE
from spinfilters.sensors.calibration.focal_length import FOCAL_LENGTH
from spinfilters.sensors.calibration.gyro_scale_error import GYRO_SCALE_ERROR
from spinfilters.sensors.calibration.inspector_clock import INSPECTOR_CLOCK
from spinfilters.sensors.calibration.inspector_lever import INSPECTOR_LEVER
from spinfilters.sensors.calibration.inspector_position import INSPECTOR_POSITION
from spinfilters.sensors.calibration.inspector_rotation import INSPECTOR_ROTATION
from spinfilters.sensors.calibration.length_scale import LENGTH_SCALE
from spinfilters.sensors.calibration.principal_point import PRINCIPAL_POINT

OWN_CALIBRATION: Final = (
    BASELINE,
    CLOCK_SCALE,
    FOCAL_LENGTH,
    GYRO_SCALE_ERROR,
    INSPECTOR_CLOCK,
    INSPECTOR_LEVER,
    INSPECTOR_POSITION,
    INSPECTOR_ROTATION,
    LENGTH_SCALE,
    PRINCIPAL_POINT,
)
