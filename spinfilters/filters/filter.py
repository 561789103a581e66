"""Multiplicative filter: what the EKF and the UKF share."""

from abc import abstractmethod
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.errors import InputError
from spinfilters.filters.compiled_steps import MOST_NOISE, Update, compiled_propagation
from spinfilters.filters.estimator import (
    NO_IDS,
    Belief,
    Estimator,
    LandmarkBelief,
    MapChange,
    Measurement,
    ProcessModel,
    Snapshot,
    UpdateReport,
)
from spinfilters.filters.landmark_map import HeldMap
from spinfilters.filters.landmark_observations import SolvedObservations
from spinfilters.filters.landmark_steps import MapObservations
from spinfilters.filters.noise_levels import AdaptationOptions, NoiseAdaptation, NoiseScale, PredictedMotion
from spinfilters.filters.outlier_rejection import OutlierRejection, RobustOptions, SensorOutlierRejection
from spinfilters.filters.shared_modes import LandmarkOptions, anchored_at_pose
from spinfilters.filters.square_root import triangular_factor
from spinfilters.models.gauge import GAUGE_DIM, state_in_g
from spinfilters.models.state_layout import Gaussian, StateLayout

NOTHING_CHANGED = MapChange(NO_IDS, np.zeros(0), NO_IDS, NO_IDS)
"""What an update that could not be made did to the map."""


