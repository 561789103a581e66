"""Verdict of a live run from the innovations of its latest epochs."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.core.chi_square import chi_square_tail
from spinfilters.core.errors import NUMERICAL_ERRORS
from spinfilters.evaluation.noise_tests import EpochTester, FilterEpoch, NoiseTest, no_sums, summed_tests
from spinfilters.filters.estimator import ProcessModel, UpdateReport
from spinfilters.filters.noise_levels import SOURCES
from spinfilters.verdict.check import LARGEST_NIS, LARGEST_REJECTED
from spinfilters.verdict.noise_diagnostics import LARGEST_RATIO

WINDOW = 60
"""Measured epochs that are tested together, beside all since the filter was last believed."""
FALSE_ALARM = 1e-9
"""Probability of a test's sum where all is well: it is looked at after every epoch of a run without an end."""


@dataclass(frozen=True)
class _Counts:
    """Counts of one or several epochs.

    NIS and its degrees of freedom, measurements left out, all of them.
    """

    nis: float
    dof: float
    left_out: int
    measured: int


class RunningVerdict:
    """Doubts about a filter that answers.

    Measurements that are left out do no harm once they are over. Innovations that the noise does not explain have changed the
    estimate, its constants too: that doubt stays until the filter stands on a smoothed past that never was in doubt.

    Parameters
    ----------
    process : ProcessModel
        With the noise that the filter was told.
    """

    def __init__(self, process: ProcessModel) -> None:
        self._process, self._tester = process, EpochTester(process)
        self._counts: deque[_Counts] = deque(maxlen=WINDOW)
        self._sums: deque[Float[np.ndarray, "t 4"]] = deque(maxlen=WINDOW)
        self._all = no_sums()
        self._lasting, self._passing = "", ""
        self._last_bad = -np.inf

    @property
    def reasons(self) -> list[str]:
        """Why the present estimate is in doubt."""
        return [reason for reason in (self._lasting, self._passing) if reason]

    @property
    def is_believed(self) -> bool:
        """Whether no doubt about the filter's own past remains."""
        return not self._lasting

    def take(self, epoch: FilterEpoch, reports: Sequence[UpdateReport], time: float) -> None:
        """Test an epoch (time s) with measurements."""
        self._counts.append(_counts(epoch, reports))
        with np.errstate(all="ignore"):
            try:
                sums = self._tester.take(epoch)
            except NUMERICAL_ERRORS:
                self._doubt("the filter's covariance could not be tested", time)
                return
        self._sums.append(sums)
        self._all += sums
        self._passing = _left_out(self._counts)
        found = _innovations(self._counts) or _noise(np.sum(self._sums, axis=0), len(self._sums))
        if found:
            self._doubt(found, time)
        elif not self._lasting and (slow := _noise(self._all, 0)):
            self._doubt(slow, time)

    def rebased(self, time: float, is_believed: bool) -> None:
        """Restart the tests after a rebase of the filter.

        The filter now begins from a time (s), by a smoother that is believed or not.
        """
        self._tester = EpochTester(self._process)
        if self._lasting and is_believed and time > self._last_bad:
            self._lasting, self._all = "", np.zeros_like(self._all)
            self._sums.clear()
            self._counts.clear()

    def _doubt(self, why: str, time: float) -> None:
        self._last_bad = time
        if not self._lasting:
            self._lasting = f"from t = {time:.3f} s on: {why}"


def _counts(epoch: FilterEpoch, reports: Sequence[UpdateReport]) -> _Counts:
    """Counts of an epoch's update.

    Landmarks that were made anew because they were not where the map had them count as left out.
    """
    anew = sum(
        int(np.isin(report.map_change.removed, report.map_change.added).sum())
        for report in reports
        if report.map_change is not None
    )
    rejected = sum(report.rejected for report in reports)
    measured = rejected + sum(report.accepted for report in reports)
    return _Counts(epoch.nis, epoch.dof, rejected + anew, measured)


def _left_out(counts: Sequence[_Counts]) -> str:
    left_out, measured = sum(each.left_out for each in counts), sum(each.measured for each in counts)
    if left_out <= LARGEST_REJECTED * measured:
        return ""
    return f"{left_out} of {measured} measurements of the last {len(counts)} epochs could not be used or were not believed"


def _innovations(counts: Sequence[_Counts]) -> str:
    nis, dof = sum(each.nis for each in counts), sum(each.dof for each in counts)
    if nis <= LARGEST_NIS * dof or chi_square_tail(nis, dof) > FALSE_ALARM:
        return ""
    return f"innovations of {len(counts)} epochs are {nis / dof:.3g} times as large (squared) as the noise explains"


def _noise(sums: Float[np.ndarray, "t 4"], epochs: int) -> str:
    """About the level that the data contradict most."""
    by_chance = {name: (chance(test), test) for name, test in summed_tests(sums).noise.items()}
    if not by_chance:
        return ""
    name, (probability, test) = min(by_chance.items(), key=lambda item: item[1][0])
    if probability > FALSE_ALARM or test.ratio <= LARGEST_RATIO:
        return ""
    what = f"disturbances of the {name}" if name in SOURCES else "errors of measurements"
    when = f"the last {epochs} epochs" if epochs else "all epochs"
    return f"{what} in {when} are {np.sqrt(test.ratio):.2g} times as large as their noise explains"


def chance(test: NoiseTest) -> float:
    """Tail probability of a sum of squares.

    It is that of the scaled chi-square distribution with its mean and variance.
    """
    if not (test.variance > 0 and test.expected > 0):
        return 1.0
    scale = test.variance / (2 * test.expected)
    return float(chi_square_tail(test.seen / scale, test.expected / scale))
