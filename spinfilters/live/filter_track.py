"""The filter's last epochs with the state before each: for late measurements, and for hand-overs of the past."""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from spinfilters.errors import NUMERICAL_ERRORS
from spinfilters.estimators.estimator import Estimator, Snapshot, UpdateReport
from spinfilters.estimators.run import advance, finite
from spinfilters.estimators.timeline import Epoch
from spinfilters.state.gaussian import Gaussian


@dataclass(frozen=True)
class KeptEpoch:
    """An epoch and the filter's state after it."""

    frame: Epoch
    after: Snapshot

    @property
    def time(self) -> float:
        return self.frame.time


class FilterTrack:
    """A filter, and what it takes to go back.

    Every measurement is in the filter's state once: whoever goes back to an epoch does all later ones again, from that state.

    Parameters
    ----------
    estimator: started at ``time`` (s).   capacity: epochs that can be gone back, at least 1.
    """

    def __init__(self, estimator: Estimator, time: float, capacity: int = 100) -> None:
        self.estimator, self._capacity = estimator, capacity
        self._kept = [KeptEpoch(Epoch(time, ()), estimator.snapshot())]

    @property
    def time(self) -> float:
        """Of the latest epoch, s."""
        return self._kept[-1].time

    @property
    def oldest(self) -> float:
        """Time to which one can go back, s."""
        return self._kept[0].time

    @property
    def belief(self) -> Gaussian:
        """At the latest epoch."""
        return self.estimator.belief

    def has(self, time: float) -> bool:
        """Whether there is an epoch of this time."""
        index = bisect_right(self._kept, time, key=lambda kept: kept.time)
        return index > 0 and self._kept[index - 1].time == time

    def take(self, frame: Epoch) -> list[UpdateReport] | None:
        """Take in an epoch, at its place in time; None where it would have made the filter infinite and was left out.

        It must lie after `oldest` and at no epoch that is there.
        """
        index = bisect_right(self._kept, frame.time, key=lambda kept: kept.time)
        later = [kept.frame for kept in self._kept[index:]]
        if later:
            self.estimator.restore(self._kept[index - 1].after)
            del self._kept[index:]
        reports = self._advance(frame)
        for each in later:
            self._advance(each)
        del self._kept[: -self._capacity]
        return reports

    def belief_at(self, time: float) -> Gaussian:
        """What the filter believed after the epoch of this time, given measurements up to it."""
        self.estimator.restore(self._at(time).after)
        try:
            return self.estimator.belief
        finally:
            self.estimator.restore(self._kept[-1].after)

    def go_back(self, time: float) -> list[Epoch]:
        """Put the filter back after the epoch of this time; the epochs after it, which are now out."""
        index = bisect_right(self._kept, time, key=lambda kept: kept.time)
        later = [kept.frame for kept in self._kept[index:]]
        del self._kept[index:]
        self.estimator.restore(self._kept[-1].after)
        return later

    def resume(self, later: list[Epoch]) -> None:
        """Go on from what the filter has been made now, through these epochs."""
        self._kept[-1] = KeptEpoch(self._kept[-1].frame, self.estimator.snapshot())
        for frame in later:
            self._advance(frame)

    def _advance(self, frame: Epoch) -> list[UpdateReport] | None:
        """One epoch; where it breaks the filter, its time passes and its measurements are left out."""
        before = self._kept[-1]
        try:
            reports = advance(self.estimator, frame, frame.time - before.time)
            if not finite(self.estimator.belief, reports):
                raise FloatingPointError
        except (*NUMERICAL_ERRORS, FloatingPointError, np.linalg.LinAlgError):
            self.estimator.restore(before.after)
            return None
        self._kept.append(KeptEpoch(frame, self.estimator.snapshot()))
        return reports

    def _at(self, time: float) -> KeptEpoch:
        return self._kept[bisect_right(self._kept, time, key=lambda kept: kept.time) - 1]
