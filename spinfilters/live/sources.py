"""Sources of epochs: replayed data sets, growing files, pipes, sockets."""

import os
import select
import socket
import sys
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from errno import EISDIR
from pathlib import Path

from spinfilters.data.measurement_log import MeasurementLog
from spinfilters.errors import InputError
from spinfilters.live.line_format import ArrivedEpoch, LineReader

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
            data = self._read()
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
        if rest:  # nobody knows how much of it is missing
            self.reader.torn(rest.decode("utf-8", "replace"))
        yield self.reader.flush()

    def _read(self) -> bytes | None:
        """Bytes that have come; empty at the end, None where nothing came in a moment."""
        begin = time.monotonic()
        try:
            if self._grows:
                return self._grown()
            ready, _, _ = select.select([self._descriptor], [], [], POLL)
            self._arrived = self._looked if time.monotonic() - begin < AT_ONCE else time.monotonic()
            return os.read(self._descriptor, CHUNK) if ready else None
        except OSError as error:
            self._own[f"input lost ({error.strerror or error})"] += 1
            return b""
        finally:
            self._looked = time.monotonic()

    def _grown(self) -> bytes:
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
    InputError: nothing is there.
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
