"""Answers of a live run as lines or TUM, their counts, and their course for the picture."""

import json
import queue
import threading
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TextIO

import numpy as np
from jaxtyping import Float

from spinfilters.live.kept_epochs import NO_VERDICT, FinalVerdict
from spinfilters.models.state_layout import Gaussian
from spinfilters.models.status import EstimatorStatus, Verdict
from spinfilters.plots.live_course import LiveCourse


@dataclass(frozen=True)
class Answer:
    """The estimate of an epoch.

    Attributes
    ----------
    time : float
        s.
    belief : Gaussian
        After its measurements.
    status : EstimatorStatus
        With reasons.
    source : str
        "filter", or "smoother" of a filter that continues a hand-over of the smoother.
    used, left_out : int
        Measurements.
    latency : float
        s from arrival.
    ahead : tuple[float, Gaussian] or None
        Predicted belief, with its time; None without.
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

    TUM (time, t, q_ig; of a rotation alone t is 0) with the verdict after #.
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
    """TUM, with standard deviations of position (m) and attitude (rad) and the verdict after #."""
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
    dropped
        Answers that were not written, because too many waited.
    broken : OSError | None
        Why nothing is written any more: the reader has gone, or the disk is full.
    """

    def __init__(self, style: str, stream: TextIO) -> None:
        self._style, self._stream = style, stream
        self._waiting: queue.Queue[Answer | None] = queue.Queue(MOST_WAITING)
        self.dropped = 0
        self.broken: OSError | None = None
        self._thread = threading.Thread(target=self._write_lines, daemon=True)
        self._thread.start()

    def write(self, answer: Answer) -> None:
        """Queue an answer for writing, without waiting.

        Raises
        ------
        OSError
            As `require_written`.
        """
        self.require_written()
        try:
            self._waiting.put_nowait(answer)
        except queue.Full:
            self.dropped += 1

    def require_written(self) -> None:
        """Raise what has stopped the writing, if anything has.

        Raises
        ------
        BrokenPipeError
            The reader has gone.
        OSError
            The answers cannot be written, as on a full disk.
        """
        if self.broken is not None:
            raise self.broken

    def close(self) -> None:
        """Write the queued answers, with a time limit."""
        with suppress(queue.Full):
            self._waiting.put(None, timeout=LAST_SECONDS)
        self._thread.join(LAST_SECONDS)
        self.dropped += max(self._waiting.qsize() - 1, 0) if self._thread.is_alive() else 0

    def _write_lines(self) -> None:
        while (answer := self._waiting.get()) is not None:
            try:
                write_answer(answer, self._style, self._stream)
            except ValueError:  # a stream that is closed
                self.broken = BrokenPipeError()
                return
            except OSError as error:
                self.broken = error
                return


@dataclass
class LiveSummary:
    """Counts and times of a run.

    Attributes
    ----------
    deadline : float
        s.
    latencies : list[float]
        s, of every answer, by the clock on the wall.
    work : list[float]
        s of the processor that it took.
    events : Counter[str]
        Of hand-overs, the smoother and losses, by name.
    final : FinalVerdict
        On the kept epochs, once the measurements have ended.
    """

    deadline: float
    latencies: list[float] = field(default_factory=list)
    work: list[float] = field(default_factory=list)
    events: Counter[str] = field(default_factory=Counter)
    final: FinalVerdict = NO_VERDICT

    @property
    def missed(self) -> int:
        """Answers after the deadline."""
        return sum(latency > self.deadline for latency in self.latencies)

    def document(self) -> dict[str, object]:
        """Counts and times for JSON."""
        return {
            "epochs": len(self.latencies),
            "deadline_ms": 1e3 * self.deadline,
            "deadlines_missed": self.missed,
            "latency_ms": _percentiles(self.latencies),
            "processor_ms": _percentiles(self.work),
            "events": dict(sorted(self.events.items())),
            "what_holds": self.final.document(),
        }

    def text(self) -> str:
        """Counts and times in a few lines."""
        document = self.document()
        events = ", ".join(f"{name} {count}" for name, count in sorted(self.events.items())) or "none"
        return (
            f"{document['epochs']} epochs answered, {self.missed} after the deadline of {1e3 * self.deadline:g} ms; "
            f"latency (ms) {document['latency_ms']}, of it at work {document['processor_ms']}\n"
            f"events: {events}\n{self.final.sentence}"
        )


def _percentiles(seconds: list[float]) -> dict[str, float | None]:
    """Percentiles in ms."""
    shares = (("median", 50), ("p99", 99), ("p99.9", 99.9), ("largest", 100))
    return {
        name: round(1e3 * float(np.percentile(seconds, share)), 3) if seconds else None
        for name, share in shares
    }


MOST_KEPT = 4000
"""Answers; where there are more, every other one goes and only every other one is kept from then on."""


class CourseRecorder:
    """Recorder of a run's answers, all or a share.

    A share of a long run; the slowest answer of each share is the one kept.
    """

    def __init__(self, deadline: float) -> None:
        self._deadline, self._stride, self._count = deadline, 1, 0
        self._rows: list[Float[np.ndarray, " 10"]] = []

    def keep(self, answer: Answer) -> None:
        """Record an answer."""
        layout, belief = answer.belief.layout, answer.belief
        rate, std = belief.mean[layout.mean_slice("w")], belief.std[layout.slice("w")]
        told = answer.time, answer.latency, answer.source == "smoother", answer.status.verdict == Verdict.OK
        row = np.concatenate([told, rate, std])
        if self._count % self._stride == 0:
            self._rows.append(row)
        elif row[1] > self._rows[-1][1]:
            self._rows[-1] = row
        self._count += 1
        if len(self._rows) >= MOST_KEPT:
            self._rows = [slower(*pair) for pair in zip(self._rows[::2], self._rows[1::2], strict=True)]
            self._stride *= 2

    def course(self) -> LiveCourse:
        """Answers that have been kept."""
        rows = np.array(self._rows).reshape(-1, 10)
        time, latency, smoothed, ok = rows[:, :4].T
        return LiveCourse(
            time, rows[:, 4:7], rows[:, 7:], latency, smoothed > 0, ok > 0, self._deadline, self._stride
        )


def slower(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The row of the answer that took longer."""
    return first if first[1] >= second[1] else second
