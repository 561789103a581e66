"""Variance components of a linear problem by their whitened rows."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.identification.components import ComponentRows
from spinfilters.estimators.model_errors.linear_rows import Columns


@dataclass(frozen=True)
class NoiseComponents:
    """Which rows each noise level scales.

    Attributes
    ----------
    components: of sensors.   factors: (k - 1, d, i) of each disturbance, L^-1 G of its share G G' of a step's covariance L L'.
    redundancy: S of each, expected squared residuals, sensors first.
    """

    components: tuple[ComponentRows, ...]
    factors: tuple[Float[np.ndarray, "k d i"], ...]
    redundancy: Float[np.ndarray, " c"]

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

    def gain(self, before: Columns, after: Columns) -> float:
        """Fall of -2 ln likelihood, profiled over the levels, from one residual to another."""
        ratio = np.log((self.squares(before) + 1) / (self.squares(after) + 1))
        return float((np.maximum(self.redundancy, 0.0) + 1) @ ratio)
