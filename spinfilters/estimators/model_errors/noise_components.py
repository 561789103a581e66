"""Variance components of a linear problem by their whitened rows."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.estimators.identification.components import ComponentRows
from spinfilters.estimators.model_errors.linear_rows import Columns

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
    correlated: whether a level stands for an error that is correlated, as white noise that weighs as much.
    telling: degrees of freedom of the residuals that tell each level: its redundancy; of a correlated error what the states, which
        are as slow, leave of its independent samples.
    inflation: of stated variances for errors that rows have in common, at least 1.
    """

    components: tuple[ComponentRows, ...]
    factors: tuple[Float[np.ndarray, "k d i"], ...]
    redundancy: Float[np.ndarray, " c"]
    known: Bool[np.ndarray, " c"]
    correlated: Bool[np.ndarray, " c"]
    telling: Float[np.ndarray, " c"]
    inflation: Float[np.ndarray, " c"]

    def squares(self, rest: Columns) -> Float[np.ndarray, " c"]:
        """Squared residuals of each component, of one column."""
        found = []
        for each in self.components:
            total = sum(
                float((rest.sensors[k][:, list(rows), 0] ** 2).sum()) for k, rows in each.sensors.items()
            )
            if each.landmarks and rest.observations is not None:
                total += float((rest.observations[:, :, 0] ** 2).sum())
            found.append(total)
        steps = rest.steps[:, :, 0]
        found += [float((np.einsum("kdi,kd->ki", W, steps) ** 2).sum()) for W in self.factors]
        return np.array(found)

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

    def gain(self, before: Columns, after: Columns) -> Gain:
        """Gain from one residual to another.

        Its degrees of freedom are those of the levels that fall, by their shares of the fall.
        The squares of a correlated error tell the level that stands for it less than the recording did that it was identified from.
        """
        r, left, dof = self.squares(before), self.squares(after), self.dof
        finite = np.where(self.known, 1.0, dof)
        shares = np.maximum((r - left) / finite, LEAST_SHARE)
        falls = np.where(self.correlated, np.log1p(shares), np.log((r + 1) / (left + 1)))
        each = np.where(self.known, r - left, finite * falls)
        falls = np.maximum(each, 0.0)
        per_dof = float((falls / dof).sum())
        shared = (self.redundancy > TELLING) & ~self.known & ~self.correlated.any()
        level = float((falls / finite)[shared].max(initial=0.0))
        return Gain(float(each.sum()), float(falls.sum()) / per_dof if per_dof > 0 else np.inf, level)
