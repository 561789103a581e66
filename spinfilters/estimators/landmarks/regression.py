"""Observations of landmarks by statistical linear regression on sigma points of the pose and of each landmark.

(Lefebvre, Bruyninckx, De Schutter 2002.) The pose moves with the first s coordinates of the factor; a landmark with them, and with
three coordinates of what else it depends on: later coordinates of the modes, and its own error. What the regression leaves is
noise.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg.lapack import dtrtrs

from spinfilters.estimators.gain import is_lower, last_nonzero
from spinfilters.estimators.landmarks.observations import LinearRows, Observations
from spinfilters.estimators.sigma_points import SigmaPointOptions, SigmaPoints, sigma_points


@dataclass(frozen=True)
class Regression:
    """Observations from a state with this mean and lower triangular factor."""

    observations: Observations
    mean: Float[np.ndarray, " m"]
    factor: Float[np.ndarray, "N N"]

    def rows(self, options: SigmaPointOptions) -> LinearRows:
        """What `Observations.rows_at` gives, by regression."""
        o, n, r = self.observations, self.observations.layout.error_dim, self.observations.modes.shape[2]
        pose, k = self.factor[o.sensor.columns], len(o.at)
        s, modes = last_nonzero(pose), self.factor[n : n + r]
        late, A = modes[:, s:], o.modes.reshape(-1, r)
        shared = (A @ modes[:, :s]).reshape(k, 3, s)
        rest = (A @ (late @ late.T)).reshape(k, 3, r) @ np.swapaxes(o.modes, 1, 2)
        own = np.linalg.cholesky(rest + o.roots @ np.swapaxes(o.roots, 1, 2))
        points = sigma_points(s + 3, options)
        away, valid, log_noise = self._away(points, s, np.concatenate([shared, own], axis=2))
        mean = away @ points.mean_weights
        slope, left = points.regressed(mean[..., None] - away)
        by_landmark = _divided_by_lower(slope[..., s:], own)
        by_pose = slope[..., :s] - by_landmark @ shared
        by_state = _by_errors(by_pose.reshape(-1, s), pose[:, :s]).reshape(*mean.shape, len(pose))
        root = np.linalg.cholesky(np.eye(left.shape[1]) + left @ np.swapaxes(left, 1, 2))
        every = np.concatenate([by_state, by_landmark, mean[..., None]], axis=2)
        rows = _solved_by_lower(root, every)
        log_noise = log_noise + np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        return LinearRows(rows, valid & np.isfinite(rows).all(axis=(1, 2)), log_noise)

    def _away(
        self, points: SigmaPoints, s: int, spread: Float[np.ndarray, "k 3 q"]
    ) -> tuple[Float[np.ndarray, "k d p"], np.ndarray, Float[np.ndarray, " k"]]:
        """Whitened innovations at every point, where all are valid, and the noise's log determinants at the centre."""
        o, k, p = self.observations, len(self.observations.values), len(points.offsets)
        n = o.layout.error_dim
        states = o.layout.retract(self.mean, points.offsets[:, :s] @ self.factor[:n, :s].T)
        moved = points.offsets @ spread.reshape(3 * k, s + 3).T
        places, each = o.points + moved.reshape(p, k, 3), np.tile(np.arange(k), p)
        away, valid, log_noise = o.sensor.sighting_innovations(
            states,
            places.reshape(-1, 3),
            o.parameters[:, 3:],
            o.values,
            rows=(np.repeat(np.arange(p), k), None, each, each),
        )
        good = np.logical_and.reduce(valid.reshape(p, k) > 0, axis=0)
        return np.moveaxis(away.reshape(p, k, o.sensor.dim), 0, 2), good, log_noise.reshape(p, k)[0]


def _by_errors(
    by_coordinates: Float[np.ndarray, "q s"], pose: Float[np.ndarray, "c s"]
) -> Float[np.ndarray, "q c"]:
    """X of least squares with X pose = by_coordinates; pose is lower triangular where its columns lead the state."""
    if len(pose) == pose.shape[1] and is_lower(pose):
        found, failed = dtrtrs(pose, by_coordinates.T, lower=1, trans=1)
        if not failed:
            return found.T
    return np.linalg.lstsq(pose.T, by_coordinates.T, rcond=None)[0].T


def _solved_by_lower(
    root: Float[np.ndarray, "k d d"], right: Float[np.ndarray, "k d q"]
) -> Float[np.ndarray, "k d q"]:
    """root^-1 right of lower triangular matrices, by substitution in all of them at once."""
    rows = [right[:, 0] / root[:, 0, :1]]
    for j in range(1, root.shape[1]):
        known = sum(root[:, j, i, None] * row for i, row in enumerate(rows))
        rows.append((right[:, j] - known) / root[:, j, j, None])
    return np.stack(rows, axis=1)


def _divided_by_lower(
    left: Float[np.ndarray, "k q d"], root: Float[np.ndarray, "k d d"]
) -> Float[np.ndarray, "k q d"]:
    """left root^-1, likewise."""
    flipped = np.swapaxes(root, 1, 2)[:, ::-1, ::-1]
    return np.swapaxes(_solved_by_lower(flipped, np.swapaxes(left, 1, 2)[:, ::-1])[:, ::-1], 1, 2)
