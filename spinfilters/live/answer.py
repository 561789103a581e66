"""Answer of a live run to an epoch, and its text formats.

Answers are written in a thread of their own: a slow reader blocks no filter.
"""

import json
import queue
import threading
from contextlib import suppress
from dataclasses import dataclass
from typing import TextIO

import numpy as np

from spinfilters.state.gaussian import Gaussian
from spinfilters.state.status import EstimatorStatus

FORMATS = ("lines", "tum")


@dataclass(frozen=True)
class Answer:
    """The estimate of an epoch.

    Attributes
    ----------
    time: s.   belief: after its measurements.   status: with reasons.
    source: "filter", or "smoother" of a filter that stands on a smoothed past.   used, left_out: measurements.
    latency: s from arrival.   ahead: predicted belief, with its time; None without.
    """

    time: float
    belief: Gaussian
    status: EstimatorStatus
    source: str
    used: int
    left_out: int
    latency: float
    ahead: tuple[float, Gaussian] | None = None


def write_answer(answer: Answer, style: str, stream: TextIO) -> None:
    """Write an answer as one line, JSON or TUM.

    TUM (time, t, q_ig; of a rotation alone t is 0) with the verdict behind #.
    """
    stream.write((tum_line if style == "tum" else json_line)(answer) + "\n")
    stream.flush()


def json_line(answer: Answer) -> str:
    """The whole answer as one JSON object.

    The covariance is that of the error, its lower triangle row by row.
    """
    document = {
        "time": answer.time,
        **_belief(answer.belief),
        "verdict": str(answer.status.verdict),
        "reasons": list(answer.status.reasons),
        "source": answer.source,
        "used": answer.used,
        "left_out": answer.left_out,
        "latency_ms": round(1e3 * answer.latency, 3),
    }
    if answer.ahead is not None:
        document["ahead"] = {"time": answer.ahead[0], **_belief(answer.ahead[1])}
    return json.dumps(document, allow_nan=False)


def tum_line(answer: Answer) -> str:
    """TUM, with standard deviations of position (m) and attitude (rad) and the verdict behind #."""
    layout, belief = answer.belief.layout, answer.belief
    q = belief.mean[layout.mean_slice("a")]
    t = belief.mean[layout.mean_slice("t")] if layout.translates else np.zeros(3)
    std = belief.std
    spread = (
        std[layout.slice("a")] if not layout.translates else np.concatenate([std[:3], std[layout.slice("a")]])
    )
    numbers = " ".join(f"{value:.9g}" for value in (*t, *q))
    return f"{answer.time:.9f} {numbers} # {answer.status.verdict} std {' '.join(f'{value:.3g}' for value in spread)}"


def _belief(belief: Gaussian) -> dict[str, object]:
    layout, P = belief.layout, belief.covariance
    state = {block.symbol: belief.mean[layout.mean_slice(block.name)].tolist() for block in layout.members}
    return {**state, "covariance": P[np.tril_indices(len(P))].tolist()}


MOST_WAITING = 1000
"""Answers that may wait to be read; what comes after that is not written."""
LAST_SECONDS = 2.0
"""For the answers that still wait in the end."""


class AnswerWriter:
    """Writes answers in their order.

    Attributes
    ----------
    dropped: answers that were not written, because too many waited.   broken: whether nobody reads any more.
    """

    def __init__(self, style: str, stream: TextIO) -> None:
        self._style, self._stream = style, stream
        self._waiting: queue.Queue[Answer | None] = queue.Queue(MOST_WAITING)
        self.dropped, self.broken = 0, False
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def write(self, answer: Answer) -> None:
        """Queue an answer for writing, without waiting.

        Raises
        ------
        BrokenPipeError: nobody reads any more.
        """
        if self.broken:
            raise BrokenPipeError
        try:
            self._waiting.put_nowait(answer)
        except queue.Full:
            self.dropped += 1

    def close(self) -> None:
        """Write the queued answers, with a time limit."""
        with suppress(queue.Full):
            self._waiting.put(None, timeout=LAST_SECONDS)
        self._thread.join(LAST_SECONDS)
        self.dropped += max(self._waiting.qsize() - 1, 0) if self._thread.is_alive() else 0

    def _work(self) -> None:
        while (answer := self._waiting.get()) is not None:
            try:
                write_answer(answer, self._style, self._stream)
            except (BrokenPipeError, ValueError):
                self.broken = True
                return
