"""Modes that the landmarks of a smoothed start share, from their joint covariance, and the options of filters with landmarks."""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from jaxtyping import Float
from scipy.linalg import eigh

from spinfilters.core.errors import InputError
from spinfilters.filters.estimator import LandmarkBelief
from spinfilters.filters.square_root import lower_roots, triangular_factor
from spinfilters.io.stated_values import NumberRange
from spinfilters.models.gauge import GAUGE_DIM, GAUGE_STD, gauge_directions, gauge_of_points
from spinfilters.models.state_layout import StateLayout

PRECISIONS = ("float64", "float32")


@dataclass(frozen=True)
class LandmarkOptions:
    """Options of a filter with landmarks.

    Attributes
    ----------
    modes : int
        Largest number of error modes that all landmarks share and that the state contains.
    explained : float
        Least part of the landmarks' variance that a mode must explain to be kept, in squared deviations summed over the
        landmarks of the initialisation.
    largest_map : int
        Largest number of landmarks; those observed longest ago are dropped first.
    precision : str
        Precision of each landmark's arrays, "float64" or "float32".
    """

    modes: Annotated[int, NumberRange(1, 60, whole=True)] = 12
    explained: Annotated[float, NumberRange(0, 1e9)] = 0.5
    largest_map: Annotated[int, NumberRange(4, 10_000_000, whole=True)] = 20_000
    precision: str = "float64"

    def __post_init__(self) -> None:
        if not 1 <= self.modes <= 60 or self.largest_map < 4:
            raise InputError(
                f"landmarks.modes is {self.modes}, landmarks.largest_map is {self.largest_map}; give 1 to 60 modes and at least "
                "4 landmarks"
            )
        if not (np.isfinite(self.explained) and self.explained >= 0):
            raise InputError(f"landmarks.explained is {self.explained}; give a finite number of at least 0")
        if self.precision not in PRECISIONS:
            raise InputError(
                f"landmarks.precision {self.precision!r} is unknown; use one of {', '.join(PRECISIONS)}"
            )


@dataclass(frozen=True)
class SharedErrors:
    """Errors of a state and of k landmarks.

    state_rows y, and follow_i y + own_i e_i; y and e_i of unit covariance.

    Attributes
    ----------
    state_rows : ndarray of float, shape (n, w)
        Errors of the state by the coordinates y.
    follow : ndarray of float, shape (k, 3, R)
        Errors of the landmarks by the first R of the w coordinates.
    own : ndarray of float, shape (k, 3, 3)
        Square roots of the covariances of their own errors.
    """

    layout: StateLayout
    mean: Float[np.ndarray, " m"]
    points: Float[np.ndarray, "k 3"]
    state_rows: Float[np.ndarray, "n w"]
    follow: Float[np.ndarray, "k 3 R"]
    own: Float[np.ndarray, "k 3 3"]

    def in_frame_of_map(self) -> tuple["SharedErrors", Float[np.ndarray, "6 R"]]:
        """Errors in the frame that the landmarks together define, and those of frame g.

        The move gamma = sum of S_i follow_i y is the rigid motion nearest to what the landmarks share, each
        weighed by how well it is known; errors in the map's frame are those of g less what gamma makes of
        them.
        """
        k = len(self.points)
        weight = 1 / np.einsum("kij,kij->k", self.own, self.own)
        N = gauge_of_points(self.points).reshape(k, 3, GAUGE_DIM)
        turned = (weight[:, None, None] * N).reshape(3 * k, GAUGE_DIM).T
        normal, right = (
            turned @ N.reshape(3 * k, GAUGE_DIM),
            turned @ self.follow.reshape(3 * k, self.follow.shape[2]),
        )
        if not (np.isfinite(normal).all() and np.isfinite(right).all()):
            raise np.linalg.LinAlgError("errors of the map are not finite")
        # Least norm: landmarks on a line do not determine all of it.
        rigid = np.linalg.lstsq(normal, right, rcond=None)[0]
        rows = self.state_rows.copy()
        rows[:, : rigid.shape[1]] -= gauge_directions(self.layout, self.mean) @ rigid
        return replace(self, state_rows=rows, follow=self.follow - N @ rigid), rigid


