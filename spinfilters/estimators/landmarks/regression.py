"""Statistical linear regression of landmark observations. On sigma points of the pose and of each landmark.

(Lefebvre, Bruyninckx, De Schutter 2002.) The pose moves with the first s coordinates of the factor; a landmark with them, and with
three coordinates of what else it depends on: later coordinates of the modes, and its own error. What the regression leaves is
noise.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.filters.sigma_points import SigmaPointOptions, SigmaPoints, sigma_points
from spinfilters.estimators.filters.square_root_update import (
    last_nonzero,
    lower_roots,
    triangular_factor,
)
from spinfilters.estimators.landmarks.steps import LinearisedObservations, MapObservations, PoseSpread
from spinfilters.linear_algebra.lapack import dtrtrs


@dataclass(frozen=True)
class Regression:
    """Observations from a state with this mean and lower triangular factor."""

    observations: MapObservations
    mean: Float[np.ndarray, " m"]
    factor: Float[np.ndarray, "N N"]

    def rows(self, options: SigmaPointOptions) -> LinearisedObservations:
        """Rows of `MapObservations.rows_at` by statistical regression."""
        o, n = self.observations, self.observations.layout.error_dim
        pose, modes = self.factor[o.sensor.columns], self.factor[n : n + o.landmarks.rank]
        s = last_nonzero(pose)
        points = sigma_points(s + 3, options)
        states = o.layout.retract(self.mean, points.offsets[:, :s] @ self.factor[:n, :s].T)
        spread = Spread(states, pose[:, :s], modes[:, :s], triangular_factor(modes[:, s:].T))
        found = o.landmarks.steps.regressed(o, spread, points)
        return spread.regressed(o, points) if found is None else found


class Spread(PoseSpread):
    """States and landmarks moved by sigma points, and the regression over them."""

    def regressed(self, o: MapObservations, points: SigmaPoints) -> LinearisedObservations:
        """Observations regressed on errors of the pose, the modes and the landmark."""
        s, shared = self.pose.shape[1], o.modes @ self.modes
        own = lower_roots(np.concatenate([o.modes @ self.late, o.roots], axis=2))
        away, valid, log_noise = self._away(o, points, np.concatenate([shared, own], axis=2))
        mean = away @ points.mean_weights
        slope, left = points.regressed(mean[..., None] - away)
        by_landmark = _divided_by_lower(slope[..., s:], own)
        by_pose = slope[..., :s] - by_landmark @ shared
        by_state = self._by_errors(by_pose.reshape(-1, s)).reshape(*mean.shape, len(self.pose))
        root = np.linalg.cholesky(np.eye(left.shape[1]) + left @ np.swapaxes(left, 1, 2))
        every = np.concatenate([by_state, by_landmark, mean[..., None]], axis=2)
        rows = _solved_by_lower(root, every)
        log_noise = log_noise + np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        return LinearisedObservations(rows, valid & np.isfinite(rows).all(axis=(1, 2)), log_noise)

    def _away(
        self, o: MapObservations, points: SigmaPoints, moves: Float[np.ndarray, "k 3 q"]
    ) -> tuple[Float[np.ndarray, "k d p"], np.ndarray, Float[np.ndarray, " k"]]:
        """Whitened innovations at every point, and log determinants at the centre.

        Zeros where not all are valid; determinants of the noise.
        """
        k, p = len(o.values), len(points.offsets)
        moved = points.offsets @ moves.reshape(3 * k, moves.shape[2]).T
        places, each = o.points + moved.reshape(p, k, 3), np.tile(np.arange(k), p)
        away, valid, determinant = o.sensor.observation_innovations(
            self.states,
            places.reshape(-1, 3),
            o.parameters[:, 3:],
            o.values,
            rows=(np.repeat(np.arange(p), k), None, each, each),
        )
        away = np.moveaxis(away.reshape(p, k, o.sensor.dim), 0, 2)
        good = np.logical_and.reduce(valid.reshape(p, k) > 0, axis=0) & np.isfinite(away).all(axis=(1, 2))
        return np.where(good[:, None, None], away, 0.0), good, np.log(determinant[:k, 0])

    def _by_errors(self, by_coordinates: Float[np.ndarray, "q s"]) -> Float[np.ndarray, "q c"]:
        """X of least squares with X pose = by_coordinates."""
        if self.is_solvable:
            return dtrtrs(self.pose, by_coordinates.T, lower=1, trans=1)[0].T
        return np.linalg.lstsq(self.pose.T, by_coordinates.T, rcond=None)[0].T


def _solved_by_lower(
    root: Float[np.ndarray, "k d d"], right: Float[np.ndarray, "k d q"]
) -> Float[np.ndarray, "k d q"]:
    """root^-1 right of lower triangular matrices, by batched substitution.

    0 for a pivot of 0.
    """
    result = np.zeros(right.shape)
    for j in range(root.shape[1]):
        known = sum(root[:, j, i, None] * result[:, i] for i in range(j))
        pivot = root[:, j, j, None]
        np.divide(right[:, j] - known, pivot, out=result[:, j], where=pivot != 0)
    return result


def _divided_by_lower(
    left: Float[np.ndarray, "k q d"], root: Float[np.ndarray, "k d d"]
) -> Float[np.ndarray, "k q d"]:
    """left root^-1, likewise."""
    flipped = np.swapaxes(root, 1, 2)[:, ::-1, ::-1]
    return np.swapaxes(_solved_by_lower(flipped, np.swapaxes(left, 1, 2)[:, ::-1])[:, ::-1], 1, 2)
