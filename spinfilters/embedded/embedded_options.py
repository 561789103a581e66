"""Options of the embedded filter. Nothing heavy is imported here: the command's help is made from them."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Final, Literal, get_args

from spinfilters.core.errors import InputError
from spinfilters.io.stated_values import Argument, NumberRange

if TYPE_CHECKING:
    from spinfilters.embedded.emitted_sensors import EmittedSensor
    from spinfilters.models.state_layout import StateLayout

EmbeddedSensor = Literal["pose", "stereo", "gyro"]
Real = Literal["float", "double"]
Substeps = Literal[2, 4, 8, 16, 32, 64]
"""Of a prediction: even, for the noise is integrated by Simpson's or Boole's rule over them."""
MAP_SIZE: Final = NumberRange(1, 65_535, whole=True)


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

    sensor: Annotated[EmbeddedSensor, Argument("that it measures with")] = "stereo"
    landmarks: Annotated[int, MAP_SIZE, Argument("places in the map of a stereo filter", metavar="N")] = 200
    real: Annotated[Real, Argument("arithmetic")] = "float"
    substeps: Annotated[
        Substeps,
        Argument("Runge-Kutta steps of a prediction: 2 for up to 0.16 rad between epochs"),
    ] = 2

    def __post_init__(self) -> None:
        for name, value, allowed in (
            ("sensor", self.sensor, get_args(EmbeddedSensor)),
            ("real", self.real, get_args(Real)),
            ("substeps", self.substeps, get_args(Substeps)),
        ):
            if value not in allowed:
                raise InputError(f"embed --{name} is {value!r}; choose one of {', '.join(map(str, allowed))}")
        if self.landmarks not in MAP_SIZE:
            raise InputError(
                f"embed --landmarks is {self.landmarks}; give {MAP_SIZE.smallest} to {MAP_SIZE.largest}"
            )

    @property
    def layout(self) -> "StateLayout":
        """Blocks of the state."""
        from spinfilters.embedded.emitted_sensors import EMITTED_SENSORS
        from spinfilters.models.state_layout import StateLayout

        return StateLayout(EMITTED_SENSORS[self.sensor].blocks)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors whose updates are generated."""
        from spinfilters.embedded.emitted_sensors import EMITTED_SENSORS

        return EMITTED_SENSORS[self.sensor].taken

    @property
    def emitted(self) -> "tuple[EmittedSensor, ...]":
        """Sensors whose updates are generated."""
        from spinfilters.embedded.emitted_sensors import EMITTED_SENSORS

        return tuple(EMITTED_SENSORS[name] for name in self.sensors)

    @property
    def has_map(self) -> bool:
        """Whether the filter holds landmarks."""
        return any(each.landmark_model is not None for each in self.emitted)
