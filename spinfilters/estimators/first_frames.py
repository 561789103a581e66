"""Prior and result of smoothing the first epochs of a recording."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class FirstStatePrior:
    """Mean (point of the layout) and standard deviations of the independent prior of the first state."""

    mean: Float[np.ndarray, " m"]
    std: Float[np.ndarray, " n"]

    @property
    def factor(self) -> Float[np.ndarray, "n n"]:
        """Square root of the covariance."""
        return np.diag(self.std)


@dataclass(frozen=True)
class SmoothedFrames:
    """The most probable trajectory of the first k frames, each with its covariance given all of them.

    Attributes
    ----------
    mean: (k, m).   factor: (k, n, n), covariance factor factor'; not finite where something is not determined.
    cost: sum of squared whitened residuals about it, prior and dynamics included.   dof: number of scalar measurements.
    """

    mean: Float[np.ndarray, "k m"]
    factor: Float[np.ndarray, "k n n"]
    cost: float
    dof: int
    iterations: int
    converged: bool
