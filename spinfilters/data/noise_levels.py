"""Standard deviations of sensors by the names of their options."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from spinfilters.data.sensor_format import noise_options
from spinfilters.errors import InputError


@dataclass(frozen=True, init=False)
class SensorNoise:
    """Standard deviations of sensors whose rows have no covariances.

    See each sensor for its model.
    Every option of the registry has a value, its default where none is given, and is an attribute: ``noise.pixel_std``.

    Raises
    ------
    InputError: an unknown option, a value that is not positive (or zero where the option allows it) and finite.
    """

    values: Mapping[str, float]

    def __init__(self, values: Mapping[str, float] | None = None, **changes: float) -> None:
        options = noise_options()
        given = {**(values or {}), **changes}
        for name, value in given.items():
            if name not in options:
                raise InputError(f"sensor noise {name} is unknown; use {', '.join(options)}")
            smallest = 0.0 if options[name].allowed.zero else np.finfo(float).tiny
            if not (np.isfinite(value) and value >= smallest):
                raise InputError(f"{name} is {value}; give a positive, finite standard deviation")
        defaults = {name: option.default for name, option in options.items()}
        object.__setattr__(self, "values", {**defaults, **given})

    def __getattr__(self, name: str) -> float:
        if name == "values" or name.startswith("__") or name not in self.values:
            raise AttributeError(f"sensor noise has no {name}")
        return self.values[name]
