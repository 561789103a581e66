"""What a run leaves behind."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import StateLayout
from spinfilters.state.status import EstimatorStatus


@dataclass(frozen=True)
class EstimateHistory:
    """Beliefs after every frame, and what each frame cost.

    Attributes
    ----------
    name: of the estimator.   layout: of its state.
    time: (n,) s.   mean: (n, mean_dim).   factor: (n, error_dim, error_dim), P = factor factor'.
    nis, dof: (n,) normalised innovation squared of each frame and its degrees of freedom.
    log_likelihood: (n,) of each frame's measurements given everything before.
    accepted, rejected: (n,) measurements used and left out.
    runtime: (n,) s per frame, prediction and update.
    """

    name: str
    layout: StateLayout
    time: Float[np.ndarray, " n"]
    mean: Float[np.ndarray, "n m"]
    factor: Float[np.ndarray, "n e e"]
    nis: Float[np.ndarray, " n"]
    dof: Int[np.ndarray, " n"]
    log_likelihood: Float[np.ndarray, " n"]
    accepted: Int[np.ndarray, " n"]
    rejected: Int[np.ndarray, " n"]
    runtime: Float[np.ndarray, " n"]
    status: EstimatorStatus

    def belief(self, index: int) -> Gaussian:
        """Belief after the frame of this index."""
        return Gaussian(self.layout, self.mean[index], self.factor[index])

    @property
    def covariance(self) -> Float[np.ndarray, "n e e"]:
        """Error covariance after every frame."""
        return self.factor @ np.swapaxes(self.factor, 1, 2)

    @property
    def std(self) -> Float[np.ndarray, "n e"]:
        """Standard deviation of every error component after every frame."""
        return np.sqrt(np.einsum("tij,tij->ti", self.factor, self.factor))
