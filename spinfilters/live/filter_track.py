"""Filter with a past: it takes late measurements in their place and begins again from a hand-over."""

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spinfilters.core.errors import NUMERICAL_ERRORS
from spinfilters.filters.estimator import Belief, Estimator, Snapshot, UpdateReport
from spinfilters.filters.timeline import Epoch, advance, finite
from spinfilters.models.state_layout import Gaussian


@dataclass(frozen=True)
class KeptEpoch:
    """An epoch and the filter's state after it."""

    frame: Epoch
    after: Snapshot

    @property
    def time(self) -> float:
        """Time of the epoch, s."""
        return self.frame.time


class FilterTrack:
    """A filter, and what it takes to go back.

    Every measurement is in the filter's state once: whoever goes back to an epoch does all later ones again, from that state.

    Parameters
    ----------
    estimator : Estimator
        Started at ``time`` (s).
    capacity : int
        Epochs that can be gone back, at least 1.
    """

    def __init__(self, estimator: Estimator, time: float, capacity: int = 100) -> None:
        self.estimator, self._capacity = estimator, capacity
        self._kept = [KeptEpoch(Epoch(time, ()), estimator.snapshot())]
        self._rebased: list[KeptEpoch] = []

    @property
    def time(self) -> float:
        """Time of the latest epoch, s."""
        return self._kept[-1].time

    @property
    def oldest(self) -> float:
        """Time to which one can go back, s."""
        return self._kept[0].time

    @property
    def belief(self) -> Gaussian:
        """Belief at the latest epoch."""
        return self.estimator.belief

    def has(self, time: float) -> bool:
        """Whether there is an epoch of this time."""
        index = bisect_right(self._kept, time, key=lambda kept: kept.time)
        return index > 0 and self._kept[index - 1].time == time

    def take(self, frame: Epoch) -> list[UpdateReport] | None:
        """Update with an epoch at its time; None where it was left out as not finite.

        It must lie after `oldest` and at no epoch that is there.
        """
        index = bisect_right(self._kept, frame.time, key=lambda kept: kept.time)
        later = [kept.frame for kept in self._kept[index:]]
        if later:
            self.estimator.restore(self._kept[index - 1].after)
            del self._kept[index:]
        if self._rebased and frame.time <= self._rebased[-1].time:
            self._rebased = []  # it did not know of this epoch; the next hand-over will
        reports = self._advance(self._kept, frame)
        for each in later:
            self._advance(self._kept, each)
        del self._kept[: -self._capacity]
        return reports

    def belief_at(self, time: float) -> Gaussian:
        """Filter's belief after the epoch of this time, given measurements up to it."""
        self.estimator.restore(self._at(time).after)
        try:
            return self.estimator.belief
        finally:
            self.estimator.restore(self._kept[-1].after)

    def begin_rebase(self, time: float, begin: Callable[[Estimator], None]) -> None:
        """Restart the filter at a past epoch, in steps by `rebase_step`.

        Raises
        ------
        InputError, or one of `NUMERICAL_ERRORS`
            What is begun from does not fit; nothing has changed.
        """
        at = self._at(time)
        try:
            self.estimator.restore(at.after)
            begin(self.estimator)
            self._rebased = [KeptEpoch(at.frame, self.estimator.snapshot())]
        finally:
            self.estimator.restore(self._kept[-1].after)

    @property
    def is_rebasing(self) -> bool:
        """Whether there is something to catch up with."""
        return bool(self._rebased)

    def rebase_step(self) -> bool:
        """Take the filter that began anew one epoch further; whether it is now the filter.

        One epoch at a time, so that an answer never waits for more. Every measurement is in its state once: those up to where it
        began are in what it began from, later ones come in here.
        """
        behind = [kept.frame for kept in self._kept if kept.time > self._rebased[-1].time]
        if behind:
            self.estimator.restore(self._rebased[-1].after)
            if self._advance(self._rebased, behind[0]) is None:
                self._rebased = []  # the filter that answers came through this epoch
            if len(behind) > 1 or not self._rebased:
                self.estimator.restore(self._kept[-1].after)
                return False
        begun = self._rebased[0].time
        self._kept = [*(kept for kept in self._kept if kept.time < begun), *self._rebased]
        self._rebased = []
        self.estimator.restore(self._kept[-1].after)
        return True

    def _advance(self, kept: list[KeptEpoch], frame: Epoch) -> list[UpdateReport] | None:
        """Track with one more epoch, without its measurements where they break the filter."""
        before = kept[-1]
        try:
            reports = advance(self.estimator, frame, frame.time - before.time)
            if not finite(self.estimator.belief, reports):
                raise FloatingPointError
        except (*NUMERICAL_ERRORS, FloatingPointError, np.linalg.LinAlgError):
            self.estimator.restore(before.after)
            return None
        kept.append(KeptEpoch(frame, self.estimator.snapshot()))
        return reports

    def _at(self, time: float) -> KeptEpoch:
        return self._kept[bisect_right(self._kept, time, key=lambda kept: kept.time) - 1]


@dataclass(frozen=True)
class HandOver:
    """Smoothed belief of an epoch, handed over to the filter.

    Attributes
    ----------
    time : float
        s.
    belief : Belief
        Of the state, with landmarks where it holds some.
    verdict : str
        Of the smoother's status.
    """

    time: float
    belief: Belief
    verdict: str = "ok"

    @property
    def state(self) -> Gaussian:
        """State of the epoch, frame g."""
        return self.belief.state

    @property
    def is_finite(self) -> bool:
        """Whether means and covariances can be used."""
        arrays = [self.belief.mean, self.belief.factor]
        joint = self.belief.joint
        if joint is not None:
            arrays += [joint.points, joint.modes, joint.roots]
        return all(np.isfinite(array).all() for array in arrays) and bool((self.state.std > 0).all())


def distance(one: Gaussian, other: Gaussian) -> float:
    """Squared Mahalanobis distance per component, the two covariances added.

    Small for estimates from shared measurements. Errors of both are told about the one.
    """
    d = one.layout.local(one.mean, other.mean)
    factor = np.hstack([one.factor, np.linalg.solve(one.layout.reset_jacobian(d), other.factor)])
    scale = np.linalg.norm(factor, axis=1)
    factor /= scale[:, np.newaxis]
    return float((d / scale) @ np.linalg.solve(factor @ factor.T, d / scale)) / len(d)
