"""Sensor tables of a data set folder, read and written as their format says."""

from pathlib import Path

from spinfilters.data.measurement_log import MeasurementStream, first_repeated_landmark
from spinfilters.data.pose_files import require_unit_quaternions
from spinfilters.data.sensor_format import SensorFormat
from spinfilters.data.table_files import read_csv, write_csv
from spinfilters.data.time_stamps import require_times


def read_sensor_file(form: SensorFormat, path: Path) -> MeasurementStream:
    """Stream of a sensor's table, without covariances.

    Raises
    ------
    InputError: as `read_csv` and `require_times`; a value out of its range, a quaternion that is not a unit one, a
    landmark twice at one time; what a check or reader of the sensor's own raises.
    """
    if form.read is not None:
        return form.read(path)
    table = read_csv(path, form.header)
    require_times(table, repeats=form.many_rows_an_epoch)
    first = len(form.header) - len(form.columns)
    table.require(slice(first, None), form.allowed)
    time, ids = table.values[:, 0], table.landmark_ids(1) if form.has_landmarks else None
    if form.quaternion is not None:
        require_unit_quaternions(table, first + form.quaternion)
    row = None if ids is None else first_repeated_landmark(time, ids)
    if ids is not None and row is not None:
        raise table.error(row, f"landmark {ids[row]} occurs twice at {float(time[row])!r} s; keep one line")
    if form.check is not None:
        form.check(table)
    return MeasurementStream(form.name, time, table.values[:, first:], ids)


def write_sensor_file(form: SensorFormat, path: Path, stream: MeasurementStream) -> None:
    """Write a stream so that reading gives the same bits, without its covariances. Atomic."""
    if form.write is not None:
        form.write(path, stream)
        return
    ids = [] if stream.ids is None else [stream.ids]
    write_csv(path, form.header, [stream.time, *ids, *stream.values.T])
