"""Size of an error of the models by its score, before and beside a prior."""

from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

LEAST_LEFT: Final = 5e-6
"""Share of a direction's information that states and landmarks must leave; with less it is consistent with any size."""

LEAST_BESIDE_PRIOR: Final = 0.1
"""Likewise, relative to that of what is plausible: what data tell to three times that at best is what linearising errs by."""

HARDLY_LEFT, FARTHEST = 1e-3, 10.0
"""Share of a direction's information below which a size beyond so many plausible deviations is no size: the states follow such an
error nearly, and what they leave of it is second order. A baseline larger by e makes a motion larger by e with all that disturbs
it, so that residuals are least at e = -1 whatever the baseline is."""


class ErrorSize(NamedTuple):
    """Size of q numbers by their score and information.

    Attributes
    ----------
    value, covariance: without a prior.   probable: most probable beside one.   improbability: -2 ln prior of that.
    dof: numbers that are told.
    """

    value: Float[np.ndarray, " q"]
    covariance: Float[np.ndarray, "q q"]
    probable: Float[np.ndarray, " q"]
    improbability: float
    dof: float

    @classmethod
    def of(
        cls, F: Float[np.ndarray, "q q"], u: Float[np.ndarray, " q"], prior: Float[np.ndarray, " q"]
    ) -> "ErrorSize | None":
        """The size along what the data tell of it; None where that is nothing.

        Parameters
        ----------
        F, u: information and score.   prior: information of the diagonal prior.
        """
        values, vectors = np.linalg.eigh((F + F.T) / 2)
        plausible = np.einsum("ij,i,ij->j", vectors, prior, vectors)
        told = values > np.maximum(LEAST_LEFT, LEAST_BESIDE_PRIOR * plausible)
        beyond = np.abs(vectors.T @ u) * np.sqrt(plausible) > FARTHEST * values
        told &= ~(beyond & (values < HARDLY_LEFT))
        if not told.any():
            return None
        along = vectors[:, told]
        covariance = along / values[told] @ along.T
        probable = along @ np.linalg.solve(along.T @ (F + np.diag(prior)) @ along, along.T @ u)
        return cls(covariance @ u, covariance, probable, float(prior @ probable**2), float(told.sum()))
