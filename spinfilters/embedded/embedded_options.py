"""Options of the embedded filter and the sensors that it can take."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.models.camera_landmarks import StereoLandmark
from spinfilters.models.measurement import LandmarkSensor, MeasurementModel
from spinfilters.models.sensors.gyro import Gyro
from spinfilters.models.sensors.pose import Pose, pose_parameters
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout

POINT: Final = 3
"""Parameters that are a landmark's point; they come first."""


@dataclass(frozen=True, eq=False)
class EmittedSensor:
    """A sensor of a generated filter.

    Attributes
    ----------
    model : Callable[[StateLayout], MeasurementModel]
        Over a layout.
    blocks : tuple[str, ...]
        Of the state of a filter that is generated for it.
    also : tuple[str, ...]
        Sensors that such a filter takes too.
    landmark_model : Callable[[StateLayout], LandmarkSensor] or None
        The same model of a sensor of landmarks, which the C holds in a map; None of another.
    macros : Callable[[MeasurementModel, int], Mapping[str, int]]
        Of the C, by name, from the model and the size of the map.
    example : ndarray of shape (p,) or None
        Parameters of the measurements of the test vectors; of a sensor of landmarks these come with the
        scene.
    quaternion : int or None
        First of four numbers of a value that are a unit quaternion.
    """

    name: str
    model: Callable[[StateLayout], MeasurementModel]
    blocks: tuple[str, ...]
    also: tuple[str, ...] = ()
    landmark_model: Callable[[StateLayout], LandmarkSensor] | None = None
    macros: Callable[[MeasurementModel, int], Mapping[str, int]] = lambda model, landmarks: {}
    example: Float[np.ndarray, " p"] | None = None
    quaternion: int | None = None

    @property
    def taken(self) -> tuple[str, ...]:
        """Names of all sensors that a filter generated for this one takes."""
        return (self.name, *self.also)

    def normalised(self, value: Float[np.ndarray, " v"]) -> Float[np.ndarray, " v"]:
        """A value with its quaternion, where it has one, of unit length."""
        if self.quaternion is None:
            return value
        unit = value.copy()
        unit[self.quaternion :] /= np.linalg.norm(value[self.quaternion :])
        return unit


def _stereo_macros(model: MeasurementModel, landmarks: int) -> Mapping[str, int]:
    return {"SF_LANDMARKS": landmarks, "SF_STEREO_PARAMETERS": model.parameter_dim - POINT}


def _gyro_macros(model: MeasurementModel, landmarks: int) -> Mapping[str, int]:
    return {"SF_GYRO_PARAMETERS": model.parameter_dim}


_POSE_NOISE: Final = np.diag([1.6e-5] * 3 + [2.5e-5] * 3)
EMITTED_SENSORS: Final = MappingProxyType(
    {
        each.name: each
        for each in (
            EmittedSensor(
                "pose", Pose, FULL_BLOCKS, example=pose_parameters(_POSE_NOISE[None])[0], quaternion=3
            ),
            EmittedSensor(
                "stereo",
                StereoLandmark,
                FULL_BLOCKS,
                also=("pose",),
                landmark_model=StereoLandmark,
                macros=_stereo_macros,
            ),
            EmittedSensor("gyro", Gyro, ROTATION_BLOCKS, macros=_gyro_macros, example=np.array([0.01, 0.0])),
        )
    }
)
"""All that the C has an update for, by name."""


REALS = ("float", "double")
SUBSTEPS = (2, 4, 8, 16, 32, 64)
"""Of a prediction: even, for the noise is integrated by Simpson's or Boole's rule over them."""
LARGEST_MAP = 65_535


@dataclass(frozen=True)
class EmbedOptions:
    """Options of a generated filter.

    Attributes
    ----------
    sensor : str
        Pose, stereo (which takes poses too) or gyro.
    landmarks : int
        That the map of a stereo filter holds, at most.
    real : str
        Arithmetic, float or double.
    substeps : int
        Runge-Kutta steps of a prediction, always so many: 2 for up to 0.15 rad between epochs, 4 for 0.3 rad.
    """

    sensor: str = "stereo"
    landmarks: int = 200
    real: str = "float"
    substeps: int = 2

    def __post_init__(self) -> None:
        for name, value, allowed in (
            ("sensor", self.sensor, tuple(EMITTED_SENSORS)),
            ("real", self.real, REALS),
            ("substeps", self.substeps, SUBSTEPS),
        ):
            if value not in allowed:
                raise InputError(f"embed --{name} is {value!r}; choose one of {', '.join(map(str, allowed))}")
        if not 1 <= self.landmarks <= LARGEST_MAP:
            raise InputError(f"embed --landmarks is {self.landmarks}; give 1 to {LARGEST_MAP}")

    @property
    def layout(self) -> StateLayout:
        """Blocks of the state."""
        return StateLayout(EMITTED_SENSORS[self.sensor].blocks)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors whose updates are generated."""
        return EMITTED_SENSORS[self.sensor].taken

    @property
    def emitted(self) -> tuple[EmittedSensor, ...]:
        """Sensors whose updates are generated."""
        return tuple(EMITTED_SENSORS[name] for name in self.sensors)

    @property
    def has_map(self) -> bool:
        """Whether the filter holds landmarks."""
        return any(each.landmark_model is not None for each in self.emitted)
