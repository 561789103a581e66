"""Variance components of a linear problem by their whitened rows."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.estimators.identification.components import ComponentRows
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.null_distributions import FEWEST
from spinfilters.estimators.model_errors.solved_columns import flat
from spinfilters.linear_algebra.chi_square import fisher_tail

TELLING: Final = 20.0
"""Redundancy of a component from which a ratio of its squared residuals tells anything."""
LEAST_SHARE: Final = -0.9
"""Of its degrees of freedom by which a level is less likely with an error removed, at least."""


@dataclass(frozen=True)
class Gain:
    """Fall of -2 ln likelihood, profiled over the noise levels.

    Attributes
    ----------
    dof: degrees of freedom that tell these levels; infinite of known ones.
    level: by how much ln variance falls of the level that falls most, among those that are identified from the same residuals: not
        those that are known or hardly told, and none beside a level that stands for a correlated error.
    """

    value: float
    dof: float
    level: float


@dataclass(frozen=True)
class NoiseComponents:
    """Which rows each noise level scales.

    Attributes
    ----------
    components: of sensors.   factors: (k - 1, d, i) of each disturbance, L^-1 G of its share G G' of a step's covariance L L'.
    redundancy: S of each, expected squared residuals, sensors first.   known: whether a level is stated, not identified.
    correlation: samples that count as one, of a level that stands for a correlated error as white noise of its weight; else 1.
    telling: degrees of freedom of the residuals that tell each level: its redundancy; of a correlated error what the states, which
        are as slow, leave of its independent samples.
    inflation: of stated variances for errors that rows have in common, at least 1.
    """

    components: tuple[ComponentRows, ...]
    factors: tuple[Float[np.ndarray, "k d i"], ...]
    redundancy: Float[np.ndarray, " c"]
    known: Bool[np.ndarray, " c"]
    correlation: Float[np.ndarray, " c"]
    telling: Float[np.ndarray, " c"]
    inflation: Float[np.ndarray, " c"]

    def squares(self, rest: Columns) -> Float[np.ndarray, " c"]:
        """Squared residuals of each component, of one column."""
        return self.products(rest, rest)[:, 0, 0]

    def products(self, one: Columns, other: Columns) -> Float[np.ndarray, "c m o"]:
        """Products of columns by component.

        Over the rows of each that the columns have.
        """
        found = np.zeros((len(self.redundancy), one.count, other.count))
        for k, each in enumerate(self.components):
            for sensor, rows in each.sensors.items() if one.sensors else ():
                found[k] += _product(one.sensors[sensor], other.sensors[sensor], rows)
            if each.landmarks and one.observations is not None and other.observations is not None:
                found[k] += flat(one.observations).T @ flat(other.observations)
        for k, W in enumerate(self.factors, start=len(self.components)):
            explained = [flat(W.swapaxes(1, 2) @ each.steps) for each in (one, other)]
            found[k] = explained[0].T @ explained[1]
        return found

    @property
    def correlated(self) -> Bool[np.ndarray, " c"]:
        """Whether a level stands for an error that is correlated."""
        return self.correlation > 1

    def beside_all(self, statistic: float, count: float, left: Float[np.ndarray, " c"]) -> float:
        """Probability of a greater statistic of ``count`` errors, beside what all residuals leave.

        Where a level stands for a correlated error, which an error of the models may have been taken for; else 1. Its white noise
        makes residuals smaller than their redundancy, by the samples that count as one.

        Parameters
        ----------
        left: squared residuals by component, the error in them.
        """
        if not self.correlated.any() or statistic <= 0:
            return 1.0
        dof = max(float(self.redundancy.sum() / self.correlation.max()), count + FEWEST)
        rest = max(float(left.sum()) - statistic, np.finfo(float).tiny)
        return fisher_tail(statistic / count * (dof - count) / rest, count, dof - count)

    @property
    def dof(self) -> Float[np.ndarray, " c"]:
        """Degrees of freedom that tell each level, with those of its prior.

        Infinite of known ones.
        """
        return np.where(self.known, np.inf, self.telling + 1)

    @property
    def sensor_dof(self) -> float:
        """Of the sensors' level that is told by fewest."""
        return float(self.dof[: len(self.components)].min(initial=np.inf))

    def gain(self, before: Float[np.ndarray, " c"], after: Float[np.ndarray, " c"]) -> Gain:
        """Gain from the `squares` of one residual to those of another.

        Its degrees of freedom are those of the levels that fall, by their shares of the fall.
        The squares of a correlated error tell the level that stands for it less than the recording did that it was identified from.
        """
        r, left, dof = before, after, self.dof
        finite = np.where(self.known, 1.0, dof)
        shares = np.maximum((r - left) / finite, LEAST_SHARE)
        falls = np.where(self.correlated, np.log1p(shares), np.log((r + 1) / (left + 1)))
        each = np.where(self.known, r - left, finite * falls)
        falls = np.maximum(each, 0.0)
        per_dof = float((falls / dof).sum())
        shared = (self.redundancy > TELLING) & ~self.known & ~self.correlated.any()
        level = float((falls / finite)[shared].max(initial=0.0))
        return Gain(float(each.sum()), float(falls.sum()) / per_dof if per_dof > 0 else np.inf, level)


def _product(
    one: Float[np.ndarray, "r i m"], other: Float[np.ndarray, "r i o"], rows: tuple[int, ...]
) -> Float[np.ndarray, "m o"]:
    """Product over some of the i rows of every measurement."""
    if rows != tuple(range(one.shape[1])):
        one, other = one[:, list(rows)], other[:, list(rows)]
    return flat(one).T @ flat(other)
