"""Measurements as they arrive: lines from a pipe, a socket or a growing file, or a recording replayed, grouped into epochs."""

import math
import os
import select
import socket
import sys
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from errno import EISDIR
from pathlib import Path
from time import monotonic

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.io.sensor_format import SensorFormat, sensor_called, sensor_format

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
    time : float
        s.
    streams : tuple[MeasurementStream, ...]
        One per sensor.
    at : float
        When it was complete, by the clock of `time.monotonic`, s.
    """

    time: float
    streams: tuple[MeasurementStream, ...]
    at: float = field(default_factory=monotonic)


@dataclass
class LineReader:
    """Epochs from lines.

    Attributes
    ----------
    sensors : tuple[str, ...]
        That are expected.
    losses : dict[str, int]
        What was not a measurement, by kind, counted.
    last : dict[str, str]
        The line of each kind seen last.
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
            self._count_lost("duplicate", text)
        elif len(self._rows) >= LARGEST_EPOCH:
            self._count_lost("too many lines of one time", text)
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
                self._count_lost("unusable", str(error))
        return ArrivedEpoch(rows[0].time, tuple(streams)) if streams else None

    def torn(self, text: str) -> None:
        """Count an incomplete line."""
        self._count_lost("torn line", text)

    def _row(self, text: str) -> Row | None:
        named, _, rest = text[:LONGEST_LINE].partition(",")
        sensor = sensor_called(named)
        if sensor not in self.sensors:
            self._count_lost("unknown sensor", text)
            return None
        form = sensor_format(sensor)
        parts = rest.split(",")
        wanted = 1 + form.has_landmarks + len(form.columns)
        if len(parts) != wanted or len(text) > LONGEST_LINE or not text.isascii() or "_" in rest:
            self.torn(text)
            return None
        return self._parse_row(form, parts, text)

    def _parse_row(self, form: SensorFormat, parts: list[str], text: str) -> Row | None:
        try:
            time, values = float(parts[0]), tuple(map(float, parts[1 + form.has_landmarks :]))
            landmark = int(parts[1]) if form.has_landmarks else None
        except ValueError:
            self.torn(text)
            return None
        if not all(map(math.isfinite, (time, *values))) or (landmark is not None and abs(landmark) >= 2**62):
            self._count_lost("not finite", text)
            return None
        return Row(form.name, time, values, landmark)

    def _count_lost(self, kind: str, text: str) -> None:
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


CHUNK = 1 << 16
SETTLED = 0.05
"""Seconds without a further line after which an epoch of lines counts as complete."""
POLL = 0.02
"""Seconds between two looks at a growing file."""
AT_ONCE = 1e-4
"""Seconds below which a look has found data that had waited."""


class Source(ABC):
    """Epochs as they arrive."""

    @abstractmethod
    def epochs(self) -> Iterator[ArrivedEpoch | None]:
        """Epochs in the order of arrival; None while nothing arrives."""

    @property
    def losses(self) -> dict[str, int]:
        """Number of lost lines and epochs, by kind."""
        return {}


class Replay(Source):
    """The epochs of a log at their own pace, ``speed`` times as fast."""

    def __init__(self, log: MeasurementLog, begin: float, speed: float = 1.0) -> None:
        self._log, self._begin, self._speed = log, begin, speed

    def epochs(self) -> Iterator[ArrivedEpoch | None]:
        """Epochs when they are due."""
        began = time.monotonic()
        for instant in self._log.times[self._log.times > self._begin].tolist():
            due = began + (instant - self._begin) / self._speed
            while (left := due - time.monotonic()) > 0:
                if left > 2e-3:
                    yield None
                    left = due - time.monotonic()
                time.sleep(max(0.0, min(left, 0.005)))
            yield ArrivedEpoch(instant, self._log.slice(instant, instant).streams, due)


