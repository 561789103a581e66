"""The range of every number in a settings file. Wide: what is merely unwise ends with a status."""

from typing import Final

from spinfilters.logs.dataset_options import DENSITIES
from spinfilters.logs.number_range import NumberRange
from spinfilters.logs.sensor_format import noise_options

_HORIZON = NumberRange(1, 1e9, "updates", zero=True)
_STD = NumberRange(1e-9, 1e9)

SETTING_RANGES: Final[dict[str, NumberRange]] = {
    "process.force_psd": DENSITIES["force_psd"],
    "process.torque_psd": DENSITIES["torque_psd"],
    "process.tolerance": NumberRange(1e-12, 1e-2),
    **{f"sensors.{option.name}": option.allowed for option in noise_options().values()},
    "start.frames": NumberRange(1, 100_000, whole=True),
    "start.share": NumberRange(1e-6, 1e6),
    "start.duration": NumberRange(1e-6, 1e11, "s"),
    "start.iterations": NumberRange(1, 10_000, whole=True),
    "start.mass_std": _STD,
    "start.centre_std": _STD,
    "start.speed_std": _STD,
    "start.drag_std": _STD,
    "ukf.alpha": NumberRange(1e-3, 1e3),
    "ukf.beta": NumberRange(0, 1e6),
    "ukf.kappa": NumberRange(-10, 1e6),
    "landmarks.modes": NumberRange(1, 60, whole=True),
    "landmarks.explained": NumberRange(0, 1e9),
    "landmarks.largest_map": NumberRange(4, 10_000_000, whole=True),
    "robust.gate_probability": NumberRange(1e-15, 1),
    "robust.width": NumberRange(1e-6, 1e9),
    "robust.shape": NumberRange(-1e9, 2),
    "iteration.iterations": NumberRange(1, 1000, whole=True),
    "iteration.tolerance": NumberRange(1e-15, 1e9),
    "adaptation.measurement": _HORIZON,
    "adaptation.process": _HORIZON,
    "smoother.frames": NumberRange(2, 1_000_000, whole=True),
    "smoother.revolutions": NumberRange(1e-6, 1e9),
    "smoother.width": NumberRange(1e-6, 1e9),
    "smoother.shape": NumberRange(-1e9, 2),
    "smoother.iterations": NumberRange(1, 1000, whole=True),
}
