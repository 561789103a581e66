"""The unscented approximation: sigma points through what is nonlinear, regression on the joint factor's coordinates."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.estimators.estimator import ProcessModel
from spinfilters.estimators.gain import last_nonzero, lower_roots
from spinfilters.estimators.landmarks.approximation import Approximation, Propagation, Rows, SightedFrom
from spinfilters.estimators.multiplicative_ukf import SigmaPointOptions
from spinfilters.models.anchored_point import anchored_points
from spinfilters.models.landmark_sensor import LandmarkSensor
from spinfilters.models.measurement import MeasurementModel


class Unscented(Approximation):
    """Van der Merwe's scaled sigma points, set and weights from filterpy.

    Parameters
    ----------
    options: of the set; see `SigmaPointOptions.points` for what is refused.
    """

    name = "ukf"

    def __init__(self, options: SigmaPointOptions | None = None) -> None:
        self._options = options or SigmaPointOptions()
        _points(20, self._options)

    def propagate(
        self, process: ProcessModel, mean: Float[np.ndarray, " m"], root: Float[np.ndarray, "n n"], dt: float
    ) -> Propagation:
        layout, points = process.layout, _points(len(root), self._options)
        _, transition, noise = process.linearise(mean, dt)
        moved = process.step(layout.retract(mean, points.offsets @ root.T), dt)
        after = layout.retract(moved[0], points.mean_weights @ layout.local(moved[0], moved))
        by_root, rest = points.regressed(layout.local(after, moved).T)
        return Propagation(after, by_root, rest, noise, transition)

    def sightings(
        self,
        sensor: LandmarkSensor,
        place: SightedFrom,
        values: Float[np.ndarray, "k v"],
        parameters: Float[np.ndarray, "k p"],
    ) -> Rows:
        seen = last_nonzero(place.root[sensor.columns])
        points = _points(seen + 3, self._options)
        late = place.shared[:, :, seen:]
        own = lower_roots(np.concatenate([late, place.rest], axis=2))
        spread = np.einsum("pj,kij->pki", points.offsets[:, :seen], place.shared[:, :, :seen])
        spread += np.einsum("pj,kij->pki", points.offsets[:, seen:], own)
        moved = np.broadcast_to(parameters, (len(spread), *parameters.shape)).copy()
        moved[..., :3] = anchored_points(place.anchors, place.coordinates + spread)[0]
        rows = _regressed_rows(sensor, place, points, moved, values)
        by_landmark = np.linalg.solve(np.swapaxes(own, 1, 2), np.swapaxes(rows.by_state[:, :, seen:], 1, 2))
        by_landmark = np.swapaxes(by_landmark, 1, 2)
        by_state = np.concatenate([rows.by_state[:, :, :seen], by_landmark @ late], axis=2)
        return Rows(rows.innovation, by_state, by_landmark, rows.valid, rows.log_noise)

    def readings(
        self,
        sensor: MeasurementModel,
        place: SightedFrom,
        values: Float[np.ndarray, "k v"],
        parameters: Float[np.ndarray, "k p"],
    ) -> Rows:
        seen = last_nonzero(place.root[sensor.columns])
        points = _points(seen, self._options)
        moved = np.broadcast_to(parameters, (len(points.offsets), *parameters.shape))
        rows = _regressed_rows(sensor, place, points, moved, values)
        unseen = np.zeros((*rows.innovation.shape, len(place.root) - seen))
        by_state = np.concatenate([rows.by_state, unseen], axis=2)
        return Rows(rows.innovation, by_state, rows.by_landmark, rows.valid, rows.log_noise)


@dataclass(frozen=True)
class _PointSet:
    """A sigma-point set over n coordinates y.

    Attributes
    ----------
    offsets: (p, n).   mean_weights: (p,).   root_weights: (p,) square roots of the covariance weights.
    """

    offsets: Float[np.ndarray, "p n"]
    mean_weights: Float[np.ndarray, " p"]
    root_weights: Float[np.ndarray, " p"]

    def regressed(
        self, deviations: Float[np.ndarray, "*batch r p"]
    ) -> tuple[Float[np.ndarray, "*batch r n"], Float[np.ndarray, "*batch r p"]]:
        """(A, B) with covariance A A' + B B' of the weighted deviations, A their regression on y, B what is left."""
        weighted = deviations * self.root_weights
        scaled = self.offsets * self.root_weights[:, None]
        slope = weighted @ scaled
        return slope, weighted - slope @ scaled.T


@cache
def _points(n: int, options: SigmaPointOptions) -> _PointSet:
    merwe = options.points(n)
    return _PointSet(merwe.sigma_points(np.zeros(n), np.eye(n)), merwe.Wm, np.sqrt(merwe.Wc))


def _regressed_rows(
    sensor: MeasurementModel,
    place: SightedFrom,
    points: _PointSet,
    parameters: Float[np.ndarray, "p k q"],
    values: Float[np.ndarray, "k v"],
) -> Rows:
    """Innovations of every point, regressed; what the regression leaves is whitened together with the sensor's noise."""
    seen = last_nonzero(place.root[sensor.columns])
    steps = points.offsets[:, :seen] @ place.root[:, :seen].T
    states = sensor.layout.retract(place.mean, steps)[:, None]
    innovations, valid = sensor.innovations(states, parameters, values)
    whitening = sensor.whitening(place.mean, parameters[0])
    rows = np.einsum("kij,pkj->kip", whitening, innovations)
    mean = rows @ points.mean_weights
    slope, rest = points.regressed(mean[..., None] - rows)
    unit = np.broadcast_to(np.eye(rows.shape[1]), (len(rows), rows.shape[1], rows.shape[1]))
    root = lower_roots(np.concatenate([unit, rest], axis=2))
    both = np.linalg.solve(root, np.concatenate([mean[..., None], slope], axis=2))
    log_noise = _log_diagonal(root) - _log_diagonal(whitening)
    empty = np.zeros((*mean.shape, 0))
    return Rows(both[..., 0], both[..., 1:], empty, _all(valid), log_noise)


def _log_diagonal(roots: Float[np.ndarray, "k r r"]) -> Float[np.ndarray, " k"]:
    return np.log(np.abs(np.diagonal(roots, axis1=1, axis2=2))).sum(axis=1)


def _all(valid: Bool[np.ndarray, "p k"]) -> Bool[np.ndarray, " k"]:
    return np.logical_and.reduce(valid, axis=0)
