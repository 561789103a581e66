"""Record of a live run, thinned to bounded size for its figure."""

import numpy as np
from jaxtyping import Float

from spinfilters.live.answer import Answer
from spinfilters.plots.live_course import LiveCourse
from spinfilters.state.status import Verdict

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
