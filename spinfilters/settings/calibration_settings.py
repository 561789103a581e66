"""The settings' table [calibration]: one key per consider parameter of the registry."""

from dataclasses import field, make_dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from spinfilters.data.consider_parameter import consider_parameters
from spinfilters.settings.sensor_settings import AUTO, Auto

if TYPE_CHECKING:

    class CalibrationSettings:
        """Standard deviations of the calibration.

        "auto" takes the data set's own, or the default where it is silent.
        Its fields are the `ConsiderParameter` of all sensors.
        """

        __dataclass_fields__: ClassVar[dict[str, Any]]

        def __init__(self, **deviations: float | str) -> None: ...

        def __getattr__(self, name: str) -> float | str: ...

else:
    CalibrationSettings = make_dataclass(
        "CalibrationSettings",
        [
            (name, Auto | Annotated[float, each.allowed], field(default=AUTO))
            for name, each in consider_parameters().items()
        ],
        frozen=True,
        namespace={"__doc__": "Standard deviations of the calibration, see the module."},
    )
