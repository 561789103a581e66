"""Observability Gramian and Cramer-Rao bound along a true motion, with process noise and priors.

The posterior bound is the covariance of the information recursion linearised at the truth (Tichavsky, Muravchik, Nehorai 1998). It
is carried as a triangular root of the information, one QR factorisation per frame, so that no information is subtracted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import qr, solve_triangular

from observability.bounds.flight import Flight, Watch, rows_at
from spinfilters.errors import InputError, ShapeError
from spinfilters.linear_algebra.signs import with_largest_positive
from spinfilters.state.layout import StateLayout

PRIOR_STD: Mapping[str, float] = {"t": 1e-6, "a": 1e-6, "v": 1.0, "w": 10.0, "c": 1.0, "s": 3.0, "d": 1.0}
"""Of the first frame: the pose of g is known by definition, the rest hardly (m, rad, m/s, rad/s, m, 1, 1/rad)."""
LANDMARK_STD = 1.0
"""Prior of an unknown landmark's coordinates, m."""


@dataclass(frozen=True)
class Bound:
    """Cramer-Rao bound of every frame.

    Attributes
    ----------
    layout: of the state.   prior_std: (n,) of all unknowns in the first frame.
    std: (frames, n) of the state's error, then of the sensors' unknowns.
    covariances: (frames, e, e) of the state's error.
    """

    layout: StateLayout
    prior_std: Float[np.ndarray, " n"]
    std: Float[np.ndarray, "frames n"]
    covariances: Float[np.ndarray, "frames e e"]

    def block(self, name: str) -> Float[np.ndarray, "frames b"]:
        """Standard deviations of one block."""
        return self.std[:, self.layout.slice(name)]

    @property
    def weak_direction(self) -> tuple[Float[np.ndarray, " e"], float]:
        """The direction of the state of which least was learnt, in prior deviations, and what part of the prior remains of it.

        The pose is left out: its prior is a definition. With P the bound and S the prior this is the top eigenvector of
        S^-1/2 P S^-1/2 over the other blocks; the second result is the square root of its eigenvalue.
        """
        free = [k for block in self.layout.blocks if block not in "ta" for k in _range(self.layout, block)]
        scale = self.prior_std[free]
        values, vectors = np.linalg.eigh(self.covariances[-1][np.ix_(free, free)] / np.outer(scale, scale))
        direction = np.zeros(self.layout.error_dim)
        direction[free] = with_largest_positive(vectors[:, -1])
        return direction, float(np.sqrt(values[-1]))


def cramer_rao_bound(
    flight: Flight,
    watches: Sequence[Watch],
    prior_std: Mapping[str, float] = PRIOR_STD,
    landmark_std: float = LANDMARK_STD,
) -> Bound:
    """The bound along a flight.

    Parameters
    ----------
    prior_std: of every block of the layout in the first frame, positive.   landmark_std: of every unknown parameter.

    Raises
    ------
    InputError, ShapeError: for no sensors, sensors over other frames, or priors that are missing or not positive.
    """
    starts, total = _columns(flight, watches)
    prior = prior_deviations(flight.process.layout, total, prior_std, landmark_std)
    root, deviations, covariances = np.diag(1 / prior), [], []
    n = flight.process.layout.error_dim
    for frame, x in enumerate(flight.states):
        if frame:
            root = _predicted(flight, frame, root)
        rows = [rows_at(watch, frame, x, start, total) for watch, start in zip(watches, starts, strict=True)]
        root = _triangular(np.concatenate([root, *rows]), total)
        inverse = solve_triangular(root, np.eye(total), check_finite=False)
        deviations.append(np.sqrt(np.einsum("ij,ij->i", inverse, inverse)))
        covariances.append(inverse[:n] @ inverse[:n].T)
    return Bound(flight.process.layout, prior, np.stack(deviations), np.stack(covariances))


def observability_gramian(flight: Flight, watches: Sequence[Watch]) -> Float[np.ndarray, "n n"]:
    """sum of Phi' H' R^-1 H Phi over frames: information about the first state and the unknown parameters, no noise, no prior."""
    starts, total = _columns(flight, watches)
    n, transition = flight.process.layout.error_dim, np.eye(total)
    gramian = np.zeros((total, total))
    for frame, x in enumerate(flight.states):
        if frame:
            step = flight.process.linearise(flight.states[frame - 1], _interval(flight, frame))[1]
            transition[:n] = step @ transition[:n]
        for watch, start in zip(watches, starts, strict=True):
            rows = rows_at(watch, frame, x, start, total) @ transition
            gramian += rows.T @ rows
    return gramian


def prior_deviations(
    layout: StateLayout, total: int, prior_std: Mapping[str, float], landmark_std: float
) -> Float[np.ndarray, " n"]:
    """Standard deviations of all unknowns in the first frame."""
    deviations = np.full(total, landmark_std)
    for block in layout.blocks:
        if block not in prior_std:
            raise InputError(
                f"the prior names {', '.join(prior_std)} and not block {block}; give its standard deviation"
            )
        deviations[layout.slice(block)] = prior_std[block]
    if not np.all(np.isfinite(deviations) & (deviations > 0)):
        raise InputError(
            "prior standard deviations must be positive and finite; give a large one for what is unknown"
        )
    return deviations


def _predicted(flight: Flight, frame: int, root: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """Root of the information about the next state: x' = Phi x + G n with n standard normal, n marginalised by one QR."""
    n, total = flight.process.layout.error_dim, len(root)
    _, transition, entry = flight.process.linearise(flight.states[frame - 1], _interval(flight, frame))
    back = root.copy()
    back[:, :n] = np.linalg.solve(transition.T, root[:, :n].T).T
    noise = entry.shape[1]
    stacked = np.block([[np.eye(noise), np.zeros((noise, total))], [-back[:, :n] @ entry, back]])
    return _triangular(stacked, noise + total)[noise:, noise:]


def _interval(flight: Flight, frame: int) -> float:
    return float(flight.time[frame] - flight.time[frame - 1])


def _triangular(stacked: Float[np.ndarray, "k n"], size: int) -> Float[np.ndarray, "n n"]:
    return np.asarray(qr(stacked, mode="r", overwrite_a=True, check_finite=False)[0])[:size]


def _columns(flight: Flight, watches: Sequence[Watch]) -> tuple[list[int], int]:
    """Where every sensor's own unknowns start, and how many unknowns there are."""
    if not watches:
        raise InputError("nothing is measured: give at least one sensor")
    start, starts = flight.process.layout.error_dim, []
    for watch in watches:
        if len(watch.seen) != len(flight.time):
            raise ShapeError(
                f"{watch.model.name} sees {len(watch.seen)} frames of a flight of {len(flight.time)}"
            )
        starts.append(start)
        start += watch.own
    return starts, start


def _range(layout: StateLayout, block: str) -> range:
    where = layout.slice(block)
    return range(where.start, where.stop)
