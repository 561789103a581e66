"""A filter with the landmarks in its state."""

from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from spinfilters.attitude.conversions import rotate
from spinfilters.errors import InputError
from spinfilters.estimators.adaptation import AdaptationOptions, NoiseAdaptation, PredictedMotion
from spinfilters.estimators.estimator import (
    Estimator,
    MapChange,
    Measurement,
    ProcessModel,
    Snapshot,
    UpdateReport,
)
from spinfilters.estimators.gain import LOG_2_PI, compressed, lower_roots, triangular_factor
from spinfilters.estimators.landmarks.approximation import Approximation
from spinfilters.estimators.landmarks.belief import LandmarkBelief
from spinfilters.estimators.landmarks.gauge_rules import gauge_rule
from spinfilters.estimators.landmarks.joint_factor import (
    JointCorrection,
    after_correction,
    corrected_state,
    extended,
    moved,
    propagated,
    reduced,
)
from spinfilters.estimators.landmarks.joint_update import JointUpdate, SightingProblem
from spinfilters.estimators.landmarks.landmark_map import CONFIRMED, LandmarkMap, LandmarkOptions
from spinfilters.estimators.landmarks.sightings import JointState, guarded_weights
from spinfilters.estimators.robustness import RobustOptions, SensorGuard, SensorGuards
from spinfilters.models.anchored_point import anchored_coordinates, anchored_points
from spinfilters.models.landmark_sensor import LandmarkSensor
from spinfilters.state.gaussian import Gaussian

NEAREST_DEPTH = 0.05
"""Of a landmark before its anchor, m."""
SMALLEST_INVERSE_DEPTH = 1e-6
"""1/m; a landmark that an update has taken farther is at infinity or beyond: its next sighting makes it anew."""

NO_IDS = np.zeros(0, dtype=np.int64)
NOTHING_CHANGED = MapChange(NO_IDS, np.zeros(0), NO_IDS, NO_IDS)
"""What an update that could not be made did to the map."""


