"""Chi-square tests of a filter's noise, per dimension of its state: measurements, each disturbance, whiteness.

A NIS of some hundred rows an epoch hides the dozen that the state is predicted in. So each update is split: with P- = F F' before
and P+ after it, d the correction of the mean, y = F^-1 d and K = 1 - F^-1 P+ F^-T,

    measurements   nis - |y|^2, expected dof - tr K: what no state explains,
    disturbance    y'D y, expected tr D K, D what its density has added to P- (`spinfilters.filters.noise_levels`),
    whiteness      the sum of y_k' y_k+1 over epochs, expected 0, variance tr K_k K_k+1.

A test's score is the excess over its standard deviation; the ratio is that of the variance seen to the stated one, to first order.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.filters.estimator import ProcessModel
from spinfilters.filters.history import EstimateHistory
from spinfilters.filters.square_root import lower_roots
from spinfilters.io.disturbances import NAMES, noise_columns
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.models.state_layout import Gaussian

MOST_EPOCHS: Final = 1500
"""That are tested, from a filter's first on."""
TOGETHER: Final = 256
"""Epochs whose arrays are in memory together."""
MEASUREMENTS: Final = "measurements"
TESTS: Final = (MEASUREMENTS, *NAMES)
"""Of the noise, in the order of an epoch's sums."""
COLUMNS: Final = 4
"""Sums of a test: seen, expected, information, and information by the measurements' noise."""
SMALLEST_RATIO: Final = 0.01
"""Ratio of variances that is reported: far below one the first order says nothing more."""


@dataclass(frozen=True)
class NoiseTest:
    """A sum of squares that a noise level explains.

    Attributes
    ----------
    seen, expected : float
        The sum, and its mean where the stated level is right.
    variance : float
        Variance of the sum at the stated level.
    information : float
        By how much its mean grows with the logarithm of the level's variance.
    by_measurements : float
        By how much its mean grows with the logarithm of the measurements' variance.
    """

    seen: float = 0.0
    expected: float = 0.0
    variance: float = 0.0
    information: float = 0.0
    by_measurements: float = 0.0

    @property
    def score(self) -> float:
        """Standard deviations that the sum is above its expectation; zero without information."""
        return (self.seen - self.expected) / np.sqrt(self.variance) if self.variance > 0 else 0.0

    @property
    def ratio(self) -> float:
        """Ratio of the variance seen to the stated one, to first order above it; the seen share below it."""
        if not self.information > 0:
            return 1.0
        if self.seen >= self.expected:
            return 1 + (self.seen - self.expected) / self.information
        return max(self.seen / self.expected, SMALLEST_RATIO)

    def beside(self, measurements: "NoiseTest") -> "NoiseTest":
        """Test of a disturbance together with measurements whose variance is identified.

        Where theirs says that it is larger, so are corrections, which are no disturbances; by how much is known to its chance.
        """
        if not measurements.information > 0:
            return self
        chance = measurements.variance / measurements.information**2
        return replace(
            self,
            expected=self.expected + self.by_measurements * max(measurements.ratio - 1, 0.0),
            variance=self.variance + self.by_measurements**2 * chance,
        )


@dataclass(frozen=True)
class FilterTests:
    """Chi-square tests over one filter's own epochs.

    Attributes
    ----------
    noise : Mapping[str, NoiseTest]
        By `MEASUREMENTS` or the source of a disturbance.
    correlation : float
        Sum of y_k' y_k+1.
    spread : float
        Variance of the correlation.
    length : float
        What the correlation would be of corrections that are all alike.
    """

    noise: Mapping[str, NoiseTest] = field(default_factory=dict)
    correlation: float = 0.0
    spread: float = 0.0
    length: float = 0.0

    @property
    def whiteness_score(self) -> float:
        """Standard deviations that the correlation is above zero."""
        return self.correlation / np.sqrt(self.spread) if self.spread > 0 else 0.0

    @property
    def autocorrelation(self) -> float:
        """Autocorrelation of the corrections of neighbouring epochs."""
        return self.correlation / self.length if self.length > 0 else 0.0


@dataclass(frozen=True)
class FilterEpoch:
    """An epoch of a filter.

    Attributes
    ----------
    before, after : Gaussian
        Belief after the epoch before, and after this one.
    dt : float
        Time between them, s.
    nis, dof : float
        NIS and its degrees of freedom, over all updates of the epoch.
    """

    before: Gaussian
    after: Gaussian
    dt: float
    nis: float
    dof: float


@dataclass(frozen=True)
class _Updates:
    """y, 1 - K and F of the updates of k epochs, each in its prediction's tangent space.

    reset leads from there to the tangent space of the mean. With the transition Phi and the noise factor N of the step before,
    entered is F^-1 N and moved F^-1 Phi.
    """

    y: Float[np.ndarray, "k n"]
    left: Float[np.ndarray, "k n n"]
    factor: Float[np.ndarray, "k n n"]
    reset: Float[np.ndarray, "k n n"]
    entered: Float[np.ndarray, "k n q"]
    moved: Float[np.ndarray, "k n n"]


