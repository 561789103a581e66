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


@dataclass(frozen=True)
class FirstStatePrior:
    """Mean (point of the layout) and standard deviations of the independent prior of the first state."""

    mean: Float[np.ndarray, " m"]
    std: Float[np.ndarray, " n"]

    @property
    def factor(self) -> Float[np.ndarray, "n n"]:
        """Square root of the covariance."""
        return self._factor

    @cached_property
    def _factor(self) -> Float[np.ndarray, "n n"]:
        return np.diag(self.std)
