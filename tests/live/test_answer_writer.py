"""Answers that nobody reads."""

import io
import os
from contextlib import suppress

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
