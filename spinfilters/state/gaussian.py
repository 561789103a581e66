"""A belief: a point on the state manifold and the square root of its error covariance."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError, ShapeError
from spinfilters.linear_algebra.definite import correlation_root
from spinfilters.state.layout import StateLayout


@dataclass(frozen=True)
class Gaussian:
    """Mean and covariance of a state.

    The covariance is held as a factor, P = factor factor', so that it cannot become indefinite by rounding.

    Attributes
    ----------
    layout: which blocks the state holds.
    mean: (mean_dim,) a point of the layout.
    factor: (error_dim, error_dim) any square root of the error covariance.
    """

    layout: StateLayout
    mean: Float[np.ndarray, " m"]
    factor: Float[np.ndarray, "n n"]

    def __post_init__(self) -> None:
        n = self.layout.error_dim
        if self.mean.shape != (self.layout.mean_dim,) or self.factor.shape != (n, n):
            raise ShapeError(
                f"a Gaussian over {self.layout.blocks} needs a mean of shape ({self.layout.mean_dim},) and a factor of shape "
                f"({n}, {n}), got {self.mean.shape} and {self.factor.shape}"
            )

    @classmethod
    def from_covariance(
        cls, layout: StateLayout, mean: Float[np.ndarray, " m"], covariance: Float[np.ndarray, "n n"]
    ) -> "Gaussian":
        """Gaussian of a symmetric positive definite covariance.

        Raises
        ------
        InputError: when the covariance is not positive definite; it is not repaired.
        """
        scale = np.sqrt(np.diag(covariance))
        if not np.all(np.isfinite(scale) & (scale > 0)):
            raise InputError(
                f"covariance has the diagonal {np.diag(covariance).tolist()}; every variance must be positive"
            )
        try:
            factor = scale[:, None] * correlation_root(covariance)
        except np.linalg.LinAlgError as error:
            raise InputError(
                "covariance is not positive definite; give a symmetric positive definite matrix"
            ) from error
        return cls(layout, mean, factor)

    def whitened(self, rows: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
        """Rows of errors in standard deviations: factor^-1 rows. LinAlgError: a singular factor."""
        return np.linalg.solve(self.factor, rows)

    @property
    def state(self) -> "Gaussian":
        """The belief itself."""
        return self

    @property
    def joint(self) -> None:
        """None: a belief of the state alone."""
        return None

    @property
    def covariance(self) -> Float[np.ndarray, "n n"]:
        """P = factor factor', positive semidefinite by construction."""
        return self.factor @ self.factor.T

    @property
    def std(self) -> Float[np.ndarray, " n"]:
        """Standard deviation of every error component."""
        return np.sqrt(np.einsum("ij,ij->i", self.factor, self.factor))
