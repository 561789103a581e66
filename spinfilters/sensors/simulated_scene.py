"""Input and output of a sensor's simulator."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float, Int

from spinfilters.data.camera import Rig
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.sensors.feature_tracks import FrontEnd, TrueMotion
from spinfilters.sensors.visibility import Surface


class SceneNoise(Protocol):
    """Errors of a scene's sensors by what they measure (`spinfilters.simulation.scenario.Scenario`)."""

    @property
    def position_std(self) -> float:
        """Standard deviation of a position, m."""
        ...

    @property
    def rotation_std(self) -> float:
        """Standard deviation of an attitude, rad."""
        ...

    @property
    def gyro_std(self) -> float:
        """Standard deviation of a body rate, rad/s."""
        ...

    @property
    def gyro_bias(self) -> tuple[float, float, float]:
        """Constant error of a body rate, rad/s, axes g."""
        ...


@dataclass(frozen=True, eq=False)
class Scene:
    """A true motion before a sensor.

    Attributes
    ----------
    motion: of the body in i.   seen: the same in the frame of the camera, of which the blocks t and a count.
    surface: its landmarks.   front_end: how a camera finds them.
    noise: of sensors without landmarks.   generator: of everything random.
    """

    motion: TrueMotion
    seen: TrueMotion
    surface: Surface
    front_end: FrontEnd
    noise: SceneNoise
    generator: np.random.Generator


@dataclass(frozen=True, eq=False)
class SimulatedStream:
    """Measurements of a scene.

    Attributes
    ----------
    noise: standard deviations that the data set states, by noise option.
    landmarks: rows of the surface that landmarks 0, 1, 2 ... are, and rig: of the camera; None for sensors without landmarks.
    """

    stream: MeasurementStream
    noise: Mapping[str, float]
    landmarks: Int[np.ndarray, " m"] | None = None
    rig: Rig | None = None


def with_noise(
    exact: Float[np.ndarray, "n m"], std: float, generator: np.random.Generator
) -> Float[np.ndarray, "n m"]:
    """Values with white noise of one standard deviation."""
    return exact + std * generator.standard_normal(exact.shape)
