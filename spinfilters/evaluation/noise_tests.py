"""Chi-square tests of a filter's noise, per dimension of its state: measurements, each disturbance, whiteness.

A NIS of some hundred rows an epoch hides the dozen that the state is predicted in. So each update is split: with P- = F F' before
and P+ after it, d the correction of the mean, y = F^-1 d and K = 1 - F^-1 P+ F^-T,

    measurements   nis - |y|^2, expected dof - tr K: what no state explains,
    disturbance    y'D y, expected tr D K, D what its density has added to P- (`spinfilters.estimators.filters.noise_adaptation`),
    whiteness      the sum of y_k' y_k+1 over epochs, expected 0, variance tr K_k K_k+1.

A test's score is the excess over its standard deviation; the ratio is that of the variance seen to the stated one, to first order.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.filters.noise_adaptation import SOURCES, motion_evidence
from spinfilters.estimators.filters.square_root_update import triangular_factor
from spinfilters.estimators.history import EstimateHistory
from spinfilters.linear_algebra.lapack import dtrtrs
from spinfilters.models.process import TorqueFreeProcess

MOST_EPOCHS: Final = 1500
"""That are tested, from a filter's first on."""
MEASUREMENTS: Final = "measurements"
SMALLEST_RATIO: Final = 0.01
"""Of variances that is told: far below one the first order says nothing more."""


@dataclass(frozen=True)
class NoiseTest:
    """A sum of squares that a noise level explains.

    Attributes
    ----------
    seen, expected: the sum, and its mean where the stated level is right.   variance: of it there.
    information: by how much its mean grows with the logarithm of the level's variance.
    """

    seen: float = 0.0
    expected: float = 0.0
    variance: float = 0.0
    information: float = 0.0

    def plus(self, seen: float, expected: float, information: float) -> "NoiseTest":
        """With another epoch of a filter, whose squares have twice the information for their variance."""
        return NoiseTest(
            self.seen + seen,
            self.expected + expected,
            self.variance + 2 * information,
            self.information + information,
        )

    @property
    def score(self) -> float:
        """Standard deviations that the sum is above its expectation; zero where nothing tells."""
        return (self.seen - self.expected) / np.sqrt(self.variance) if self.variance > 0 else 0.0

    @property
    def ratio(self) -> float:
        """Ratio of the variance seen to the stated one, first order.

        Below it the share that is seen.
        """
        if not self.information > 0:
            return 1.0
        if self.seen >= self.expected:
            return 1 + (self.seen - self.expected) / self.information
        return max(self.seen / self.expected, SMALLEST_RATIO)


@dataclass(frozen=True)
class FilterTests:
    """Of one filter's own epochs.

    Attributes
    ----------
    noise: by `MEASUREMENTS` or the source of a disturbance.   correlation: sum of y_k' y_k+1.   spread: its variance.
    length: what the correlation would be of corrections that are all alike.
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
        """Of corrections of neighbouring epochs."""
        return self.correlation / self.length if self.length > 0 else 0.0


@dataclass(frozen=True)
class _Update:
    """y, 1 - K and factor F of one update.

    And what it says of the measurements.
    """

    y: Float[np.ndarray, " n"]
    left: Float[np.ndarray, "n n"]
    factor: Float[np.ndarray, "n n"]


def filter_tests(history: EstimateHistory, process: TorqueFreeProcess) -> FilterTests:
    """Tests over a filter's own epochs, with the noise that it was told.

    Raises
    ------
    numpy.linalg.LinAlgError: numbers that lead nowhere.
    """
    begin = max(history.initialisation, 1)
    tests = dict.fromkeys((MEASUREMENTS, *SOURCES), NoiseTest())
    known: dict[str, np.ndarray] = {}
    sums, before = np.zeros(3), None
    for k in range(begin, min(len(history.time), begin + MOST_EPOCHS)):
        moved, transition, noise = process.linearise(
            history.mean[k - 1], float(history.time[k] - history.time[k - 1])
        )
        update = _update(
            history, k, moved, triangular_factor(np.hstack([transition @ history.factor[k - 1], noise]).T)
        )
        for source, columns in SOURCES.items():
            if noise[:, columns].size:
                entered = noise[:, columns] @ noise[:, columns].T
                if source in known:
                    entered += transition @ known[source] @ transition.T
                D = _within(update.factor, entered)
                evidence = motion_evidence(D, update.left, update.y)
                tests[source] = tests[source].plus(evidence.squared, evidence.expected, evidence.information)
                shrunk = update.factor @ update.left
                known[source] = shrunk @ D @ shrunk.T
        K = np.eye(len(update.y)) - update.left
        if history.dof[k] > 0:
            tests[MEASUREMENTS] = tests[MEASUREMENTS].plus(*_of_measurements(history, k, update.y, K))
        if before is not None:
            sums += [update.y @ before[0], np.vdot(K, before[1]), _mean_trace(K, before[1])]
        before = update.y, K
    noise_tests = {name: test for name, test in tests.items() if test.information > 0}
    return FilterTests(noise_tests, *sums.tolist())


def _update(
    history: EstimateHistory, k: int, moved: Float[np.ndarray, " m"], factor: Float[np.ndarray, "n n"]
) -> _Update:
    error = history.layout.local(moved, history.mean[k])
    solved, failed = dtrtrs(factor, np.column_stack([history.factor[k], error]), lower=1)
    if failed:
        raise np.linalg.LinAlgError(f"the predicted covariance of epoch {k} is singular")
    return _Update(solved[:, -1], solved[:, :-1] @ solved[:, :-1].T, factor)


def _mean_trace(one: Float[np.ndarray, "n n"], other: Float[np.ndarray, "n n"]) -> float:
    """Geometric mean; rounding may leave a trace of nothing below zero."""
    return float(np.sqrt(max(np.trace(one), 0.0) * max(np.trace(other), 0.0)))


def _within(
    factor: Float[np.ndarray, "n n"], covariance: Float[np.ndarray, "n n"]
) -> Float[np.ndarray, "n n"]:
    """F^-1 C F^-T."""
    half = dtrtrs(factor, covariance, lower=1)[0]
    return dtrtrs(factor, half.T, lower=1)[0]


def _of_measurements(
    history: EstimateHistory, k: int, y: Float[np.ndarray, " n"], K: Float[np.ndarray, "n n"]
) -> tuple[float, float, float]:
    """Sum of squares, expectation and half the variance of what no state explains."""
    dof, told = float(history.dof[k]), float(np.trace(K))
    free = dof - told
    return float(history.nis[k] - y @ y), free, max(dof - 2 * told + float(np.vdot(K, K)), 0.0)
