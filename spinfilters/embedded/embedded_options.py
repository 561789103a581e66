"""Options of a generated filter: sensor, map, arithmetic and step."""

from dataclasses import dataclass

from spinfilters.embedded.emitted_sensors import EMITTED_SENSORS, EmittedSensor
from spinfilters.errors import InputError
from spinfilters.state.layout import StateLayout

REALS = ("float", "double")
SUBSTEPS = (2, 4, 8, 16, 32, 64)
"""Of a prediction: even, for the noise is integrated by Simpson's or Boole's rule over them."""
LARGEST_MAP = 65_535


@dataclass(frozen=True)
class EmbedOptions:
    """Options of a generated filter.

    Attributes
    ----------
    sensor: pose, stereo (which takes poses too) or gyro.
    landmarks: that the map of a stereo filter holds, at most.
    real: arithmetic, float or double.
    substeps: Runge-Kutta steps of a prediction, always so many: 2 for up to 0.15 rad between epochs, 4 for 0.3 rad.
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
