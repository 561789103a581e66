"""Covariance of smoothed states under another explanation of the measurements than they were made for.

Estimates x = P J'z were made for white z. Had the whitened measurements the covariance C, that of x would be A = P J'C J P. With
P = F F', the eigenvalues of F^-1 A F^-T tell by what the variances of the state's directions are wrong.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri

from spinfilters.estimators.identification.noise_model import NoiseModel
from spinfilters.estimators.model_errors.linear_likelihood import MOST_EPOCHS
from spinfilters.estimators.model_errors.linear_rows import LinearRows
from spinfilters.estimators.smoothing.linear.marginals import Marginals

CLAIM = 4.0
"""Stated deviations that no error of an estimate called ok exceeds."""


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

    def covariance(self, levels: Float[np.ndarray, " c"]) -> Float[np.ndarray, "k n n"]:
        """A of the first epochs at levels of `linear_likelihood`.

        What disturbances have in it falls with their densities.
        """
        count = len(self.model.components)
        stated = self.factors @ np.swapaxes(self.factors, 1, 2)
        measured, lasting = np.zeros_like(stated), np.zeros_like(stated)
        for number, away, moved in self._moved:
            slow = np.exp(levels[count + number] - away / np.exp(levels[-1]))
            across = np.swapaxes(moved, 1, 2)
            measured += moved @ across
            lasting += moved @ (np.exp(levels[number]) * across + slow @ across)
        densities = np.exp(levels[2 * count : -1])
        left = float(np.clip(densities.mean(), 0.0, 1.0)) if len(densities) else 1.0
        return lasting + left * (stated - measured)

    def relative(self, covariance: Float[np.ndarray, "k n n"]) -> Float[np.ndarray, "k n n"]:
        """F^-1 A F^-T."""
        half = np.linalg.solve(self.factors, covariance)
        return np.linalg.solve(self.factors, np.swapaxes(half, 1, 2))

    def inflation(self, covariance: Float[np.ndarray, "k n n"]) -> float:
        """Largest over components of the mean over epochs of their variance, over that stated."""
        stated = (self.factors**2).sum(axis=2)
        ratio = np.diagonal(covariance, axis1=1, axis2=2) / np.where(stated > 0, stated, np.inf)
        return float(ratio.mean(axis=0).max())

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


def covering(
    relative: Float[np.ndarray, "k n n"], probability: float, most_wrong: float
) -> Float[np.ndarray, "k n n"]:
    """B by which F B is a factor of a covariance that holds for another explanation too.

    Where errors are of the covariance A with a probability p, one beyond `CLAIM` deviations of w A has the probability
    2 p Phi(-4 sqrt(w)). With w such that this is `most_wrong`, F B B' F' is the larger of F F' and w A in every direction.

    Parameters
    ----------
    relative: F^-1 A F^-T.   probability: of the explanation.   most_wrong: probability of an error beyond the claim.
    """
    beyond = -float(ndtri(min(most_wrong / (2 * probability), 0.5)))
    values, vectors = np.linalg.eigh(relative)
    return vectors * np.sqrt(np.maximum((beyond / CLAIM) ** 2 * values, 1.0))[:, np.newaxis]
