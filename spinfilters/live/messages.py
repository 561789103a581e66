"""Arrays between the processes: length-prefixed npz over a socket that never blocks."""

import io
import socket
import struct
from collections import deque

import numpy as np

Message = dict[str, np.ndarray]
LENGTH = struct.Struct("<Q")
LARGEST = 1 << 30
MOST_WAITING = 1 << 26
"""Bytes that may wait to be sent: beyond it the other side does not read."""


class Channel:
    """One end of a connection.

    Parameters
    ----------
    connection: a stream socket, made non-blocking.
    """

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        self._socket = connection
        self._out: deque[memoryview] = deque()
        self._in = bytearray()
        self.closed = False

    @property
    def waiting(self) -> int:
        """Bytes that are not sent yet."""
        return sum(len(part) for part in self._out)

    def send(self, message: Message) -> None:
        """Queue a message; `pump` sends what cannot be sent at once."""
        buffer = io.BytesIO()
        np.savez(buffer, **message)  # pyright: ignore[reportArgumentType]
        data = buffer.getvalue()
        self._out += [memoryview(LENGTH.pack(len(data))), memoryview(data)]
        self.pump()

    def pump(self) -> None:
        """Send what can be sent without waiting."""
        while self._out and not self.closed:
            try:
                sent = self._socket.send(self._out[0])
            except BlockingIOError:
                return
            except OSError:
                self.closed = True
                return
            self._out[0] = self._out[0][sent:]
            if not len(self._out[0]):
                self._out.popleft()

    def received(self) -> list[Message]:
        """Messages that have come."""
        while not self.closed:
            try:
                data = self._socket.recv(1 << 20)
            except BlockingIOError:
                break
            except OSError:
                data = b""
            if not data:
                self.closed = True
            self._in += data
        found = []
        while (message := self._message()) is not None:
            found.append(message)
        return found

    def close(self) -> None:
        """End the connection."""
        self.closed = True
        self._socket.close()

    def fileno(self) -> int:
        """File number of the socket, for select."""
        return self._socket.fileno()

    def _message(self) -> Message | None:
        if len(self._in) < LENGTH.size:
            return None
        (size,) = LENGTH.unpack_from(self._in)
        if size > LARGEST:
            self.closed = True
            self._in.clear()
            return None
        if len(self._in) < LENGTH.size + size:
            return None
        data = bytes(self._in[LENGTH.size : LENGTH.size + size])
        del self._in[: LENGTH.size + size]
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            return dict(arrays)
