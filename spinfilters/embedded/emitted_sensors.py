"""Sensors that the embedded filter can take."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.models.camera_landmarks import StereoLandmark
from spinfilters.models.measurement import LandmarkSensor, MeasurementModel
from spinfilters.models.sensors.gyro import Gyro
from spinfilters.models.sensors.pose import Pose, pose_parameters
from spinfilters.models.state_blocks import ACCELERATION, GYRO_BIAS
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
    further : tuple[str, ...]
        Blocks that such a state may have in addition.
    also : tuple[str, ...]
        Sensors that such a filter takes too.
    landmark_model : Callable[[StateLayout], LandmarkSensor] or None
        The same model of a sensor of landmarks, which the C holds in a map; None of another.
    macros : Callable[[MeasurementModel, int], Mapping[str, int]]
        Of the C, by name, from the model and the size of the map.
    example : ndarray of shape (p,) or None
        Parameters of the measurements of the test vectors; of a sensor of landmarks these come with the
        scene.
    example_std : tuple of float
        Deviations of the numbers of a value with these parameters.
    stated : Callable[[Mapping[str, float]], tuple[ndarray, tuple[float, ...]]] or None
        Parameters and deviations as ``example`` and ``example_std`` from the noise of a run by its options; None of a sensor whose
        parameters come with the scene.
    quaternion : int or None
        First of four numbers of a value that are a unit quaternion.
    """

    name: str
    model: Callable[[StateLayout], MeasurementModel]
    blocks: tuple[str, ...]
    further: tuple[str, ...] = ()
    also: tuple[str, ...] = ()
    landmark_model: Callable[[StateLayout], LandmarkSensor] | None = None
    macros: Callable[[MeasurementModel, int], Mapping[str, int]] = lambda model, landmarks: {}
    example: Float[np.ndarray, " p"] | None = None
    example_std: tuple[float, ...] = ()
    stated: "Callable[[Mapping[str, float]], ExampleNoise] | None" = None
    quaternion: int | None = None

    def with_noise(self, noise: Mapping[str, float]) -> "EmittedSensor":
        """The sensor with the noise of a run in place of the example's; itself where that does not state all of it."""
        if self.stated is None:
            return self
        try:
            parameters, deviations = self.stated(noise)
        except KeyError:
            return self
        return replace(self, example=parameters, example_std=deviations)

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


ExampleNoise = tuple[np.ndarray, tuple[float, ...]]
"""Parameters of a measurement, and deviations of its numbers."""


def _pose_noise(noise: Mapping[str, float]) -> ExampleNoise:
    """Of standard deviations of position (m) and rotation (rad); a quaternion's numbers have half of the latter."""
    place, turn = noise["pose_position_std"], noise["pose_rotation_std"]
    covariance = np.diag([place**2] * 3 + [turn**2] * 3)
    return pose_parameters(covariance[None])[0], (place,) * 3 + (turn / 2,) * 4


def _gyro_noise(noise: Mapping[str, float]) -> ExampleNoise:
    """Of the standard deviation of the rate (rad/s), and of the part that is proportional to the rate."""
    std = noise["gyro_noise_std"]
    return np.array([std, noise.get("gyro_scale_std", 0.0)]), (std,) * 3


def _stereo_macros(model: MeasurementModel, landmarks: int) -> Mapping[str, int]:
    return {"SF_LANDMARKS": landmarks, "SF_STEREO_PARAMETERS": model.parameter_dim - POINT}


def _gyro_macros(model: MeasurementModel, landmarks: int) -> Mapping[str, int]:
    return {"SF_GYRO_PARAMETERS": model.parameter_dim}


_POSE_NOISE: Final = np.diag([1.6e-5] * 3 + [2.5e-5] * 3)
_POSE_STD: Final = (0.004,) * 3 + (0.0025,) * 4
"""In m; of a quaternion's numbers half the 0.005 rad of the rotation."""
EMITTED_SENSORS: Final = MappingProxyType(
    {
        each.name: each
        for each in (
            EmittedSensor(
                "pose",
                Pose,
                FULL_BLOCKS,
                further=(ACCELERATION.name,),
                example=pose_parameters(_POSE_NOISE[None])[0],
                example_std=_POSE_STD,
                stated=_pose_noise,
                quaternion=3,
            ),
            EmittedSensor(
                "stereo",
                StereoLandmark,
                FULL_BLOCKS,
                further=(ACCELERATION.name,),
                also=("pose",),
                landmark_model=StereoLandmark,
                macros=_stereo_macros,
            ),
            EmittedSensor(
                "gyro",
                Gyro,
                ROTATION_BLOCKS,
                further=(GYRO_BIAS.name,),
                macros=_gyro_macros,
                example=np.array([0.01, 0.0]),
                example_std=(0.01,) * 3,
                stated=_gyro_noise,
            ),
        )
    }
)
"""All that the C has an update for, by name."""