class EpochTester:
    """Contribution of every epoch of a filter to its tests; epochs come in order, none left out.

    Parameters
    ----------
    process : ProcessModel
        Process model with the noise that the filter assumes.
    """

    def __init__(self, process: ProcessModel) -> None:
        self._process = process
        self._known: dict[str, np.ndarray] = {}
        self._latest: tuple[np.ndarray, np.ndarray] | None = None

    def take(self, epoch: FilterEpoch) -> Float[np.ndarray, "t 4"]:
        """`take_all` of one epoch."""
        return self.take_all([epoch])

    def take_all(self, epochs: Sequence[FilterEpoch]) -> Float[np.ndarray, "t 4"]:
        """Sums of one epoch or several for every one of `TESTS`, and the correlation with the epoch before.

        A row of each test holds the sum of squares, its expectation, its information and the information by the measurements'
        noise. The last row holds the correlation, its variance and its length.

        Raises
        ------
        numpy.linalg.LinAlgError, or what the process raises: numbers that lead nowhere.
        """
        updates, sums = _updates(self._process, epochs), no_sums()
        for source, columns in noise_columns(self._process.layout.blocks).items():
            sums[TESTS.index(source)] = self._of_motion(source, columns, updates)
        K = np.eye(updates.y.shape[1]) - updates.left
        for epoch, y, gain in zip(epochs, updates.y, K, strict=True):
            if epoch.dof > 0:
                sums[0, :3] += _of_measurements(epoch, y, gain)
            if self._latest is not None:
                before, last = self._latest
                sums[-1, :3] += y @ before, np.vdot(gain, last), _mean_trace(gain, last)
            self._latest = y, gain
        return sums

    def _of_motion(self, source: str, columns: slice, updates: _Updates) -> tuple[float, float, float, float]:
        G, S = updates.entered[:, :, columns], updates.reset @ updates.factor @ updates.left
        D, back = G @ G.swapaxes(1, 2), S.swapaxes(1, 2)
        known = self._known.get(source)
        # what a density has added to an epoch's covariance is moved on to the next one's, less what the update has taken off
        for k, moved in enumerate(updates.moved):
            if known is not None:
                D[k] += moved @ known @ moved.T
            known = S[k] @ D[k] @ back[k]
        if known is not None:
            self._known[source] = known
        share = D - D @ updates.left
        squared = np.einsum("ki,kij,kj->", updates.y, D, updates.y)
        expected, information = np.einsum("kii->", share), np.einsum("kij,kji->", share, share)
        return float(squared), float(expected), float(information), float(np.vdot(share, updates.left))


def no_sums() -> Float[np.ndarray, "t 4"]:
    """Sums over no epoch of what `EpochTester.take` gives."""
    return np.zeros((len(TESTS) + 1, COLUMNS))


def summed_tests(sums: Float[np.ndarray, "t 4"]) -> FilterTests:
    """Tests from sums over epochs of what `EpochTester.take` gives."""
    noise = {
        name: NoiseTest(seen, expected, 2 * information, information, by_measurements)
        for name, (seen, expected, information, by_measurements) in zip(
            TESTS, sums[:-1].tolist(), strict=True
        )
        if information > 0
    }
    return FilterTests(noise, *sums[-1, :3].tolist())


def filter_tests(
    history: EstimateHistory, process: TorqueFreeProcess, most: int = MOST_EPOCHS
) -> FilterTests:
    """Tests over a filter's own first epochs with the noise that it assumed.

    Parameters
    ----------
    most : int
        Epochs that are tested.

    Raises
    ------
    numpy.linalg.LinAlgError
        Numbers that lead nowhere.
    """
    begin = max(history.initialisation, 1)
    tester, sums = EpochTester(process), no_sums()
    beliefs = [
        Gaussian(history.layout, history.mean[k], history.factor[k])
        for k in range(begin - 1, min(len(history.time), begin + most))
    ]
    epochs = [
        FilterEpoch(
            before,
            after,
            float(history.time[k] - history.time[k - 1]),
            float(history.nis[k]),
            float(history.dof[k]),
        )
        for k, (before, after) in enumerate(pairwise(beliefs), start=begin)
    ]
    for first in range(0, len(epochs), TOGETHER):
        sums += tester.take_all(epochs[first : first + TOGETHER])
    return summed_tests(sums)


def _updates(process: ProcessModel, epochs: Sequence[FilterEpoch]) -> _Updates:
    """The beliefs refer to their own means: in the prediction's tangent space they have other factors."""
    layout = process.layout
    steps = [process.linearise(each.before.mean, each.dt) for each in epochs]
    predicted, transition, noise = (np.array(part) for part in zip(*steps, strict=True))
    before = np.array([each.before.factor for each in epochs])
    factor = lower_roots(np.concatenate([transition @ before, noise], axis=2))
    error = layout.local(predicted, np.array([each.after.mean for each in epochs]))
    reset = layout.reset_jacobian(error)
    at_prediction = np.linalg.solve(reset, np.array([each.after.factor for each in epochs]))
    n, q = error.shape[1], noise.shape[2]
    right = np.concatenate([at_prediction, transition, noise, error[..., np.newaxis]], axis=2)
    solved = np.linalg.solve(factor, right)
    own, moved, entered, y = np.split(solved, [n, 2 * n, 2 * n + q], axis=2)
    return _Updates(y[..., 0], own @ own.swapaxes(1, 2), factor, reset, entered, moved)


def _mean_trace(one: Float[np.ndarray, "n n"], other: Float[np.ndarray, "n n"]) -> float:
    """Geometric mean; rounding may leave a trace of nothing below zero."""
    return float(np.sqrt(max(np.trace(one), 0.0) * max(np.trace(other), 0.0)))


def _of_measurements(
    epoch: FilterEpoch, y: Float[np.ndarray, " n"], K: Float[np.ndarray, "n n"]
) -> tuple[float, float, float]:
    """Sum of squares, expectation and half the variance of what no state explains."""
    told = float(np.trace(K))
    return float(epoch.nis - y @ y), epoch.dof - told, max(epoch.dof - 2 * told + float(np.vdot(K, K)), 0.0)
