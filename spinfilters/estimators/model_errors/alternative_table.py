"""The table of all alternatives to the models of the estimators.

One more is a class in one of these modules and a line here.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.alternatives.acceleration_alternative import ConstantAcceleration
from spinfilters.estimators.model_errors.alternatives.air import AirResistance
from spinfilters.estimators.model_errors.alternatives.camera_alternatives import (
    Baseline,
    CameraShake,
    Distortion,
    FocalLength,
    PrincipalPoint,
    RightCameraLate,
    RightCameraTurned,
)
from spinfilters.estimators.model_errors.alternatives.clock_alternatives import (
    ClockDrift,
    ClockJitter,
    SensorDelay,
)
from spinfilters.estimators.model_errors.alternatives.contact import ContactAtBegin, ContactAtEnd
from spinfilters.estimators.model_errors.alternatives.drag_alternative import Drag
from spinfilters.estimators.model_errors.alternatives.gyro_alternatives import (
    GyroBias,
    GyroDrift,
    GyroLowPass,
    GyroMisalignment,
    GyroScale,
)
from spinfilters.estimators.model_errors.alternatives.hinge import Hinge
from spinfilters.estimators.model_errors.alternatives.inspector_alternatives import (
    InspectorDelay,
    InspectorDrift,
    InspectorLever,
    InspectorMissing,
)
from spinfilters.estimators.model_errors.alternatives.internal_motion import EnergyLoss
from spinfilters.estimators.model_errors.alternatives.pose_alternatives import PointDrift, PositionDelay
from spinfilters.estimators.model_errors.alternatives.rotor_alternative import Rotor
from spinfilters.estimators.model_errors.alternatives.torque_alternative import ConstantTorque

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
