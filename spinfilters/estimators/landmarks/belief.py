"""A belief about a state and the landmarks of the body together."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from spinfilters.errors import InputError, ShapeError
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import StateLayout


@dataclass(frozen=True)
class LandmarkBelief:
    """Means and the square root of the joint error covariance, state first, then the landmarks in the order of ``ids``.

    Attributes
    ----------
    layout: of the state.   mean: (m,) its point.
    ids: (k,) of the landmarks, each once.   points: (k, 3) m, frame g.
    factor: (n + 3k, n + 3k) lower triangular, P = factor factor'; the error of a point adds, p = points + d.
    """

    layout: StateLayout
    mean: Float[np.ndarray, " m"]
    ids: Int[np.ndarray, " k"]
    points: Float[np.ndarray, "k 3"]
    factor: Float[np.ndarray, "j j"]

    def __post_init__(self) -> None:
        size = self.layout.error_dim + 3 * len(self.ids)
        shapes = self.mean.shape, self.points.shape, self.factor.shape
        if shapes != ((self.layout.mean_dim,), (len(self.ids), 3), (size, size)):
            raise ShapeError(
                f"a belief over {self.layout.blocks} and {len(self.ids)} landmarks needs a mean ({self.layout.mean_dim},), points "
                f"({len(self.ids)}, 3) and a factor ({size}, {size}), got {', '.join(map(str, shapes))}"
            )
        if len(np.unique(self.ids)) < len(self.ids):
            raise InputError("a landmark occurs twice in a belief; give each id once")

    @property
    def state(self) -> Gaussian:
        """The state alone: its factor is the leading block."""
        n = self.layout.error_dim
        return Gaussian(self.layout, self.mean, self.factor[:n, :n].copy())
