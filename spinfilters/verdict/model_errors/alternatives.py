"""The table of all alternatives to the models of the estimators.

One more is a class in one of these modules and a line here.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from spinfilters.verdict.model_errors.camera_alternatives import (
    Baseline,
    CameraShake,
    Distortion,
    FocalLength,
    InspectorDelay,
    InspectorDrift,
    InspectorLever,
    InspectorMissing,
    PrincipalPoint,
    RightCameraLate,
    RightCameraTurned,
)
from spinfilters.verdict.model_errors.motion_alternatives import (
    AirResistance,
    ConstantAcceleration,
    ConstantTorque,
    ContactAtBegin,
    ContactAtEnd,
    Drag,
    EnergyLoss,
    Hinge,
    Rotor,
)
from spinfilters.verdict.model_errors.score_tests import Alternative
from spinfilters.verdict.model_errors.sensor_alternatives import (
    ClockDrift,
    ClockJitter,
    GyroBias,
    GyroDrift,
    GyroLowPass,
    GyroMisalignment,
    GyroScale,
    PointDrift,
    PositionDelay,
    SensorDelay,
)

ALTERNATIVES: Final[tuple[Alternative, ...]] = (
    ConstantAcceleration(),
    AirResistance(),
    CameraShake(),
    FocalLength(),
    PrincipalPoint(),
    Distortion(),
    Baseline(),
    RightCameraTurned(),
    RightCameraLate(),
    ClockJitter(),
    ClockDrift(),
    SensorDelay(),
    ContactAtBegin(),
    ContactAtEnd(),
    Drag(),
    GyroBias(),
    GyroDrift(),
    GyroScale(),
    GyroMisalignment(),
    GyroLowPass(),
    Hinge(),
    InspectorDelay(),
    InspectorDrift(),
    InspectorLever(),
    InspectorMissing(),
    EnergyLoss(),
    PositionDelay(),
    PointDrift(),
    Rotor(),
    ConstantTorque(),
)
"""In the order in which they are tried."""
_BY_NAME: Final = MappingProxyType({each.name: each for each in ALTERNATIVES})


def table() -> Mapping[str, Alternative]:
    """All alternatives by name."""
    return _BY_NAME
