"""spinfilters: how does that unknown object spin?

A first look, from a file of gyro rates to a picture::

    run = spinfilters.compare("gyro.csv")  # seconds and rad/s
    run.figure("summary").savefig("summary.png")

Everything public is here, and is loaded when it is first asked for: `load` and `simulate` give data sets, which `save` writes,
`compare` runs estimators on one and gives a `Run`, which `load_run` reads from its folder again, `campaign` runs a study of
thousands, `observe` says what a sensor can determine and `observe_recording` what a recording can; `read_mesh` and
`mass_properties` are for bodies of known shape.
What cannot be used raises `InputError`, whose text is one line that names the value and the cure.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from spinfilters.core.errors import InputError
from spinfilters.core.plugins import bind_members
from spinfilters.version import __version__ as __version__

if TYPE_CHECKING:
    from spinfilters.api.analysis import ObservabilityResult, observe
    from spinfilters.api.campaign_frames import campaign
    from spinfilters.api.comparison import EstimatorResult, Run, compare, load_run
    from spinfilters.api.recorded_observability import observe_recording
    from spinfilters.api.recordings import load, save
    from spinfilters.api.simulation import simulate
    from spinfilters.io.dataset import Dataset
    from spinfilters.lidar.mesh import mass_properties, read_mesh
    from spinfilters.settings.run_settings import Settings


def _own_sensors() -> tuple[object, ...]:
    from spinfilters.models.sensor_registry import OWN_SENSORS

    return OWN_SENSORS


def _own_calibration() -> tuple[object, ...]:
    from spinfilters.models.calibration import OWN_CALIBRATION

    return OWN_CALIBRATION


def _own_estimators() -> tuple[object, ...]:
    from spinfilters.run.estimators import OWN

    return OWN


# Where members of registries stand that layers below them ask for: files are read and written by the formats of all sensors, and a
# sensor is one module above the files. The modules are imported when somebody asks.
bind_members("spinfilters.sensors", _own_sensors)
bind_members("spinfilters.calibration", _own_calibration)
bind_members("spinfilters.estimators", _own_estimators)

__all__ = [
    "Dataset",
    "EstimatorResult",
    "InputError",
    "ObservabilityResult",
    "Run",
    "Settings",
    "campaign",
    "compare",
    "load",
    "load_run",
    "mass_properties",
    "observe",
    "observe_recording",
    "read_mesh",
    "save",
    "simulate",
]

_MODULES = {
    "Dataset": "spinfilters.io.dataset",
    "EstimatorResult": "spinfilters.api.comparison",
    "ObservabilityResult": "spinfilters.api.analysis",
    "Run": "spinfilters.api.comparison",
    "Settings": "spinfilters.settings.run_settings",
    "campaign": "spinfilters.api.campaign_frames",
    "compare": "spinfilters.api.comparison",
    "load": "spinfilters.api.recordings",
    "load_run": "spinfilters.api.comparison",
    "mass_properties": "spinfilters.lidar.mesh",
    "observe": "spinfilters.api.analysis",
    "observe_recording": "spinfilters.api.recorded_observability",
    "read_mesh": "spinfilters.lidar.mesh",
    "save": "spinfilters.api.recordings",
    "simulate": "spinfilters.api.simulation",
}
"""Where each public name comes from."""


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'spinfilters' has no attribute {name!r}")
    value = getattr(import_module(_MODULES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, "__version__"})
