"""What a smoother of the first frames with landmarks hands over."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.estimators.landmarks.belief import LandmarkBelief
from spinfilters.estimators.landmarks.landmark_map import LandmarkOptions
from spinfilters.estimators.landmarks.shared_modes import HeldErrors, SharedErrors, shared_modes
from spinfilters.estimators.smoothing.marginals import Marginals
from spinfilters.models.gauge import GAUGE_DIM
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

    def belief(self, options: LandmarkOptions) -> LandmarkBelief:
        """Belief over the last frame's state and all landmarks, given all first frames; not finite where there is none."""
        mean, n = self.mean[-1], self.layout.error_dim
        if self.marginals is None:
            nothing = np.full((len(self.ids), 3, 3), np.nan)
            held = HeldErrors(nothing[:, :, :1], nothing, np.full((n + 1, n + 1), np.nan))
        else:
            assert self.marginals.eliminated is not None
            rows = self.marginals.frame_rows(len(self.mean) - 1)
            told = np.flatnonzero(self.marginals.eliminated.told)
            every = SharedErrors(self.layout, mean, self.points, rows, *self.marginals.landmark_rows(told))
            held = shared_modes(every, options)
        return LandmarkBelief(
            self.layout,
            mean,
            self.ids,
            self.points,
            held.modes,
            held.roots,
            held.factor,
            np.zeros(GAUGE_DIM),
        )

    def _rows(self, ids: Int[np.ndarray, " q"]) -> tuple[Int[np.ndarray, " q"], Bool[np.ndarray, " q"]]:
        where = np.clip(np.searchsorted(self.ids, ids), 0, max(len(self.ids) - 1, 0))
        return where, self.ids[where] == ids
