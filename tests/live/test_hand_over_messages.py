"""Messages of the smoother's process: one that is damaged ends the process, and no exception leaves the executive."""

import io
import socket
import struct
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from typing import cast

import numpy as np
import pytest

from spinfilters.live.smoother_process import Channel, SmootherSupervisor, SupervisionOptions
from spinfilters.models.state_layout import StateLayout


@dataclass
class Running:
    """A process that runs."""

    exitcode: int | None = None

    def is_alive(self) -> bool:
        return True

    def kill(self) -> None:
        """Nothing to end."""

    def join(self, timeout: float) -> None:
        """Nothing to wait for."""


def whole() -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, time=np.array(1.0))
    return buffer.getvalue()


def flipped() -> bytes:
    """A message with one wrong bit in its array."""
    data = bytearray(whole())
    data[60] ^= 1
    return bytes(data)


@pytest.mark.parametrize(
    "message", [b"", whole()[:-30], b"abcdefgh", flipped()], ids=["empty", "cut", "text", "bit"]
)
def test_a_damaged_message_ends_the_smoother(message: bytes) -> None:
    ours, theirs = socket.socketpair()
    supervisor = SmootherSupervisor(StateLayout(("a", "w", "s")), {}, SupervisionOptions())
    supervisor._channel, supervisor._process = Channel(ours), cast(BaseProcess, Running())
    with theirs:
        theirs.send(struct.pack("<Q", len(message)) + message)
    found = supervisor.hand_overs()
    supervisor.close()
    assert found == []
    assert supervisor.events["smoother broken"] == 1
    assert supervisor.trouble.startswith("it sent what is no hand-over")