class MultiplicativeFilter(Estimator):
    """Recursive filter on the error state.

    The mean lies on the manifold, the square root of the error covariance in its tangent space.

    After an update the error is folded into the mean (4 x MRP on the body side) and the covariance moves with the derivative of
    that reset, so that it always refers to the present mean.

    Where landmarks are not known, the factor goes on behind the state's n rows: with r modes of error that all landmarks share, and
    with the move from the map's frame to frame g (`spinfilters.filters.landmark_map`). Neither changes with time, and no sensor
    without landmarks sees them; what the state learns, they learn by correlation.

    Parameters
    ----------
    process : ProcessModel
        The process model.
    robust : RobustOptions or None
        Gate and weights of measured values.
    adaptation : AdaptationOptions or None
        Adaptation of the stated noise to the innovations.
    landmarks : LandmarkOptions or None
        How landmarks of an unknown map are represented.
    """

    def __init__(
        self,
        process: ProcessModel,
        robust: RobustOptions | None = None,
        adaptation: AdaptationOptions | None = None,
        landmarks: LandmarkOptions | None = None,
    ) -> None:
        super().__init__(process)
        self._mean = np.zeros(0)
        self._factor = np.zeros((0, 0))
        self._guards = OutlierRejection(robust or RobustOptions())
        self._adaptation = NoiseAdaptation(adaptation or AdaptationOptions())
        self._options = landmarks or LandmarkOptions()
        self._held: HeldMap | None = None

    def start(self, belief: Belief) -> None:
        """Begin with a belief; gates and noise adaptation start afresh."""
        if belief.layout != self.layout:
            raise InputError(
                f"belief has the blocks {belief.layout.blocks}, the process has {self.layout.blocks}"
            )
        self._take(belief)
        self._guards = OutlierRejection(self._guards.options)
        self._adaptation = NoiseAdaptation(self._adaptation.options, self._adaptation.identified)

    def adapt_from(self, identified: Mapping[str, NoiseScale]) -> None:
        """Let noise levels go on from those identified before `start`; see `NoiseAdaptation`."""
        self._adaptation = NoiseAdaptation(self._adaptation.options, identified)

    def level(self, source: str) -> NoiseScale:
        """Present scale of a noise source."""
        return self._adaptation.level(source)

    def rebase(self, belief: Belief) -> None:
        """Restart from another belief of the present time.

        What was learnt of noise and outliers stays, and the landmarks share at least as many modes as before.
        """
        self._take(belief if belief.joint is None else belief.joint.with_modes(self.mode_count))

    def _take(self, belief: Belief) -> None:
        self._mean, self._factor = belief.mean.copy(), belief.factor.copy()
        self._held = None if belief.joint is None else HeldMap.of(belief.joint, self._options)

    @property
    def belief(self) -> Gaussian:
        """Latest belief of the state in frame g, landmarks marginalised."""
        if self._held is None:
            return Gaussian(self.layout, self._mean, self._factor)
        if not self._held.has_move(self._factor, self.layout):
            return Gaussian(self.layout, self._mean, triangular_factor(self._factor[: self._n].T))
        mean, rows = state_in_g(self.layout, self._mean, self._factor, self._held.move)
        return Gaussian(self.layout, mean, triangular_factor(rows.T))

    @property
    def landmark_belief(self) -> LandmarkBelief:
        """State and landmarks together."""
        return self._with_map().belief(self.layout, self._mean, self._factor)

    @property
    def held(self) -> Int[np.ndarray, " k"]:
        """Ids of the landmarks in the map."""
        return NO_IDS if self._held is None else self._held.ids

    @property
    def mode_count(self) -> int:
        """Modes that the landmarks of the map share; 0 without a map."""
        return 0 if self._held is None else self._held.landmarks.rank

    def predict(self, dt: float) -> None:
        """Predict mean and covariance factor ``dt`` seconds ahead."""
        self._guards.pass_time()
        self._adaptation.observe_motion(self.layout, self._mean, self._factor[: self._n])
        motion = self._moved(dt)
        self._mean, self._factor = motion.mean, motion.factor
        self._adaptation.expect_motion(motion)

    def update(self, measurement: Measurement) -> UpdateReport:
        """Update with one sensor's values; mere repetitions count as rejected."""
        name, count, ids = measurement.model.name, len(measurement.values), measurement.ids
        guard = self._guards.of(name)
        unchanged = None if ids is None else NOTHING_CHANGED
        keys = measurement.parameters[:, : measurement.model.known_by] if ids is None else ids
        if guard.epochs.is_duplicate(keys, measurement.values):
            return UpdateReport(0.0, 0, 0, count, map_change=unchanged)
        scale = self._adaptation.measurement_scale(name)
        if ids is not None:
            return self._observed(measurement, ids, guard, scale)
        corrected = self._corrected(measurement, guard, scale)
        if corrected is None:
            return UpdateReport(0.0, 0, 0, count)
        self._mean, correction, self._factor = corrected
        if self._held is not None:
            self._held.follow(correction.error[self._n :])
        self._adaptation.observe_measurement(name, correction)
        used = correction.dof // measurement.model.dim
        return UpdateReport(correction.nis, correction.dof, used, count - used, correction.log_likelihood)

    def snapshot(self) -> Snapshot:
        """Copies of belief, landmarks, gates and noise adaptation."""
        beliefs = {"mean": self._mean.copy(), "factor": self._factor.copy()}
        landmarks = {} if self._held is None else self._held.snapshot()
        return {**beliefs, **landmarks, **self._guards.snapshot(), **self._adaptation.snapshot()}

    def restore(self, snapshot: Snapshot) -> None:
        """Take belief, landmarks, gates and noise adaptation from a `snapshot`."""
        self._mean, self._factor = snapshot["mean"].copy(), snapshot["factor"].copy()
        self._held = HeldMap.restored(snapshot, self._options)
        self._guards.restore(snapshot)
        self._adaptation.restore(snapshot)

    @property
    def _n(self) -> int:
        return self.layout.error_dim

    def _with_map(self) -> HeldMap:
        """The map; before the first landmark it gets modes that nothing depends on yet."""
        if self._held is None:
            self._held, size = HeldMap.empty(self._options), len(self._factor)
            factor = np.eye(size + self._options.modes)
            factor[:size, :size] = self._factor
            self._factor = factor
        return self._held

    def _anchored(self, dim: int, rows: Int[np.ndarray, " k"]) -> HeldMap:
        """The map, anchored at the present pose where only new landmarks are seen, and enough of them to fix a pose."""
        held, known = self._with_map(), int(np.count_nonzero(rows >= 0))
        if len(held.landmarks) == 0 or dim * known >= GAUGE_DIM or dim * (len(rows) - known) < GAUGE_DIM:
            return held
        belief = anchored_at_pose(self.landmark_belief, self._options)
        self._factor, self._held = belief.factor, HeldMap.of(belief, self._options)
        return self._held

    def _observed(
        self,
        measurement: Measurement,
        ids: Int[np.ndarray, " k"],
        guard: SensorOutlierRejection,
        scale: float,
    ) -> UpdateReport:
        """Landmarks of the map seen, and new ones."""
        rows = self._with_map().landmarks.locate(ids)
        held = self._anchored(measurement.model.dim, rows)
        observations = held.observations(self.layout, measurement, rows, scale)
        solved = self._solved(observations, guard)
        correction = solved.correction
        mean = self.layout.retract(self._mean, correction.error[: self._n])
        if not (np.isfinite(mean).all() and np.isfinite(correction.factor).all()):
            return UpdateReport(0.0, 0, 0, len(ids), map_change=NOTHING_CHANGED)
        self._mean = mean
        self._factor, change = held.after(observations, measurement, solved, mean)
        self._adaptation.observe_measurement(measurement.model.name, correction)
        used = len(solved.used) + len(change.added)  # a landmark's first observation makes it
        return UpdateReport(
            correction.nis, correction.dof, used, len(ids) - used, correction.log_likelihood, change
        )

    @abstractmethod
    def _moved(self, dt: float) -> PredictedMotion:
        """The belief dt seconds later."""

    @abstractmethod
    def _corrected(
        self, measurement: Measurement, guard: SensorOutlierRejection, scale: float
    ) -> Update | None:
        """Update by a measurement whose noise covariance is multiplied by ``scale``; None when no value is usable."""

    @abstractmethod
    def _solved(self, observations: MapObservations, guard: SensorOutlierRejection) -> SolvedObservations:
        """Solved observations of landmarks."""


