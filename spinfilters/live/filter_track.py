"""Filter of a live run: it takes late epochs in their place, and begins again from a smoothed belief of the past."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spinfilters.filters.estimator import Belief, Estimator, UpdateReport
from spinfilters.filters.late_measurements import BrokenEstimateError, EpochTrack, KeptEpoch, advance_by
from spinfilters.filters.timeline import Epoch
from spinfilters.models.state_layout import Gaussian


class FilterTrack(EpochTrack):
    """A filter with its latest epochs that a hand-over of the smoother can begin anew.

    Parameters
    ----------
    estimator : Estimator
        Started at ``time`` (s).
    capacity : int
        Epochs that can be gone back, at least 1.
    """

    def __init__(self, estimator: Estimator, time: float, capacity: int = 100) -> None:
        super().__init__(estimator, time)
        self._capacity = capacity
        self._rebased: list[KeptEpoch] = []

    def has(self, time: float) -> bool:
        """Whether there is an epoch of this time."""
        return time == self.oldest or self.epoch_at(time) is not None

    def take(self, epoch: Epoch) -> list[UpdateReport] | None:
        """Update with an epoch at its time; None where it was left out as the estimate would not have stayed finite.

        It must lie after `oldest` and at no epoch that is there.
        """
        if self._rebased and epoch.time <= self._rebased[-1].time:
            self._rebased = []  # it did not know of this epoch; the next hand-over will
        try:
            placed = self.place(epoch)
        except BrokenEstimateError:
            return None
        self.forget(len(self) + 1 - self._capacity)
        return placed.reports

    def belief_at(self, time: float) -> Gaussian:
        """Filter's belief after the epoch of this time, given measurements up to it."""
        self.estimator.restore(self._kept_at(time).after)
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
        at = self._kept_at(time)
        try:
            self.estimator.restore(at.after)
            begin(self.estimator)
            self._rebased = [KeptEpoch(at.epoch, self.estimator.snapshot())]
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
        behind = [kept.epoch for kept in self._kept if kept.time > self._rebased[-1].time]
        if behind:
            self.estimator.restore(self._rebased[-1].after)
            try:
                self._rebased.append(advance_by(self.estimator, self._rebased[-1].time, behind[0])[0])
            except BrokenEstimateError:
                self._rebased = []  # the filter that answers came through this epoch
            if len(behind) > 1 or not self._rebased:
                self.estimator.restore(self._kept[-1].after)
                return False
        begun = self._rebased[0].time
        self._kept = [*(kept for kept in self._kept if kept.time < begun), *self._rebased]
        self._rebased = []
        self.estimator.restore(self._kept[-1].after)
        return True

    def _kept_at(self, time: float) -> KeptEpoch:
        """The latest epoch that is not after a time."""
        return next(kept for kept in reversed(self._kept) if kept.time <= time)


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

    Small for estimates from shared measurements. Errors of both refer to the one.
    """
    d = one.layout.local(one.mean, other.mean)
    factor = np.hstack([one.factor, np.linalg.solve(one.layout.reset_jacobian(d), other.factor)])
    scale = np.linalg.norm(factor, axis=1)
    factor /= scale[:, np.newaxis]
    return float((d / scale) @ np.linalg.solve(factor @ factor.T, d / scale)) / len(d)
