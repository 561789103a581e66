"""Errors of time stamps."""

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.dataset import Dataset
from spinfilters.data.measurement_log import MeasurementLog
from spinfilters.simulation.model_faults.model_fault import GYRO, POSE, TRACKS, ModelFault

ALL: Final = (POSE, GYRO, TRACKS)


def _jitter(time: Float[np.ndarray, " k"], generator: np.random.Generator) -> Float[np.ndarray, " k"]:
    return generator.standard_normal(len(time))


def _drift(time: Float[np.ndarray, " k"], generator: np.random.Generator) -> Float[np.ndarray, " k"]:
    return 4 * ((time - time.mean()) / (time[-1] - time[0])) ** 2


def _unit(dataset: Dataset, size: float) -> Dataset:
    """Stamps ``size`` times too large, of the truth too.

    1000 for ms that are read as s. True rates and speeds stay.
    """
    streams = tuple(replace(stream, time=stream.time * size) for stream in dataset.log.streams)
    truth = None if dataset.truth is None else replace(dataset.truth, time=size * dataset.truth.time)
    return replace(dataset, log=MeasurementLog(streams), truth=truth)


FAULTS: Final = (
    ModelFault("clock-jitter", 0.03, ALL, late=_jitter),
    ModelFault("clock-drift", 0.3, ALL, late=_drift),
    ModelFault("clock-unit", 1e3, ALL, recording=_unit),
)