@dataclass(frozen=True)
class HeldErrors:
    """Errors of a state and landmarks with few modes.

    modes (k, 3, r), roots (k, 3, 3), factor (n + r + 6, n + r + 6); see `LandmarkBelief`.
    """

    modes: Float[np.ndarray, "k 3 r"]
    roots: Float[np.ndarray, "k 3 3"]
    factor: Float[np.ndarray, "N N"]


def shared_modes(every: SharedErrors, options: LandmarkOptions) -> HeldErrors:
    """Modes that explain most of what the landmarks' errors share.

    Weighed by the landmarks' own errors; what is left out is added to those.
    """
    return _choose_modes(*every.in_frame_of_map(), options)


def anchored_at_pose(belief: LandmarkBelief, options: LandmarkOptions) -> LandmarkBelief:
    """Belief in the map frame that the present pose defines.

    Its error is then that of the gauge move alone.
    Where no landmark is known again, new ones share the error of the pose that they are first seen from. In the old frame that
    error stays in the state; every epoch would linearise it anew and take the differences for information. The pose keeps the
    deviation of one that defines a frame, as that of the first epoch has.
    """
    layout, modes, n = belief.layout, belief.modes, belief.layout.error_dim
    r, k, size = modes.shape[2], len(modes), len(belief.factor)
    state, shared, before = np.split(belief.factor, [n, n + r])
    directions = gauge_directions(layout, belief.mean)
    pose = np.r_[layout.slice("a"), layout.slice("t")]
    move = np.linalg.solve(directions[pose], state[pose])
    follow = modes.reshape(-1, r) @ shared - gauge_of_points(belief.points) @ move
    rows = np.concatenate([state - directions @ move, np.zeros((n, GAUGE_DIM))], axis=1)
    rows[pose] = 0.0  # but for rounding
    rows[pose, size:] = GAUGE_STD * np.eye(GAUGE_DIM)
    errors = SharedErrors(layout, belief.mean, belief.points, rows, follow.reshape(k, 3, size), belief.roots)
    held = _choose_modes(errors, move + before if len(before) else move, options)
    return replace(belief, modes=held.modes, roots=held.roots, factor=held.factor)


def _choose_modes(
    errors: SharedErrors, rigid: Float[np.ndarray, "6 R"], options: LandmarkOptions
) -> HeldErrors:
    k, R = len(errors.points), errors.follow.shape[2]
    # Errors whitened by the landmarks' own roots: eigenvectors of their Gram matrix are the modes, strongest first.
    own = lower_roots(errors.own)
    scaled = np.linalg.solve(own, errors.follow).reshape(3 * k, R)
    most = min(options.modes, R)
    explained, vectors = eigh(scaled.T @ scaled, subset_by_index=(R - most, R - 1))
    r = max(int(np.count_nonzero(explained >= options.explained)), 1)
    held = vectors[:, ::-1][:, :r]
    # Rows of the joint factor: state, modes (r), gauge move (6); the latter two have no part in the columns behind R.
    rows = np.zeros((len(errors.state_rows) + r + GAUGE_DIM, errors.state_rows.shape[1]))
    rows[: len(errors.state_rows)] = errors.state_rows
    rows[len(errors.state_rows) :, :R] = np.concatenate([held.T, rigid])
    # What the modes leave out, landmark by landmark, is added to its own covariance.
    rest = own @ (scaled - (scaled @ held) @ held.T).reshape(k, 3, R)
    roots = np.linalg.cholesky(own @ np.swapaxes(own, 1, 2) + rest @ np.swapaxes(rest, 1, 2))
    return HeldErrors(errors.follow @ held, roots, triangular_factor(rows.T))
