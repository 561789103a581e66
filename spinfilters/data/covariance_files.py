"""Covariances of single measurements: a table with one row per measurement."""

from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.input_file import path_text
from spinfilters.data.measurement_log import MeasurementStream, first_not_definite
from spinfilters.data.sensor_format import sensor_format
from spinfilters.data.stated_values import NumberRange
from spinfilters.data.table_files import Table, read_csv, write_csv
from spinfilters.errors import InputError

ENTRY: Final = NumberRange(-1e18, 1e18)
"""Of a covariance, squared units of the measurement."""
SMALLEST_VARIANCE: Final[float] = 1e-24


def covariance_columns(sensor: str) -> tuple[str, ...]:
    """Header of a sensor's covariance table.

    The time, then the lower triangle c00, c10, c11, c20 ...
    """
    rows, columns = np.tril_indices(sensor_format(sensor).dimension)
    return ("time_s", *(f"c{i}{j}" for i, j in zip(rows.tolist(), columns.tolist(), strict=True)))


def with_covariance(stream: MeasurementStream, path: Path) -> MeasurementStream:
    """The stream with the covariances of the file (units as `MeasurementStream`), one line for each row.

    Raises
    ------
    InputError: as `read_csv`; entries beyond `ENTRY`, variances below `SMALLEST_VARIANCE`; other times than the
    stream has; matrices that are not positive definite.
    """
    table = read_csv(path, covariance_columns(stream.sensor))
    if len(table.values) != len(stream):
        raise InputError(
            f"{path_text(path)}: has {len(table.values)} rows for {len(stream)} {stream.sensor} measurements; "
            "give one for each"
        )
    other = np.flatnonzero(table.values[:, 0] != stream.time)
    if other.size:
        row = int(other[0])
        raise table.error(
            row,
            f"time {float(table.values[row, 0])!r} s is that of no measurement, expected "
            f"{float(stream.time[row])!r} s",
        )
    covariance = _matrices(table, sensor_format(stream.sensor).dimension)
    try:
        return MeasurementStream(stream.sensor, stream.time, stream.values, stream.ids, covariance)
    except InputError as error:
        raise InputError(f"{path_text(path)}: {error}") from None


def _matrices(table: Table, dimension: int) -> Float[np.ndarray, "n d d"]:
    """Covariances of a checked table's rows. InputError: as `with_covariance`."""
    table.require(slice(1, None), ENTRY)
    rows, columns = np.tril_indices(dimension)
    covariance = np.empty((len(table.values), dimension, dimension))
    covariance[:, rows, columns] = covariance[:, columns, rows] = table.values[:, 1:]
    small = np.flatnonzero(np.diagonal(covariance, axis1=1, axis2=2).min(axis=1) < SMALLEST_VARIANCE)
    if small.size:
        raise table.error(
            int(small[0]), f"a variance is not positive or below {SMALLEST_VARIANCE:g}; correct it"
        )
    row = first_not_definite(covariance)
    if row is not None:
        raise table.error(row, "the covariance is not positive definite; give every component a variance")
    return covariance


def write_covariance(path: Path, stream: MeasurementStream) -> None:
    """Write the covariances of a stream that has them (the lower triangle). Atomic."""
    if stream.covariance is None:
        raise InputError(
            f"the {stream.sensor} stream has no covariance to write to {path_text(path)}; give it one"
        )
    rows, columns = np.tril_indices(sensor_format(stream.sensor).dimension)
    write_csv(path, covariance_columns(stream.sensor), [stream.time, *stream.covariance[:, rows, columns].T])