def propagated(
    factor: Float[np.ndarray, "N N"], transition: Float[np.ndarray, "n n"], noise: Float[np.ndarray, "n k"]
) -> Float[np.ndarray, "N N"]:
    """Lower triangular factor after transition and noise of the leading rows."""
    n = len(transition)
    compiled = compiled_propagation(n) if len(factor) == n and noise.shape[1] <= MOST_NOISE else None
    if compiled is not None:
        return compiled(factor, transition, noise)
    return joined_rows(factor, transition @ factor[:n], noise)


def joined_rows(
    factor: Float[np.ndarray, "N N"], moved: Float[np.ndarray, "n N"], noise: Float[np.ndarray, "n k"]
) -> Float[np.ndarray, "N N"]:
    """Lower triangular covariance factor after a prediction.

    The state's rows have become ``moved`` and process noise is added; rows behind them stay.
    """
    n, size = moved.shape
    # [moved noise; rest 0] (N x (N + k)): its triangular factor has the covariance of the predicted errors.
    rows = np.zeros((size, size + noise.shape[1]))
    rows[:n, :size], rows[:n, size:] = moved, noise
    rows[n:, :size] = factor[n:]
    return triangular_factor(rows.T)


def reset_factor(
    layout: StateLayout, error: Float[np.ndarray, " N"], factor: Float[np.ndarray, "N N"]
) -> Float[np.ndarray, "N N"]:
    """Covariance factor after the state's error, the first n components, has been folded into the mean."""
    if not layout.curved:
        return factor
    n = layout.error_dim
    if len(factor) == n:
        return layout.reset_jacobian(error) @ factor
    result = factor.copy()
    result[:n] = layout.reset_jacobian(error[:n]) @ factor[:n]
    return result
