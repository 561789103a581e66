"""A belief about a state and the landmarks of the body together."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from spinfilters.errors import InputError, ShapeError
from spinfilters.estimators.filters.square_root_update import triangular_factor
from spinfilters.models.gauge import GAUGE_DIM, gauge_of_points, moved_points, state_in_g
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import StateLayout


@dataclass(frozen=True)
class LandmarkBelief:
    """Belief of a state, shared modes and landmarks.

    r shared modes of the landmarks' errors, and each landmark's own error.
    d_i = modes_i m + roots_i e_i.

    All of it is told in the map's frame, in which no rigid motion of all landmarks together is uncertain. Frame g of the state that
    is asked for differs by a small move (theta, rho), whose error stands in the factor too: nothing observed depends on it.

    Attributes
    ----------
    layout: of the state.   mean: (m,) its point.   move: (6,) most probable move from the map's frame to g (`models.gauge`).
    ids: (k,) of the landmarks, each once.   points: (k, 3) m.
    modes: (k, 3, r).   roots: (k, 3, 3).
    factor: (n + r + p, n + r + p) of the errors of state, modes and, where p is 6 and not 0, the move.
    """

    layout: StateLayout
    mean: Float[np.ndarray, " m"]
    ids: Int[np.ndarray, " k"]
    points: Float[np.ndarray, "k 3"]
    modes: Float[np.ndarray, "k 3 r"]
    roots: Float[np.ndarray, "k 3 3"]
    factor: Float[np.ndarray, "N N"]
    move: Float[np.ndarray, " 6"]

    def __post_init__(self) -> None:
        size = self.layout.error_dim + self.modes.shape[2]
        if self.mean.shape != (self.layout.mean_dim,) or self.factor.shape not in (
            (size, size),
            (size + GAUGE_DIM, size + GAUGE_DIM),
        ):
            raise ShapeError(
                f"a belief over {self.layout.blocks} and {self.modes.shape[2]} modes needs a mean ({self.layout.mean_dim},) and a "
                f"factor of {size} or {size + GAUGE_DIM} rows, got {self.mean.shape} and {self.factor.shape}"
            )
        if len(np.unique(self.ids)) < len(self.ids):
            raise InputError("a landmark occurs twice in a belief; give each id once")

    @property
    def state(self) -> Gaussian:
        """The state alone, in frame g."""
        mean, rows = self._state_rows()
        return Gaussian(self.layout, mean, triangular_factor(rows.T))

    @property
    def joint(self) -> "LandmarkBelief":
        """The belief itself: state and landmarks together."""
        return self

    @property
    def points_in_g(self) -> Float[np.ndarray, "k 3"]:
        """Landmarks in frame g, m."""
        return moved_points(self.points, self.move)

    def joint_factor(self) -> Float[np.ndarray, "j j"]:
        """Lower triangular factor of the errors of the state and of all points, in frame g."""
        n, r, k = self.layout.error_dim, self.modes.shape[2], len(self.ids)
        rows = (self.modes @ self.factor[n : n + r]).reshape(3 * k, -1)
        if len(self.factor) > n + r:
            rows = rows + gauge_of_points(self.points_in_g) @ self.factor[n + r :]
        own = np.zeros((k, 3, k, 3))
        own[np.arange(k), :, np.arange(k)] = self.roots
        top = np.concatenate([self._state_rows()[1], np.zeros((n, 3 * k))], axis=1)
        return triangular_factor(
            np.concatenate([top, np.concatenate([rows, own.reshape(3 * k, -1)], axis=1)]).T
        )

    def with_modes(self, rank: int) -> "LandmarkBelief":
        """The belief padded to at least so many modes."""
        n, r = self.layout.error_dim, self.modes.shape[2]
        more = max(rank - r, 0)
        modes = np.pad(self.modes, [(0, 0), (0, 0), (0, more)])
        place = np.r_[0 : n + r, n + r + more : len(self.factor) + more]
        factor = np.eye(len(self.factor) + more)
        factor[np.ix_(place, place)] = self.factor
        return replace(self, modes=modes, factor=factor)

    def _state_rows(self) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "n N"]]:
        n = self.layout.error_dim
        if len(self.factor) == n + self.modes.shape[2]:
            return self.mean, self.factor[:n]
        return state_in_g(self.layout, self.mean, self.factor, self.move)


Belief = Gaussian | LandmarkBelief
"""Of a state, alone or with landmarks: `state` is the one, `joint` the other or None."""
