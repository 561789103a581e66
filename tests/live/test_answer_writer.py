"""Answers that nobody reads."""

import errno
import io
import os
from contextlib import suppress

import pytest

from spinfilters.live.answer import MOST_WAITING, Answer, AnswerWriter
from spinfilters.models.status import EstimatorStatus
from tests.live.test_executive import started


def answer(time: float) -> Answer:
    return Answer(time, started().belief, EstimatorStatus(), "filter", 1, 0, 0.001)


def test_answers_are_written_in_their_order() -> None:
    stream = io.StringIO()
    writer = AnswerWriter("tum", stream)
    for k in range(5):
        writer.write(answer(float(k)))
    writer.close()
    assert [line.split()[0] for line in stream.getvalue().splitlines()] == [
        f"{k}.000000000" for k in range(5)
    ]
    assert not writer.dropped


def test_a_reader_who_stops_reading_costs_answers_and_never_time() -> None:
    ours, theirs = os.pipe()
    one = answer(1.0)
    with suppress(BrokenPipeError), os.fdopen(theirs, "w") as stream:  # closing writes what the stream holds
        writer = AnswerWriter("lines", stream)
        for _ in range(2 * MOST_WAITING):  # a pipe holds some dozens of them
            writer.write(one)
        assert writer.dropped > 0
        os.close(ours)


def test_a_full_disk_stops_the_writing_and_is_raised() -> None:
    class Full(io.StringIO):
        """A file on a full disk."""

        def flush(self) -> None:
            """Fail as the disk does."""
            raise OSError(errno.ENOSPC, "No space left on device")

    writer = AnswerWriter("lines", Full())
    writer.write(answer(1.0))
    writer.close()
    with pytest.raises(OSError, match="No space left"):
        writer.require_written()
    with pytest.raises(OSError, match="No space left"):
        writer.write(answer(2.0))
