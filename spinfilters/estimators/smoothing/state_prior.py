"""Gaussian prior of one state, the first of a smoothing problem."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from jaxtyping import Float


class StatePrior(Protocol):
    """A Gaussian of one state: a `FirstStatePrior`, or a `Gaussian`."""

    @property
    def mean(self) -> Float[np.ndarray, " m"]:
        """(mean_dim,) state."""
        ...

    @property
    def factor(self) -> Float[np.ndarray, "n n"]:
        """(n, n) square root of its covariance."""
        ...

    def whitened(self, rows: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
        """Rows of errors in its standard deviations: factor^-1 rows. LinAlgError: a singular factor."""
        ...


@dataclass(frozen=True)
class FirstStatePrior:
    """Mean (point of the layout) and standard deviations of the independent prior of the first state."""

    mean: Float[np.ndarray, " m"]
    std: Float[np.ndarray, " n"]

    @property
    def factor(self) -> Float[np.ndarray, "n n"]:
        """Square root of the covariance."""
        return self._factor

    def whitened(self, rows: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
        """Rows of errors in standard deviations, as `StatePrior.whitened`."""
        if not self.std.all():
            raise np.linalg.LinAlgError("a standard deviation is zero")
        return rows * (1.0 / self.std)[:, None]

    @cached_property
    def _factor(self) -> Float[np.ndarray, "n n"]:
        return np.diag(self.std)
