"""Lines from pipes, sockets and growing files: what breaks off, shrinks or waits."""

import os
import socket
import struct
import threading
import time
from pathlib import Path

import pytest

from spinfilters.core.errors import InputError
from spinfilters.live.sources import ArrivedEpoch, Lines, open_lines

LINE = b"gyro,%d,0.1,0.2,0.3\n"
SENSORS = ("gyro",)


def arrived(lines: Lines) -> list[ArrivedEpoch]:
    return [epoch for epoch in lines.epochs() if epoch is not None]


def piped(data: bytes) -> Lines:
    ours, theirs = os.pipe()
    os.write(theirs, data)
    os.close(theirs)
    return Lines(ours, SENSORS)


def test_a_last_line_without_its_end_is_torn_and_not_a_measurement() -> None:
    lines = piped(LINE % 1 + LINE % 2 + b"gyro,3,0.1,0.2,0.")
    assert [epoch.time for epoch in arrived(lines)] == [1.0, 2.0]
    assert lines.losses == {"torn line": 1}


@pytest.mark.parametrize("line", [b"gyro,1_0,0.1,0.2,0.3", "gyro,１,0.1,0.2,0.3".encode()])
def test_numbers_that_only_python_reads_are_torn(line: bytes) -> None:
    lines = piped(LINE % 1 + line + b"\n")
    assert len(arrived(lines)) == 1
    assert lines.losses == {"torn line": 1}


def test_a_byte_order_mark_and_ends_of_line_of_another_system_cost_nothing() -> None:
    lines = piped(b"\xef\xbb\xbf" + (LINE % 1 + LINE % 2).replace(b"\n", b"\r\n"))
    assert len(arrived(lines)) == 2
    assert not lines.losses


def test_a_connection_that_breaks_off_is_the_end_and_is_named() -> None:
    server = socket.create_server(("127.0.0.1", 0))
    lines = open_lines(f"tcp:127.0.0.1:{server.getsockname()[1]}", SENSORS)
    connection, _ = server.accept()
    connection.sendall(LINE % 1)
    found = lines.epochs()
    while next(found) is None:
        pass
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    connection.close()  # with a reset
    assert all(epoch is None for epoch in found)
    assert [name for name in lines.losses if name.startswith("input lost")]
    server.close()


def test_a_file_that_becomes_shorter_is_read_from_its_beginning(tmp_path: Path) -> None:
    path = tmp_path / "lines"
    path.write_bytes(LINE % 1 + LINE % 2 + LINE % 3)
    lines = Lines(os.open(path, os.O_RDONLY), SENSORS, grows=True, patience=0.4)
    threading.Timer(0.1, lambda: path.write_bytes(LINE % 7)).start()
    assert [epoch.time for epoch in arrived(lines)] == [1.0, 2.0, 3.0, 7.0]
    assert lines.losses == {"input cut short": 1}


def test_lines_that_waited_to_be_read_have_arrived_before() -> None:
    ours, theirs = os.pipe()
    lines = Lines(ours, SENSORS)
    found = lines.epochs()
    assert next(found) is None
    os.write(theirs, LINE % 1 + b"\n")
    time.sleep(0.05)  # the caller is busy
    epoch = next(found)
    assert epoch is not None
    assert time.monotonic() - epoch.at >= 0.05
    os.close(theirs)


def test_a_folder_is_no_input(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="it is a folder"):
        open_lines(str(tmp_path), SENSORS)
