"""Distinction of gaps between epochs from jumps of time that may be errors."""

import numpy as np

from spinfilters.live.line_format import ArrivedEpoch

REMEMBERED, FEWEST = 50, 5
"""Intervals that tell the usual one, and how many of them it takes."""
GAP, JUMP = 3.0, 30.0
"""In usual intervals: a gap is counted, a jump must be confirmed."""


class GapRule:
    """Rule for epochs far ahead: accepted once a second epoch confirms their time.

    Parameters
    ----------
    largest: seconds ahead that are believed at once, at most.
    """

    def __init__(self, largest: float) -> None:
        self._largest, self._intervals = largest, list[float]()
        self._held: ArrivedEpoch | None = None

    def jump(self, arrived: ArrivedEpoch, now: float) -> tuple[bool, ArrivedEpoch | None]:
        """Whether an epoch is held back, and the held one that it confirms."""
        before, self._held = self._held, None
        limit = min(self._largest, JUMP * self._usual)
        if arrived.time - now <= limit:
            return False, None
        if before is not None and 0 < arrived.time - before.time <= limit:
            return False, before
        self._held = arrived
        return True, None

    def passed(self, interval: float) -> bool:
        """Remember an interval (s); whether it is a gap."""
        gap = interval > GAP * self._usual
        self._intervals = [*self._intervals, interval][-REMEMBERED:]
        return gap

    @property
    def _usual(self) -> float:
        return float(np.median(self._intervals)) if len(self._intervals) >= FEWEST else np.inf
