"""Errors of a rate gyro."""

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.dataset import Dataset
from spinfilters.data.measurement_log import MeasurementLog
from spinfilters.simulation.model_faults.model_fault import AXIS, GYRO, FaultyRates, ModelFault

ONLY: Final = (GYRO,)


def _bias(each: FaultyRates) -> Float[np.ndarray, "k 3"]:
    return np.tile(each.size * AXIS, (len(each.rates), 1))


def _drift(each: FaultyRates) -> Float[np.ndarray, "k 3"]:
    """A bias that grows from -size to size."""
    along = np.linspace(-1.0, 1.0, len(each.rates))
    return each.size * along[:, None] * AXIS


def _scale(each: FaultyRates) -> Float[np.ndarray, "k 3"]:
    return each.size * each.rates


def _misaligned(each: FaultyRates) -> Float[np.ndarray, "k 3"]:
    return each.size * each.rates[:, [1, 0, 2]] * [1, 1, 0]


def _low_pass(each: FaultyRates) -> Float[np.ndarray, "k 3"]:
    """First-order low-pass filter with its lag set back.

    It passes half of the power at ``1 / sqrt(size)`` rad/s.
    """
    tau, time, rates = float(np.sqrt(each.size)), each.fine.time, each.fine.block("w")
    out, share = rates.copy(), 1 - np.exp(-(time[1] - time[0]) / tau)
    for k in range(1, len(time)):
        out[k] = out[k - 1] + share * (rates[k] - out[k - 1])
    later = np.minimum(each.time + tau, time[-1])
    passed = np.stack([np.interp(later, time, out[:, axis]) for axis in range(3)], axis=1)
    return passed - each.rates


def _unit(dataset: Dataset, size: float) -> Dataset:
    """Rates ``size`` times too large: 57.3 for degrees that are read as radians."""
    streams = tuple(replace(stream, values=stream.values * size) for stream in dataset.log.streams)
    return replace(dataset, log=MeasurementLog(streams))


FAULTS: Final = (
    ModelFault("gyro-bias", 0.03, ONLY, rates=_bias),
    ModelFault("gyro-drift", 0.03, ONLY, rates=_drift),
    ModelFault("gyro-scale", 0.05, ONLY, rates=_scale),
    ModelFault("gyro-misalignment", 0.05, ONLY, rates=_misaligned),
    ModelFault("gyro-low-pass", 0.1, ONLY, rates=_low_pass),
    ModelFault("gyro-unit", float(np.degrees(1.0)), ONLY, recording=_unit),
)
