"""Measurements as lines: epochs, and what is lost."""

import numpy as np
import pytest

from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.live.sources import ArrivedEpoch, LineReader, lines_of


def fed(reader: LineReader, *lines: str) -> list[ArrivedEpoch]:
    found = [reader.feed(line) for line in lines]
    return [epoch for epoch in (*found, reader.flush()) if epoch is not None]


def test_lines_of_a_stream_are_read_back_to_the_same_bits() -> None:
    time = np.array([0.1, 0.1, 0.30000000000000004])
    stream = MeasurementStream("stereo", time, np.arange(9.0).reshape(3, 3) / 7 + 1, np.array([7, 3, 7]))
    first, second = fed(LineReader(("stereo",)), "# tracks", *lines_of(stream))
    assert (first.time, second.time) == (0.1, time[2])
    np.testing.assert_array_equal(first.streams[0].values, stream.values[[1, 0]])
    assert first.streams[0].ids is not None
    assert first.streams[0].ids.tolist() == [3, 7]


def test_an_empty_line_ends_an_epoch() -> None:
    reader = LineReader(("gyro",))
    assert reader.feed("gyro,1,0,0,1") is None
    epoch = reader.feed("")
    assert epoch is not None
    assert epoch.time == 1.0


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        ("gyro,1,0.1,0.", "torn line"),
        ("gyro,1,0.1,0.2,0.3e", "torn line"),
        ("gyro,1,0.1,nan,0.3", "not finite"),
        ("gyro,inf,0.1,0.2,0.3", "not finite"),
        ("lidar,1,0.1,0.2,0.3", "unknown sensor"),
        ("\x00\x01", "unknown sensor"),
        ("gyro," + "1" * 5000, "torn line"),
        ("gyro,0,0,0,1", "duplicate"),
    ],
)
def test_what_is_no_measurement_is_counted_and_survived(line: str, kind: str) -> None:
    reader = LineReader(("gyro",))
    epochs = fed(reader, "gyro,0,0,0,1", line, "gyro,2,0,0,1")
    assert [epoch.time for epoch in epochs] == [0.0, 2.0]
    assert reader.losses == {kind: 1}
