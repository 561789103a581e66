"""Covariance of smoothed states under another explanation of the measurements.

Estimates x = P J'z were made for white z. Had the whitened measurements the covariance C, that of x would be A = P J'C J P. With
P = F F', the eigenvalues of F^-1 A F^-T tell by what the variances of the state's directions are wrong.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri

from spinfilters.estimators.identification.noise_model import NoiseModel
from spinfilters.estimators.model_errors.likely_levels import LikelyLevels
from spinfilters.estimators.model_errors.linear_likelihood import MOST_EPOCHS
from spinfilters.estimators.model_errors.linear_rows import LinearRows
from spinfilters.estimators.smoothing.linear.marginals import Marginals

CLAIM = 4.0
"""Stated deviations that no error of an estimate called ok exceeds."""
MOST_WRONG: Final = 3e-4
"""Probability that errors which last, where they cannot be ruled out, take an estimate beyond what is claimed of it."""
UNKNOWN_LEVEL: Final = 2.0
"""Deviation of the logarithm of a level of which the data say nothing."""
EPOCHS_ASKED: Final = 8
"""Of which the change by levels is asked."""
STEP, SMALL = 0.1, 1e-9
"""Of a level, for that change; a deviation that is none."""


@dataclass(frozen=True)
class ExplainedErrors:
    """Errors of smoothed states by the measurements' own.

    Attributes
    ----------
    rows: of a solved problem without landmarks.   model: components of its measurement noise.
    """

    rows: LinearRows
    model: NoiseModel

    @cached_property
    def factors(self) -> Float[np.ndarray, "k n n"]:
        """Lower triangular F of the first epochs."""
        epochs = min(self.rows.problem.ordering.epochs, MOST_EPOCHS)
        return Marginals(self.rows.solution, self.rows.normal.eliminated).first_factors(epochs)

    def covariance(
        self, levels: Float[np.ndarray, " c"], epochs: slice = slice(None)
    ) -> Float[np.ndarray, "k n n"]:
        """A of some of the first epochs at levels of `linear_likelihood`.

        What disturbances have in it falls with their densities.
        """
        count, factors = len(self.model.components), self.factors[epochs]
        stated = factors @ np.swapaxes(factors, 1, 2)
        measured, lasting = np.zeros_like(stated), np.zeros_like(stated)
        for number, away, every in self._moved:
            slow, moved = np.exp(levels[count + number] - away / np.exp(levels[-1])), every[epochs]
            across = np.swapaxes(moved, 1, 2)
            measured += moved @ across
            lasting += moved @ (np.exp(levels[number]) * across + slow @ across)
        densities = np.exp(levels[2 * count : -1])
        left = float(np.clip(densities.mean(), 0.0, 1.0)) if len(densities) else 1.0
        return lasting + left * (stated - measured)

    def relative(
        self, levels: Float[np.ndarray, " c"], epochs: slice = slice(None)
    ) -> Float[np.ndarray, "k n n"]:
        """F^-1 A F^-T."""
        factors = self.factors[epochs]
        half = np.linalg.solve(factors, self.covariance(levels, epochs))
        return np.linalg.solve(factors, np.swapaxes(half, 1, 2))

    def inflation(self, levels: Float[np.ndarray, " c"]) -> float:
        """Largest over components of the mean over epochs of their variance, over that stated."""
        stated = (self.factors**2).sum(axis=2)
        ratio = np.diagonal(self.covariance(levels), axis1=1, axis2=2) / np.where(stated > 0, stated, np.inf)
        return float(ratio.mean(axis=0).max())

    def widening(
        self, likely: LikelyLevels, information: Float[np.ndarray, "f f"], probability: float
    ) -> Float[np.ndarray, "k n n"]:
        """B of covariance factors F B that hold for an explanation too.

        Errors are of covariance A with the explanation's probability p. In the space of a normal error and of the levels, an error
        beyond the claim has at a distance beta from the most probable values the probability p Phi(-beta) a side (first-order
        reliability method). With beta such that this is `MOST_WRONG` / 2, and v the deviation of ln A by the levels, the worst
        point has these u deviations along its gradient, and the error sqrt(beta^2 - u^2) of its own:
        u / (beta^2 - u^2) = v / 2. F B B' F' is the larger of F F' and of that A in every direction.

        Parameters
        ----------
        information: of the levels that are free.
        """
        beta = -float(ndtri(min(MOST_WRONG / (2 * probability), 0.5)))
        direction, deviation = self._steepest(likely, information)
        u = (np.sqrt(1 + (beta * deviation) ** 2) - 1) / max(deviation, SMALL)
        values, vectors = np.linalg.eigh(self.relative(likely.moved(u * direction).levels))
        larger = (beta**2 - u**2) / CLAIM**2 * values
        return vectors * np.sqrt(np.maximum(larger, 1.0))[:, np.newaxis]

    def _steepest(
        self, likely: LikelyLevels, information: Float[np.ndarray, "f f"]
    ) -> tuple[Float[np.ndarray, " f"], float]:
        """Step of one deviation in the levels along which ln A rises most, and its rise."""
        steps = STEP * np.eye(len(likely.free))
        here = self._log_size(likely)
        slope = np.array([(self._log_size(likely.moved(step)) - here) / STEP for step in steps])
        spread = np.linalg.solve(information + np.eye(len(slope)) / UNKNOWN_LEVEL**2, slope)
        deviation = float(np.sqrt(slope @ spread))
        return spread / max(deviation, SMALL), deviation

    def _log_size(self, likely: LikelyLevels) -> float:
        """ln of the trace of A in the stated factors, over some epochs."""
        some = slice(None, None, -(-len(self.factors) // EPOCHS_ASKED))
        return float(np.log(np.trace(self.relative(likely.levels, some), axis1=1, axis2=2).sum()))

    @cached_property
    def _moved(self) -> list[tuple[int, Float[np.ndarray, "r r"], Float[np.ndarray, "k n r"]]]:
        """Component, time apart (s), and errors of states, by every row of measurements."""
        return list(self._by_row())

    def _by_row(self) -> Iterator[tuple[int, Float[np.ndarray, "r r"], Float[np.ndarray, "k n r"]]]:
        rows, sensors = self.rows, self.rows.problem.motion.sensors
        stamps = np.concatenate([[0.0], np.cumsum(rows.problem.motion.dt)])
        for number, each in enumerate(self.model.components):
            for k, own in each.sensors.items():
                early = np.flatnonzero(sensors[k].epoch < MOST_EPOCHS)
                time = stamps[sensors[k].epoch[early]]
                away = np.abs(np.subtract.outer(time, time))
                at = early[np.abs(rows.sensor_rows[k][early]).max(axis=(1, 2)) > 0]
                for row in own:
                    right = rows.nothing(len(early))
                    right.sensors[k][at, row, at] = 1.0
                    yield number, away, rows.sensitivity(right).states[: len(self.factors)]
