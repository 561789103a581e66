"""Data exchanged between the steps of a landmark update.

The error of landmark i is split, d_i = A_i m + e_i: modes m that all landmarks share, whose errors stand with those of the state
in one factor F (P = F F'), and e_i of its own, independent of everything, with covariance L_i L_i'. An observation of it depends on
the pose x (the sensor's columns of the state) and on the landmark,

    rho_i = H_x x + H_p (A_i m + e_i) + v_i = H_x x + H_p A_i m + w_i,   cov w_i = S_i = I / weight + H_p L_i L_i' H_p',

so that with S_i = T T' the rows T^-1 [H_x, H_p A_i] of all observations are a measurement of (x, m) with unit noise: `whitened` and
`corrected`. This is exact, as is what follows of the landmark, with X = T^-1 H_p L_i and K = L_i X' T^-1:

    e_i = K (rho_i - H_x x - H_p A_i m) + e_i',   cov e_i' = L_i (I - X'X) L_i'.

So it depends on the modes and on the pose of this epoch: d_i = B_i (x, m) + e_i'. `compress` finds as many new modes as there
were that explain most of what the (x, m) of all landmarks make of their observations: with (x, m) = R q, q of unit covariance,
and G the sum of squares of those observations by (x, m), the leading eigenvectors V of R'GR give the modes V'q. The others are
taken for every landmark's own (`observe`). Landmarks that were not observed follow with one transformation for all
(`landmark_map`).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int


class LinearisedObservations(NamedTuple):
    """Observations about a point, whitened by the sensor's noise.

    Attributes
    ----------
    rows: (k, d, c + 4) by the columns of the state, by the landmark (3), and the innovation.
    valid: (k,).   log_noise: (k,) log determinant of the sensor's noise factor.
    """

    rows: Float[np.ndarray, "k d w"]
    valid: Bool[np.ndarray, " k"]
    log_noise: Float[np.ndarray, " k"]


class AddedLandmarks(NamedTuple):
    """New landmarks: dependence on the shared modes, and own errors.

    Attributes
    ----------
    shared: how the modes of all landmarks change.   modes: (q, 3, r) of the new ones.
    roots: (q, 3, 3) square roots of their own covariance.
    """

    shared: "NewModes"
    modes: Float[np.ndarray, "q 3 r"]
    roots: Float[np.ndarray, "q 3 3"]


@dataclass(frozen=True)
class WhitenedLandmarks:
    """Observations of k landmarks, whitened by noise and the landmarks' own covariance.

    Attributes
    ----------
    kept: (g, s, l) of g groups of l landmarks, the last one filled up: numbers of `rows`, of X and of H_p L (d x 3).
    shape: (k, d, c + r + 1).
    log_noise: log determinant of all T, less that of the square roots of the weights.
    """

    kept: Float[np.ndarray, "g s l"]
    shape: tuple[int, int, int]
    log_noise: float

    @cached_property
    def rows(self) -> Float[np.ndarray, "k d w"]:
        """Rows by state columns and modes, with the innovation.

        c columns, r modes; of an epoch that is not closed.
        """
        count, d, width = self.shape
        return np.swapaxes(self.kept[:, : d * width], 1, 2).reshape(-1, d, width)[:count]


class NewModes(NamedTuple):
    """Next modes as combinations of the old ones.

    (x, m) = kept m' + dropped f, m' and f of unit covariance.

    Attributes
    ----------
    turned: (c + r, r + c) kept and dropped side by side.   rows: (r, N) of the modes' factor.
    explained: (r,) squares of standard deviations that each mode explains in observations.
    """

    turned: Float[np.ndarray, "q q"]
    rows: Float[np.ndarray, "r N"]
    explained: Float[np.ndarray, " r"]

    @property
    def kept(self) -> Float[np.ndarray, "q r"]:
        """Combinations that stay shared."""
        return self.turned[:, : len(self.rows)]

    @property
    def dropped(self) -> Float[np.ndarray, "q c"]:
        """Combinations that become every landmark's own."""
        return self.turned[:, len(self.rows) :]


class Closing(NamedTuple):
    """Transition of landmarks and modes at the end of an epoch.

    Attributes
    ----------
    at: (k,) rows of the observed landmarks, as in ``white``.
    error: (c + r,) of pose and modes.   factor: (c + r, N) its rows after the update.
    by_pose, roots: (q, 3, c), (q, 3, 3) of new landmarks, their dependence on the pose and their own root.
    remembered: (r,) what modes explained before, as far as it still counts.
    behind: rows of landmarks, first and last, whose turn it is to be brought up to date.
    """

    at: Int[np.ndarray, " k"]
    white: WhitenedLandmarks
    error: Float[np.ndarray, " p"]
    factor: Float[np.ndarray, "p N"]
    by_pose: Float[np.ndarray, "q 3 c"]
    roots: Float[np.ndarray, "q 3 3"]
    remembered: Float[np.ndarray, " r"]
    behind: tuple[int, int]
