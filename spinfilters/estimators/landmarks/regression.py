"""Observations of landmarks by statistical linear regression on sigma points of the pose and of each landmark.

(Lefebvre, Bruyninckx, De Schutter 2002.) The pose moves with the first s coordinates of the factor; a landmark with them, and with
three coordinates of what else it depends on: later coordinates of the modes, and its own error. What the regression leaves is
noise.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.gain import last_nonzero
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
        o, n = self.observations, self.observations.layout.error_dim
        pose = self.factor[o.sensor.columns]
        s = last_nonzero(pose)
        modes = self.factor[n : n + o.modes.shape[2]]
        shared, late = o.modes @ modes[:, :s], modes[:, s:]
        rest = o.modes @ (late @ late.T) @ np.swapaxes(o.modes, 1, 2)
        own = np.linalg.cholesky(rest + o.roots @ np.swapaxes(o.roots, 1, 2))
        points = sigma_points(s + 3, options)
        away, valid, log_noise = self._away(points, s, np.concatenate([shared, own], axis=2))
        mean = away @ points.mean_weights
        slope, left = points.regressed(mean[..., None] - away)
        by_landmark = np.swapaxes(
            np.linalg.solve(np.swapaxes(own, 1, 2), np.swapaxes(slope[..., s:], 1, 2)), 1, 2
        )
        by_pose = slope[..., :s] - by_landmark @ shared
        flat = by_pose.reshape(-1, s).T
        by_state = np.linalg.lstsq(pose[:, :s].T, flat, rcond=None)[0].T.reshape(
            *by_pose.shape[:2], len(pose)
        )
        root = np.linalg.cholesky(np.eye(left.shape[1]) + left @ np.swapaxes(left, 1, 2))
        rows = np.linalg.solve(root, np.concatenate([by_state, by_landmark, mean[..., None]], axis=2))
        log_noise = log_noise + np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        return LinearRows(rows, valid & np.isfinite(rows).all(axis=(1, 2)), log_noise)

    def _away(
        self, points: SigmaPoints, s: int, spread: Float[np.ndarray, "k 3 q"]
    ) -> tuple[Float[np.ndarray, "k d p"], np.ndarray, Float[np.ndarray, " k"]]:
        """Whitened innovations at every point, where all are valid, and the noise's log determinants at the centre."""
        o, k, p = self.observations, len(self.observations.values), len(points.offsets)
        n = o.layout.error_dim
        states = o.layout.retract(self.mean, points.offsets[:, :s] @ self.factor[:n, :s].T)
        places = o.points + np.einsum("pj,kij->pki", points.offsets, spread)
        each = np.tile(np.arange(k), p)
        away, valid, log_noise = o.sensor.sighting_innovations(
            states,
            places.reshape(-1, 3),
            o.parameters[:, 3:],
            o.values,
            rows=(np.repeat(np.arange(p), k), None, each, each),
        )
        good = np.logical_and.reduce(valid.reshape(p, k) > 0, axis=0)
        return np.moveaxis(away.reshape(p, k, o.sensor.dim), 0, 2), good, log_noise.reshape(p, k)[0]
