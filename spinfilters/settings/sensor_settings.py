"""The settings' table [sensors]: one key per noise option of the registry."""

from dataclasses import field, make_dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal

from spinfilters.data.sensor_format import noise_options

AUTO: Final = "auto"
Auto = Literal["auto"]

if TYPE_CHECKING:

    class SensorSettings:
        """Standard deviations of the sensors.

        "auto" takes the data set's own, or the default where it is silent.
        Its fields are the `NoiseOption` of all sensors. "auto" of an option that a sensor identifies (`Sensor.identified_option`)
        identifies it from the recording when nobody states the sensor's noise.
        """

        __dataclass_fields__: ClassVar[dict[str, Any]]

        def __init__(self, **options: float | str) -> None: ...

        def __getattr__(self, name: str) -> float | str: ...

else:
    SensorSettings = make_dataclass(
        "SensorSettings",
        [
            (name, Auto | Annotated[float, option.allowed], field(default=AUTO))
            for name, option in noise_options().items()
        ],
        frozen=True,
        namespace={"__doc__": "Standard deviations of the sensors, see the module."},
    )