class Lines(Source):
    """Lines from a file descriptor, such as a pipe or socket.

    Or a file that grows until nothing was added for ``patience`` seconds.
    An epoch has arrived when its last line has, whether or not anybody was looking then: where data waited to be read, it counts
    from when this was last looked for.
    """

    def __init__(
        self, descriptor: int, sensors: tuple[str, ...], grows: bool = False, patience: float = 5.0
    ) -> None:
        self._descriptor, self._grows, self._patience = descriptor, grows, patience
        self.reader = LineReader(sensors)
        self._own: Counter[str] = Counter()
        self._looked, self._arrived = time.monotonic(), 0.0

    @property
    def losses(self) -> dict[str, int]:
        """Lines and epochs that were lost, by kind."""
        return dict(Counter(self.reader.losses) + self._own)

    def epochs(self) -> Iterator[ArrivedEpoch | None]:
        """Epochs as their last line arrives."""
        self._looked = quiet = time.monotonic()
        rest = b""
        while True:
            data = self._read_chunk()
            if data == b"" and (not self._grows or time.monotonic() - quiet > self._patience):
                break
            if not data:
                settled = time.monotonic() - quiet > SETTLED and not rest
                yield self.reader.flush() if settled else None
                continue
            quiet = time.monotonic()
            *lines, rest = (rest + data).split(b"\n")
            if len(rest) > CHUNK:
                lines, rest = [*lines, rest], b""
            for line in lines:
                epoch = self.reader.feed(line.decode("utf-8", "replace"))
                if epoch is not None:
                    yield replace(epoch, at=self._arrived)
        if rest:  # how much of it is missing is unknown
            self.reader.torn(rest.decode("utf-8", "replace"))
        yield self.reader.flush()

    def _read_chunk(self) -> bytes | None:
        """Bytes that have come; empty at the end, None where nothing came in a moment."""
        begin = time.monotonic()
        try:
            if self._grows:
                return self._read_growth()
            ready, _, _ = select.select([self._descriptor], [], [], POLL)
            self._arrived = self._looked if time.monotonic() - begin < AT_ONCE else time.monotonic()
            return os.read(self._descriptor, CHUNK) if ready else None
        except OSError as error:
            self._own[f"input lost ({error.strerror or error})"] += 1
            return b""
        finally:
            self._looked = time.monotonic()

    def _read_growth(self) -> bytes:
        """Bytes by which a file has grown; from its beginning where it has become shorter."""
        data = os.read(self._descriptor, CHUNK)
        if not data and os.fstat(self._descriptor).st_size < os.lseek(self._descriptor, 0, os.SEEK_CUR):
            os.lseek(self._descriptor, 0, os.SEEK_SET)
            self._own["input cut short"] += 1
        if not data:
            time.sleep(POLL)
        self._arrived = self._looked
        return data


def open_lines(place: str, sensors: tuple[str, ...]) -> Lines:
    """Open a source of lines: standard input, socket, pipe or growing file.

    ``-``, ``tcp:HOST:PORT`` or ``unix:PATH`` (connected to), a named pipe, a path.

    Raises
    ------
    InputError
        Nothing is there.
    """
    if place == "-":
        return Lines(sys.stdin.fileno(), sensors)
    try:
        if place.startswith(("tcp:", "unix:")):
            connection = _connected(place)
            return Lines(connection.detach(), sensors)
        path = Path(place)
        if path.is_dir():
            raise IsADirectoryError(EISDIR, "it is a folder")
        return Lines(os.open(path, os.O_RDONLY), sensors, grows=path.is_file())
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise InputError(
            f"--input {place[:100]} cannot be opened ({why}); give -, tcp:HOST:PORT, unix:PATH or a file"
        ) from None


def _connected(place: str) -> socket.socket:
    kind, _, address = place.partition(":")
    if kind == "unix":
        connection = socket.socket(socket.AF_UNIX)
        connection.connect(address)
        return connection
    host, _, port = address.rpartition(":")
    return socket.create_connection((host, int(port)), timeout=5.0)
