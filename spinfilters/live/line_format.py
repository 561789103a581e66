"""Measurements as lines of text: ``sensor,time_s,columns...``, the columns of the sensor's table in a data set.

A line of stereo tracks is ``stereo,12.5,417,320.1,240.2,300.1`` (landmark, u left, v left, u right), one of poses
``pose,12.5,tx,ty,tz,qx,qy,qz,qw``, one of a gyro ``gyro,12.5,wx,wy,wz``. An epoch is all lines of one time; it is complete when a
line of another time comes, an empty line, or nothing for a while. What begins with # is not read.
"""

import math
from dataclasses import dataclass, field
from time import monotonic

import numpy as np

from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.sensor_format import SensorFormat, sensor_format
from spinfilters.errors import InputError

LONGEST_LINE = 1000
"""Characters; what is longer is no measurement."""
LARGEST_EPOCH = 50_000
"""Lines; a sender whose time stands still must not fill the memory."""
BYTE_ORDER_MARK = "\ufeff"


@dataclass(frozen=True)
class Row:
    """One measured value: landmark is None of a sensor without landmarks."""

    sensor: str
    time: float
    values: tuple[float, ...]
    landmark: int | None = None


@dataclass(frozen=True)
class ArrivedEpoch:
    """All measurements of one instant that arrived.

    Attributes
    ----------
    time: s.   streams: one per sensor.   at: when it was complete, by the clock of `time.monotonic`, s.
    """

    time: float
    streams: tuple[MeasurementStream, ...]
    at: float = field(default_factory=monotonic)


@dataclass
class LineReader:
    """Epochs from lines.

    Attributes
    ----------
    sensors: that are expected.   losses: what was not a measurement, by kind, counted.   last: the line of each kind seen last.
    """

    sensors: tuple[str, ...]
    losses: dict[str, int] = field(default_factory=dict)
    last: dict[str, str] = field(default_factory=dict)
    _rows: dict[tuple[str, int | None], Row] = field(default_factory=dict)

    def feed(self, line: str) -> ArrivedEpoch | None:
        """Take in a line; the epoch that it completes, if any."""
        text = line.removeprefix(BYTE_ORDER_MARK).strip()
        if not text:
            return self.flush()
        if text.startswith("#"):
            return None
        row = self._row(text)
        if row is None:
            return None
        done = None
        if self._rows and row.time != self.time:
            done = self.flush()
        key = row.sensor, row.landmark
        if key in self._rows:
            self._lost("duplicate", text)
        elif len(self._rows) >= LARGEST_EPOCH:
            self._lost("too many lines of one time", text)
        else:
            self._rows[key] = row
        return done

    @property
    def time(self) -> float | None:
        """Time of the epoch that is being read, s."""
        return next(iter(self._rows.values())).time if self._rows else None

    def flush(self) -> ArrivedEpoch | None:
        """The epoch that is being read, complete or not."""
        rows, self._rows = list(self._rows.values()), {}
        streams = []
        for sensor in dict.fromkeys(row.sensor for row in rows):
            try:
                streams.append(_stream(sensor, [row for row in rows if row.sensor == sensor]))
            except InputError as error:
                self._lost("unusable", str(error))
        return ArrivedEpoch(rows[0].time, tuple(streams)) if streams else None

    def torn(self, text: str) -> None:
        """Count an incomplete line."""
        self._lost("torn line", text)

    def _row(self, text: str) -> Row | None:
        sensor, _, rest = text[:LONGEST_LINE].partition(",")
        if sensor not in self.sensors:
            self._lost("unknown sensor", text)
            return None
        form = sensor_format(sensor)
        parts = rest.split(",")
        wanted = 1 + form.has_landmarks + len(form.columns)
        if len(parts) != wanted or len(text) > LONGEST_LINE or not text.isascii() or "_" in rest:
            self.torn(text)
            return None
        return self._parsed(form, parts, text)

    def _parsed(self, form: SensorFormat, parts: list[str], text: str) -> Row | None:
        try:
            time, values = float(parts[0]), tuple(map(float, parts[1 + form.has_landmarks :]))
            landmark = int(parts[1]) if form.has_landmarks else None
        except ValueError:
            self.torn(text)
            return None
        if not all(map(math.isfinite, (time, *values))) or (landmark is not None and abs(landmark) >= 2**62):
            self._lost("not finite", text)
            return None
        return Row(form.name, time, values, landmark)

    def _lost(self, kind: str, text: str) -> None:
        self.losses[kind] = self.losses.get(kind, 0) + 1
        self.last[kind] = text[:80]


def lines_of(stream: MeasurementStream) -> list[str]:
    """Rows of a stream as lines."""
    ids = [""] * len(stream) if stream.ids is None else [f",{key}" for key in stream.ids.tolist()]
    return [
        f"{stream.sensor},{time!r}{key}," + ",".join(map(repr, values))
        for time, key, values in zip(stream.time.tolist(), ids, stream.values.tolist(), strict=True)
    ]


def _stream(sensor: str, rows: list[Row]) -> MeasurementStream:
    keys = [row.landmark for row in rows]
    ids = None if keys[0] is None else np.array(keys, dtype=np.int64)
    order = np.arange(len(rows)) if ids is None else np.argsort(ids)
    values = np.array([row.values for row in rows])[order]
    return MeasurementStream(
        sensor, np.array([row.time for row in rows]), values, None if ids is None else ids[order]
    )
