"""What a smoother of the first frames with landmarks hands over."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.errors import InputError
from spinfilters.estimators.gain import triangular_factor
from spinfilters.estimators.landmarks.belief import LandmarkBelief
from spinfilters.estimators.smoothing.marginals import Marginals
from spinfilters.state.layout import StateLayout


@dataclass(frozen=True)
class LandmarkSmoothing:
    """The most probable motion of the first k frames and the landmarks that tell it.

    Attributes
    ----------
    mean: (k, m).   factor: (k, n, n) of each frame's covariance given all first frames; not finite where there is none.
    ids: (L,) landmarks that at least two believed sightings tell.   points: (L, 3) m, frame g.
    cost: sum of squared whitened residuals about the mean, prior and dynamics included.
    dof: scalar measurements less three per landmark: what the least cost is expected to be.
    rejected: sightings outside the gate.   used: per frame, which of its sightings count.
    marginals: covariances of everything, or None where some direction is not determined.
    """

    layout: StateLayout
    mean: Float[np.ndarray, "k m"]
    factor: Float[np.ndarray, "k n n"]
    ids: Int[np.ndarray, " L"]
    points: Float[np.ndarray, "L 3"]
    cost: float
    dof: int
    rejected: int
    iterations: int
    converged: bool
    used: tuple[Bool[np.ndarray, " _"], ...]
    counts: Int[np.ndarray, " L"]
    marginals: Marginals | None

    def hits(self, ids: Int[np.ndarray, " q"]) -> Int[np.ndarray, " q"]:
        """How many sightings of each landmark count; 0 for one that is not in the fit."""
        where, known = self._rows(ids)
        return np.where(known, self.counts[where], 0)

    def joint(self, ids: Int[np.ndarray, " q"]) -> LandmarkBelief:
        """Belief over the last frame's state and these landmarks, given all first frames.

        Raises
        ------
        InputError: for a landmark that is not in the fit.
        """
        where, known = self._rows(ids)
        if not known.all():
            raise InputError(
                f"landmarks {np.asarray(ids)[~known].tolist()} are not in the fit; choose among its ids"
            )
        if self.marginals is None:
            size = self.factor.shape[1] + 3 * len(where)
            nothing = np.full((size, size), np.nan)
            return LandmarkBelief(self.layout, self.mean[-1], self.ids[where], self.points[where], nothing)
        return LandmarkBelief(
            self.layout, self.mean[-1], self.ids[where], self.points[where], self._joint_factor(where)
        )

    def _joint_factor(self, where: Int[np.ndarray, " q"]) -> Float[np.ndarray, "j j"]:
        assert self.marginals is not None
        assert self.marginals.eliminated is not None
        rows = self.marginals.frame_rows(len(self.mean) - 1)
        told = np.flatnonzero(self.marginals.eliminated.told)
        follow, out = self.marginals.landmark_rows(told[where])
        size, width = 3 * len(where), follow.shape[2]
        own = np.zeros((len(where), 3, len(where), 3))
        own[np.arange(len(where)), :, np.arange(len(where))] = out
        top = np.concatenate([rows, np.zeros((len(rows), size))], axis=1)
        gap = np.zeros((size, rows.shape[1] - width))
        below = np.concatenate([follow.reshape(size, width), gap, own.reshape(size, size)], axis=1)
        return triangular_factor(np.concatenate([top, below]).T)

    def _rows(self, ids: Int[np.ndarray, " q"]) -> tuple[Int[np.ndarray, " q"], Bool[np.ndarray, " q"]]:
        where = np.clip(np.searchsorted(self.ids, ids), 0, max(len(self.ids) - 1, 0))
        return where, self.ids[where] == ids
