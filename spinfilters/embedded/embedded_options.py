"""Options of the embedded filter. Nothing heavy is imported here: the command's help is made from them."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Final, Literal, get_args

from spinfilters.core.errors import InputError
from spinfilters.io.stated_values import Argument, NumberRange

if TYPE_CHECKING:
    from spinfilters.embedded.emitted_sensors import EmittedSensor
    from spinfilters.models.state_layout import StateLayout

EmbeddedSensor = Literal["pose", "stereo-tracks", "gyro", "stereo"]
"""The last is a former name of the second."""
Real = Literal["float", "double"]
Substeps = Literal[2, 4, 8, 16, 32, 64]
"""Of a prediction: even, for the noise is integrated by Simpson's or Boole's rule over them."""
MAP_SIZE: Final = NumberRange(1, 65_535, whole=True)
BIAS_STD: Final = NumberRange(1e-9, 1e3, "rad/s", zero=True)
BIAS_PSD: Final = NumberRange(1e-20, 1e6, "(rad/s^2)^2/Hz", zero=True)
OPTIONS_OF_BLOCKS: Final = {"b": "--gyro-bias-std", "f": "--acceleration"}
"""Option that adds a further block to the state."""


@dataclass(frozen=True)
class EmbedOptions:
    """Options of a generated filter.

    Attributes
    ----------
    sensor : str
        "pose", "stereo-tracks" (which takes poses too) or "gyro"; "stereo" is accepted too.
    landmarks : int
        That the map of a stereo filter holds, at most.
    real : str
        Arithmetic, float or double.
    substeps : int
        Runge-Kutta steps of a prediction, always so many: 2 for up to 0.15 rad between epochs, 4 for 0.3 rad.
    gyro_bias_std : float
        Standard deviation of the gyro's bias in a start state that is an example, rad/s; 0 for a state without the bias.
    gyro_bias_psd : float
        Density of the white noise that the bias integrates, its random walk, (rad/s^2)^2/Hz; 0 for a constant bias.
    acceleration : bool
        Whether the state has a constant acceleration of the centre of mass, axes i.

    Raises
    ------
    InputError
        A value that is not allowed, or a block of the state that the sensor says nothing of.
    """

    sensor: Annotated[EmbeddedSensor, Argument("that it measures with; stereo is stereo-tracks")] = (
        "stereo-tracks"
    )
    landmarks: Annotated[int, MAP_SIZE, Argument("places in the map of a stereo filter", metavar="N")] = 200
    real: Annotated[Real, Argument("arithmetic")] = "float"
    substeps: Annotated[
        Substeps,
        Argument("Runge-Kutta steps of a prediction: 2 for up to 0.16 rad between epochs"),
    ] = 2
    gyro_bias_std: Annotated[
        float,
        BIAS_STD,
        Argument("estimates the gyro's bias, with this prior std in rad/s; 0 leaves it out", metavar="STD"),
    ] = 0.0
    gyro_bias_psd: Annotated[
        float,
        BIAS_PSD,
        Argument(
            "density of the bias' random walk in (rad/s^2)^2/Hz: its std grows by sqrt(PSD t) in t s",
            metavar="PSD",
        ),
    ] = 0.0
    acceleration: Annotated[
        bool, Argument("estimates a constant acceleration, as process.gravity of a run")
    ] = False

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
        if (
            self.sensor == "stereo-tracks"
        ):  # the kind of data sets; models and C code have the sensor's own name
            object.__setattr__(self, "sensor", "stereo")
        BIAS_STD.require("embed --gyro-bias-std", self.gyro_bias_std)
        BIAS_PSD.require("embed --gyro-bias-psd", self.gyro_bias_psd)
        if self.gyro_bias_psd and not self.gyro_bias_std:
            raise InputError("embed --gyro-bias-psd needs a bias in the state; give --gyro-bias-std too")
        for block in self._added_blocks:
            self._require_seen(block)

    @property
    def _added_blocks(self) -> list[str]:
        """Names of the blocks that the options add."""
        wanted = {"b": self.gyro_bias_std > 0, "f": self.acceleration}
        return [block for block, is_wanted in wanted.items() if is_wanted]

    def _require_seen(self, block: str) -> None:
        """InputError: a wanted block of the state that measurements of the sensor do not depend on."""
        from spinfilters.embedded.emitted_sensors import EMITTED_SENSORS

        fit = [each.name for each in EMITTED_SENSORS.values() if block in each.further]
        if self.sensor not in fit:
            raise InputError(
                f"embed {OPTIONS_OF_BLOCKS[block]} needs --sensor {' or '.join(fit)}, not {self.sensor}; leave it out"
            )

    def require_further_blocks_of(self, blocks: Collection[str], source: str) -> None:
        """InputError: a run's state has a block that measurements of the sensor depend on, and this filter would drop."""
        from spinfilters.embedded.emitted_sensors import EMITTED_SENSORS

        further = EMITTED_SENSORS[self.sensor].further
        lost = [name for name in further if name in blocks and name not in self.layout.blocks]
        if lost:
            raise InputError(
                f"{source}: its state has {lost[0]}, which this filter would take for zero; "
                f"give {OPTIONS_OF_BLOCKS[lost[0]]} too"
            )

    @property
    def layout(self) -> "StateLayout":
        """Blocks of the state."""
        from spinfilters.embedded.emitted_sensors import EMITTED_SENSORS
        from spinfilters.models.state_blocks import BLOCKS
        from spinfilters.models.state_layout import StateLayout

        further = [BLOCKS[name] for name in self._added_blocks]
        return StateLayout(EMITTED_SENSORS[self.sensor].blocks).joined(*further)

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
