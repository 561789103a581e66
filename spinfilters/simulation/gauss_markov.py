"""Measurement errors that are correlated in time: stationary Gauss-Markov processes."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from spinfilters.data.dataset import Dataset
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.simulation.faults import with_stream
from spinfilters.state.layout import StateLayout


def gauss_markov(
    white: Float[np.ndarray, "n k"], correlation: float | Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n k"]:
    """Errors of unit variance from white ones, each correlated with the row before.

    Parameters
    ----------
    correlation: of every row, or of all; that of the first is not used.
    """
    errors, kept = white.copy(), np.broadcast_to(correlation, len(white))
    for k in range(1, len(errors)):
        errors[k] = kept[k] * errors[k - 1] + np.sqrt(1 - kept[k] ** 2) * white[k]
    return errors


def with_gauss_markov_errors(
    dataset: Dataset, std: Float[np.ndarray, " k"], correlation: float, generator: np.random.Generator
) -> Dataset:
    """The data set whose first stream has such errors more, from epoch to epoch.

    Parameters
    ----------
    std: of rates rad/s (3), of poses m and rad (6), or of observations of landmarks px, each landmark having errors of its own.
    """
    stream = dataset.log.streams[0]
    white = generator.standard_normal((len(stream), len(std)))
    if stream.ids is None:
        errors = std * gauss_markov(white, correlation)
        is_additive = stream.values.shape == errors.shape  # a quaternion has a number more than its error
        moved = StateLayout(("t", "a")).retract
        values = stream.values + errors if is_additive else moved(stream.values, errors)
        return with_stream(dataset, replace(stream, values=values))
    errors, number = np.zeros_like(stream.values), _epoch_numbers(stream)
    for landmark in np.unique(stream.ids):
        rows = np.flatnonzero(stream.ids == landmark)
        kept = correlation ** np.diff(number[rows], prepend=0).astype(float)
        errors[rows] = std * gauss_markov(white[rows], kept)
    return with_stream(dataset, replace(stream, values=stream.values + errors))


def _epoch_numbers(stream: MeasurementStream) -> Float[np.ndarray, " n"]:
    return np.searchsorted(stream.epoch_times, stream.time).astype(float)