class LandmarkFilter(Estimator):
    """Pose, motion, centre of mass, mass distribution and map in one state, from sightings alone.

    The error covariance of all of it is held as one lower triangular factor (`joint_factor`); the state leads it, so that its own
    factor is the leading block. What is nonlinear is left to the approximation: first order (MEKF) or unscented (UKF).

    Parameters
    ----------
    process: of the state; landmarks do not move.
    approximation: `FirstOrder()` or `Unscented()`.
    options: of the map and of its factor.   robust: gate and weights of measured values.
    adaptation: of stated noise to what is seen.
    """

    def __init__(
        self,
        process: ProcessModel,
        approximation: Approximation,
        options: LandmarkOptions | None = None,
        robust: RobustOptions | None = None,
        adaptation: AdaptationOptions | None = None,
    ) -> None:
        super().__init__(process)
        self.name = approximation.name
        self.options = options or LandmarkOptions()
        self._approximation = approximation
        self._rule = gauge_rule(self.options.gauge)
        self._map = LandmarkMap()
        self._guards = SensorGuards(robust or RobustOptions())
        self._adaptation = NoiseAdaptation(adaptation or AdaptationOptions())
        self._mean = np.zeros(0)
        self._factor = np.zeros((0, 0))

    def start(self, belief: Gaussian | LandmarkBelief) -> None:
        if belief.layout != self.layout:
            raise InputError(
                f"belief has the blocks {belief.layout.blocks}, the process has {self.layout.blocks}"
            )
        self._mean, self._map = belief.mean.copy(), LandmarkMap()
        self._guards = SensorGuards(self._guards.options)
        self._adaptation = NoiseAdaptation(self._adaptation.options)
        rows = belief.factor.copy()
        if isinstance(belief, LandmarkBelief):
            n, anchors = self.layout.error_dim, self._anchors(belief.points)
            coordinates = anchored_coordinates(anchors, belief.points)
            slopes = anchored_points(anchors, coordinates)[1]
            rows[n:] = np.linalg.solve(slopes, rows[n:].reshape(-1, 3, len(rows))).reshape(-1, len(rows))
            self._map.append(belief.ids.astype(np.int64), anchors, coordinates, CONFIRMED)
        self._factor = np.ascontiguousarray(triangular_factor(rows.T), dtype=self.options.precision)

    @property
    def belief(self) -> Gaussian:
        return Gaussian(self.layout, self._mean, self._root)

    @property
    def landmark_belief(self) -> LandmarkBelief:
        """State and landmarks together, these in metres in frame g."""
        n, factor = self.layout.error_dim, self._factor.astype(float)
        points, slopes = anchored_points(self._map.anchors, self._map.coordinates)
        factor[n:] = (slopes @ factor[n:].reshape(-1, 3, len(factor))).reshape(-1, len(factor))
        return LandmarkBelief(self.layout, self._mean, self._map.ids, points, triangular_factor(factor.T))

    @property
    def held(self) -> Int[np.ndarray, " k"]:
        """Ids of the landmarks in the state, in its order."""
        return self._map.ids

    def predict(self, dt: float) -> None:
        self._guards.pass_time()
        self._adaptation.observe_motion(self.layout, self._mean, self._root)
        step = self._approximation.propagate(self.process, self._mean, self._root, dt)
        noise = self._adaptation.scaled(step.noise)
        self._mean = step.mean
        self._factor = propagated(self._factor, step.by_root, np.concatenate([step.rest, noise], axis=1))
        self._adaptation.expect_motion(PredictedMotion(step.mean, self._root, step.transition, noise))

    def update(self, measurement: Measurement) -> UpdateReport:
        keys = measurement.parameters if measurement.ids is None else measurement.ids
        guard = self._guards.of(measurement.model.name)
        if guard.frames.repeats(keys, measurement.values):
            return UpdateReport(0.0, 0, 0, len(measurement.values), map_change=NOTHING_CHANGED)
        if measurement.ids is None:
            return self._read(measurement, guard)
        return self._sight(measurement, measurement.ids, guard)

    def _read(self, measurement: Measurement, guard: SensorGuard) -> UpdateReport:
        """A sensor that sees no landmark."""
        place = self._joint.seen_from(np.zeros(0, dtype=np.int64))
        sensor, values, parameters = measurement.model, measurement.values, measurement.parameters
        rows = self._approximation.readings(sensor, place, values, parameters)
        rows = rows.scaled(self._adaptation.measurement_scale(sensor.name))
        weights = guarded_weights(guard, rows, np.zeros((len(values), 0, 0)))
        use = weights > 0
        scale = np.sqrt(weights[use])[:, None]
        rho = (rows.innovation[use] * scale).reshape(-1)
        every = (rows.by_state[use] * scale[..., None]).reshape(-1, self.layout.error_dim)
        rho, every, rest = compressed(rho, every)
        dtype = self._factor.dtype
        correction = corrected_state(every.astype(dtype), rho.astype(dtype))
        found = JointUpdate(rows, weights, replace(correction, nis=correction.nis + rest))
        if not self._apply(found.correction):
            return UpdateReport(0.0, 0, 0, len(values))
        self._adaptation.observe_measurement(sensor.name, found)
        return _report(found)

    def _sight(
        self, measurement: Measurement, ids: Int[np.ndarray, " k"], guard: SensorGuard
    ) -> UpdateReport:
        self._map.frame += 1
        at = self._map.locate(ids)
        order = np.flatnonzero(at >= 0)
        order = order[np.argsort(at[order], kind="stable")]
        scale = self._adaptation.measurement_scale(measurement.model.name)
        problem = SightingProblem(
            self.layout,
            self._approximation,
            self._rule,
            self._joint,
            _only(measurement, order),
            at[order],
            scale,
        )
        found = problem.solve(
            lambda rows, rest: guarded_weights(guard, rows, rest), self._approximation.iteration
        )
        if not self._apply(found.correction):
            return UpdateReport(0.0, 0, 0, len(ids), map_change=NOTHING_CHANGED)
        self._adaptation.observe_measurement(measurement.model.name, found)
        used = found.weights > 0
        self._map.record(at[order], used)
        removed = self._drop(~self._map.mistaken & (self._map.coordinates[:, 2] > SMALLEST_INVERSE_DEPTH))
        newcomers = np.flatnonzero((at < 0) | np.isin(ids, removed))
        added, replaced = self._take_in(_only(measurement, newcomers), ids[newcomers])
        removed = np.concatenate([removed, replaced])
        return _report(found, MapChange(ids[order][used], found.weights[used], added, removed))

    def _apply(self, correction: JointCorrection) -> bool:
        """Fold the correction into the point and carry the factor there; False, and nothing done, if that is not finite."""
        joint, layout = self._joint, self.layout
        error, there = joint.displaced(layout, correction.coordinates)
        if not (np.isfinite(there.mean).all() and np.isfinite(there.coordinates).all()):
            return False
        state, landmarks = self._rule.carried(layout, joint.here, there, layout.reset_jacobian(error))
        factor = moved(after_correction(self._factor, correction), state, landmarks)
        if not np.isfinite(factor).all():
            return False
        self._mean, self._map.coordinates, self._factor = there.mean, there.coordinates, factor
        return True

    def _take_in(
        self, measurement: Measurement, ids: Int[np.ndarray, " q"]
    ) -> tuple[Int[np.ndarray, " a"], Int[np.ndarray, " r"]]:
        """Take in newcomers as there is room or as they replace others; returns the ids that came and went."""
        sensor = measurement.model
        assert isinstance(sensor, LandmarkSensor)
        fresh = sensor.new_landmarks(self._mean, measurement.parameters, measurement.values)
        good = np.flatnonzero(fresh.determined & np.isfinite(fresh.points).all(axis=1))
        self._map.note(ids[good])
        chosen, stay = self._map.admission(ids[good], self.options)
        removed = self._drop(stay)
        chosen = good[chosen]
        points = fresh.points[chosen]
        anchors = self._anchors(points)
        coordinates = anchored_coordinates(anchors, points)
        slopes = anchored_points(anchors, coordinates)[1]
        by_state = np.linalg.solve(slopes, fresh.jacobian[chosen]) @ self._root[sensor.columns]
        own = np.linalg.solve(
            slopes, np.sqrt(self._adaptation.measurement_scale(sensor.name)) * fresh.root[chosen]
        )
        n = self.layout.error_dim
        self._factor = extended(self._factor, by_state.reshape(-1, n), lower_roots(own))
        self._map.append(ids[chosen], anchors, coordinates)
        return ids[chosen], removed

    def _anchors(self, points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 7"]:
        """The present pose, moved back along the line of sight until every point lies in front of it."""
        layout = self.layout
        t, q = self._mean[layout.mean_slice("t")].copy(), self._mean[layout.mean_slice("a")]
        if len(points):
            nearest = float((t + rotate(q, points))[:, 2].min())
            t[2] += max(0.0, NEAREST_DEPTH - nearest)
        return np.tile(np.concatenate([t, q]), (len(points), 1))

    def _drop(self, stay: np.ndarray) -> Int[np.ndarray, " r"]:
        removed = self._map.ids[~stay]
        if removed.size:
            self._factor = reduced(self._factor, self.layout.error_dim, stay)
            self._map.keep(stay)
        return removed

    @property
    def _joint(self) -> JointState:
        here = self._map.coordinates
        at = self._rule.linearised_at(here, self._map.first)
        return JointState(self._mean, self._map.anchors, here, at, self._factor)

    @property
    def _root(self) -> Float[np.ndarray, "n n"]:
        return self._joint.root

    def snapshot(self) -> Snapshot:
        named = {f"map.{name}": np.array(value) for name, value in vars(self._map).items()}
        return {
            "mean": self._mean.copy(),
            "factor": self._factor.copy(),
            **named,
            **self._guards.snapshot(),
            **self._adaptation.snapshot(),
        }

    def restore(self, snapshot: Snapshot) -> None:
        self._mean, self._factor = snapshot["mean"].copy(), snapshot["factor"].copy()
        mapped = [name for name in snapshot if name.startswith("map.")]
        named: dict[str, Any] = {name.removeprefix("map."): snapshot[name].copy() for name in mapped}
        named["frame"] = int(named["frame"])
        self._map = LandmarkMap(**named)
        self._guards.restore(snapshot)
        self._adaptation.restore(snapshot)


def _report(found: JointUpdate, change: MapChange | None = None) -> UpdateReport:
    used = found.weights > 0
    accepted = int(np.count_nonzero(used))
    dim = found.rows.innovation.shape[1]
    log_noise = float(found.rows.log_noise[used].sum() - 0.5 * dim * np.log(found.weights[used]).sum())
    likelihood = -0.5 * (found.nis + found.dof * LOG_2_PI) - found.correction.log_root - log_noise
    return UpdateReport(found.nis, found.dof, accepted, len(used) - accepted, likelihood, change)


def _only(measurement: Measurement, rows: Int[np.ndarray, " q"]) -> Measurement:
    return Measurement(measurement.model, measurement.values[rows], measurement.parameters[rows])
