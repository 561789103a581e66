"""The multiplicative filter in square-root form: predict and update, in the order of the textbook.

Members of the family state two things, in a file each: how the process is linear over a step (`linearise_process`), and how a
measurement is linear in the error of the state (`predict_measurement`). `spinfilters.filters.ekf` does both by derivatives at the
mean, `spinfilters.filters.ukf` by regression over sigma points.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple, Protocol, Self, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.errors import InputError
from spinfilters.filters.compiled_steps import MOST_NOISE, Update, compiled_propagation
from spinfilters.filters.estimator import (
    NO_IDS,
    Belief,
    EpochRun,
    Estimator,
    LandmarkBelief,
    MapChange,
    Measurement,
    ProcessModel,
    Snapshot,
    UpdateReport,
)
from spinfilters.filters.flow_curvature import FlowCurvature
from spinfilters.filters.landmark_map import HeldMap
from spinfilters.filters.landmark_observations import SolvedObservations, solve_at
from spinfilters.filters.landmark_steps import MapObservations
from spinfilters.filters.noise_levels import AdaptationOptions, NoiseAdaptation, NoiseScale, PredictedMotion
from spinfilters.filters.outlier_rejection import OutlierRejection, RobustOptions, SensorOutlierRejection
from spinfilters.filters.shared_modes import LandmarkOptions, anchored_at_pose
from spinfilters.filters.square_root import MeasurementPrediction, covariance_factor, square_root_update
from spinfilters.models.gauge import GAUGE_DIM, state_in_g
from spinfilters.models.state_layout import Gaussian, StateLayout

NOTHING_CHANGED = MapChange(NO_IDS, np.zeros(0), NO_IDS, NO_IDS)
"""Change of the map by an update that could not be made: none."""


class LinearisedProcess(NamedTuple):
    """The process over one step, linear in the error of the state.

    Attributes
    ----------
    mean : ndarray of float, shape (m,)
        Predicted mean.
    transition : ndarray of float, shape (n, n)
        F, the derivative of the predicted error with respect to the present one.
    noise : ndarray of float, shape (n, k)
        G with G G' = Q, at the stated densities.
    spread : ndarray of float, shape (n, r), or None
        Of the UKF: predicted errors per column of the square root S, with further columns for what its regression cannot
        explain; None: F S.
    """

    mean: Float[np.ndarray, " m"]
    transition: Float[np.ndarray, "n n"]
    noise: Float[np.ndarray, "n k"]
    spread: Float[np.ndarray, "n r"] | None = None


class PredictedMeasurement(Protocol):
    """Usable values of a measurement, whitened, and how they depend on the error of the state."""

    @property
    def innovation(self) -> Float[np.ndarray, "k d"]:
        """Innovations, measured less predicted, whitened by the measurement noise: of covariance 1 + Y Y', not 1."""
        ...

    @property
    def dof(self) -> int:
        """Number of scalar measurements."""
        ...

    def deviations(
        self, factor: Float[np.ndarray, "n r"], chosen: Bool[np.ndarray, " k"]
    ) -> Float[np.ndarray, "s d r"]:
        """H S of the chosen values: their change per unit of the factor's coordinates."""
        ...

    def weighted(self, weights: Float[np.ndarray, " k"]) -> Self:
        """Values with their noise covariance divided by the weights; those of weight 0 are left out."""
        ...

    def predicted(self, factor: Float[np.ndarray, "n r"]) -> MeasurementPrediction:
        """All values together, for `square_root_update`."""
        ...


Predicted = TypeVar("Predicted", bound=PredictedMeasurement)


class MultiplicativeFilter(Estimator):
    """Recursive filter on the error state.

    The mean lies on the manifold, the square root of the error covariance in its tangent space.

    After an update the error is folded into the mean (4 x MRP on the body side) and the covariance moves with the derivative of
    that reset, so that it always refers to the present mean.

    Where landmarks are not known, the factor has more than the state's n rows. Rows after them are errors that all landmarks
    share, such as a turn of the whole map (`spinfilters.filters.shared_modes`), and the pose of the map's frame in frame g
    (`spinfilters.filters.landmark_map`). These errors do not change with time, and no sensor without landmarks sees them; what
    the state learns, they learn by correlation.

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
    curvature : FlowCurvature or None
        When second-order terms of the motion widen the covariance; None: never.
    """

    def __init__(
        self,
        process: ProcessModel,
        robust: RobustOptions | None = None,
        adaptation: AdaptationOptions | None = None,
        landmarks: LandmarkOptions | None = None,
        curvature: FlowCurvature | None = None,
    ) -> None:
        super().__init__(process)
        self.mean = np.zeros(0)
        self.factor = np.zeros((0, 0))
        self._outliers = OutlierRejection(robust or RobustOptions())
        self._adaptation = NoiseAdaptation(adaptation or AdaptationOptions())
        self._options = landmarks or LandmarkOptions()
        self._curvature = curvature or FlowCurvature()
        self._held: HeldMap | None = None

    def start(self, belief: Belief) -> None:
        """Begin with a belief; gates and noise adaptation start afresh.

        Parameters
        ----------
        belief : Belief
            Of the first epoch; its layout is the process's.
        """
        if belief.layout != self.layout:
            raise InputError(
                f"belief has the blocks {belief.layout.blocks}, the process has {self.layout.blocks}"
            )
        self._take(belief)
        self._outliers = OutlierRejection(self._outliers.options)
        self._adaptation = NoiseAdaptation(self._adaptation.options, self._adaptation.identified)

    def adapt_from(self, identified: Mapping[str, NoiseScale]) -> None:
        """Let noise levels go on from those identified before `start`; see `NoiseAdaptation`.

        Parameters
        ----------
        identified : Mapping[str, NoiseScale]
            Scale of each noise source, by its name.
        """
        self._adaptation = NoiseAdaptation(self._adaptation.options, identified)

    def level(self, source: str) -> NoiseScale:
        """Present scale of a noise source.

        Parameters
        ----------
        source : str
            Name such as "process.torque_psd" or "sensor.gyro".

        Returns
        -------
        NoiseScale
            Factor of the stated variance, with its uncertainty.
        """
        return self._adaptation.level(source)

    def rebase(self, belief: Belief) -> None:
        """Restart from another belief of the present time.

        What was learnt of noise and outliers stays, and the landmarks share at least as many modes as before.

        Parameters
        ----------
        belief : Belief
            Of the present time.
        """
        self._take(belief if belief.joint is None else belief.joint.with_modes(self.mode_count))

    def _take(self, belief: Belief) -> None:
        self.mean, self.factor = belief.mean.copy(), belief.factor.copy()
        self._held = None if belief.joint is None else HeldMap.of(belief.joint, self._options)
        self._curvature.begin()

    @property
    def belief(self) -> Gaussian:
        """Latest belief of the state in frame g, landmarks marginalised."""
        if self._held is None:
            return Gaussian(self.layout, self.mean, self.factor)
        if not self._held.has_move(self.factor, self.layout):
            return Gaussian(self.layout, self.mean, covariance_factor(self.factor[: self._n].T))
        mean, rows = state_in_g(self.layout, self.mean, self.factor, self._held.move)
        return Gaussian(self.layout, mean, covariance_factor(rows.T))

    @property
    def landmark_belief(self) -> LandmarkBelief:
        """State and landmarks together."""
        return self._with_map().belief(self.layout, self.mean, self.factor)

    @property
    def held(self) -> Int[np.ndarray, " k"]:
        """Ids of the landmarks in the map."""
        return NO_IDS if self._held is None else self._held.ids

    @property
    def mode_count(self) -> int:
        """Modes that the landmarks of the map share; 0 without a map."""
        return 0 if self._held is None else self._held.landmarks.rank

    def predict(self, dt: float) -> None:
        """Propagate mean and covariance over ``dt`` seconds.

        x <- f(x, dt),  S <- qr([F S, G])  with  P = S S',  Q = G G'  (Maybeck 1979, sec. 7.4)

        At the begin of a stretch S S' has the terms of `spinfilters.filters.flow_curvature` beside, where the filter counts them.

        Parameters
        ----------
        dt : float
            Duration, s; positive.
        """
        self._outliers.pass_time()
        self._adaptation.observe_motion(self.layout, self.mean, self.factor[: self._n])
        predicted = self.predict_belief(dt)
        self.mean, self.factor = predicted.mean, predicted.factor
        self._adaptation.expect_motion(self.layout, predicted)

    def predict_belief(self, dt: float) -> PredictedMotion:
        """The belief after ``dt`` seconds, with its transition and noise.

        Parameters
        ----------
        dt : float
            Duration, s; positive.

        Returns
        -------
        PredictedMotion
            Mean, covariance factor, transition and scaled noise factor.
        """
        self.factor = self._curvature.widened(self.process, self.mean, self.factor, dt)
        step = self.linearise_process(dt)  # EKF: derivatives at the mean; UKF: regression over sigma points
        noise = self._adaptation.scaled(self.layout, step.noise)
        self._curvature.pass_step(dt)
        return PredictedMotion(step.mean, propagate_factor(self.factor, step, noise), step.transition, noise)

    def update(self, measurement: Measurement) -> UpdateReport:
        """Correct mean and covariance by one sensor's values; values that only repeat those of the last epoch count as rejected.

        Parameters
        ----------
        measurement : Measurement
            One sensor's values of the present time.

        Returns
        -------
        UpdateReport
            NIS, its degrees of freedom, and how many values were used and rejected.
        """
        name, count, ids = measurement.model.name, len(measurement.values), measurement.ids
        outliers = self._outliers.of(name)
        keys = measurement.parameters[:, : measurement.model.known_by] if ids is None else ids
        if outliers.epochs.is_duplicate(keys, measurement.values):
            return UpdateReport(0.0, 0, 0, count, map_change=None if ids is None else NOTHING_CHANGED)
        scale = self._adaptation.measurement_scale(name)
        if ids is not None:
            return self._update_by_landmarks(measurement, ids, outliers, scale)
        update = self.correct(measurement, outliers, scale)
        if update is None:
            return UpdateReport(0.0, 0, 0, count)
        self.mean, correction, self.factor = update
        if self._held is not None:
            self._held.follow(correction.error[self._n :])
        self._adaptation.observe_measurement(name, correction)
        used = correction.dof // measurement.model.dim
        return UpdateReport(correction.nis, correction.dof, used, count - used, correction.log_likelihood)

    def correct(
        self, measurement: Measurement, outliers: SensorOutlierRejection, scale: float
    ) -> Update | None:
        """Mean, correction and factor given a measurement; None when no value is usable.

        With the whitened innovation rho = H e + v, e ~ N(0, S S') and v ~ N(0, 1),

            e = S (1 + Y'Y)^-1 Y' rho,  S <- S (1 + Y'Y)^-1/2,  Y = H S  (`spinfilters.filters.square_root`),

        then the error e is folded into the mean, x <- x [+] e, and S moves with the derivative of that reset.

        Parameters
        ----------
        measurement : Measurement
            One sensor's values of the present time.
        outliers : SensorOutlierRejection
            Gate and robust weights of this sensor.
        scale : float
            Ratio of the noise covariance to the stated one.

        Returns
        -------
        Update or None
            What the filter becomes.
        """
        predicted = self.predict_measurement(measurement)  # EKF: h and its Jacobian; UKF: over sigma points
        predicted = self.reject_outliers(predicted, outliers, scale)
        return self.correct_linearly(predicted) if predicted.dof else None

    def reject_outliers(
        self, predicted: Predicted, outliers: SensorOutlierRejection, scale: float
    ) -> Predicted:
        """The values with their noise as adapted, and with the weights of gate and loss.

        Parameters
        ----------
        predicted : Predicted
            The values, linear in the error about the present mean.
        outliers : SensorOutlierRejection
            Gate and robust weights of this sensor.
        scale : float
            Ratio of the noise covariance to the stated one.

        Returns
        -------
        Predicted
            The same, weighted; a weight of zero rejects a value.
        """
        if predicted.dof and scale != 1:
            predicted = predicted.weighted(np.full(len(predicted.innovation), 1 / scale))
        weights = outliers.weights(
            predicted.innovation, lambda chosen: predicted.deviations(self.factor, chosen)
        )
        return predicted if weights is None else predicted.weighted(weights)

    def correct_linearly(self, predicted: PredictedMeasurement) -> Update:
        """The correction by values that are linear in the error, in one step.

        Parameters
        ----------
        predicted : PredictedMeasurement
            The values, linear in the error about the present mean.

        Returns
        -------
        Update
            Mean, correction and factor.
        """
        correction = square_root_update(predicted.predicted(self.factor))
        mean = self.layout.retract(self.mean, correction.error[: self._n])
        return Update(mean, correction, reset_factor(self.layout, correction.error, correction.factor))

    @abstractmethod
    def linearise_process(self, dt: float) -> LinearisedProcess:
        """The process over ``dt`` seconds, linear in the error about the present mean.

        Parameters
        ----------
        dt : float
            Duration, s; positive.

        Returns
        -------
        LinearisedProcess
            Mean at the end, transition of the error, and factor of the process noise.
        """

    @abstractmethod
    def predict_measurement(self, measurement: Measurement) -> PredictedMeasurement:
        """The usable values of a measurement, whitened, and linear in the error about the present mean.

        Parameters
        ----------
        measurement : Measurement
            One sensor's values of the present time.

        Returns
        -------
        PredictedMeasurement
            Whitened innovations and their linear dependence on the error.
        """

    def correct_by_landmarks(
        self, observations: MapObservations, outliers: SensorOutlierRejection
    ) -> SolvedObservations:
        """Correction of state and shared modes by landmarks of the map, linear by derivatives at the mean.

        Parameters
        ----------
        observations : MapObservations
            Those of landmarks in the map.
        outliers : SensorOutlierRejection
            Gate and robust weights of this sensor.

        Returns
        -------
        SolvedObservations
            The correction, and which observations it used.
        """
        return solve_at(observations, self.mean, self.factor, outliers)

    def take_in_together(
        self, epochs: EpochRun, rows: Mapping[str, np.ndarray], take: Callable[[EpochRun], int]
    ) -> int:
        """`take_in` by compiled code, for as many epochs as noise levels stay what they are.

        Parameters
        ----------
        epochs, rows
            See `Estimator.take_in`.
        take : Callable[[EpochRun], int]
            Takes epochs in from the present belief, and writes their rows; how many.

        Returns
        -------
        int
            How many epochs were taken in.
        """
        names = [part.every.model.name for part in epochs.sensors]
        count = min(len(epochs.dt), self._adaptation.constant_predictions(names))
        if self._held is not None or not count:
            return 0
        parts = tuple(
            replace(part, first=part.first[:count], end=part.end[:count]) for part in epochs.sensors
        )
        done = take(EpochRun(epochs.dt[:count], parts))
        if done:
            self.mean, self.factor = rows["mean"][done - 1].copy(), rows["factor"][done - 1].copy()
            self._adaptation.count_predictions(done)
            for part, guard in zip(parts, map(self._outliers.of, names), strict=True):
                measured = np.flatnonzero(part.end[:done] > part.first[:done])
                if not measured.size:
                    guard.epochs.pass_time()
                    continue
                last = int(measured[-1])
                values = slice(int(part.first[last]), int(part.end[last]))
                keys = part.every.parameters[values, : part.every.model.known_by]
                guard.remember(keys, part.every.values[values], time_passed=last < done - 1)
        return done

    def snapshot(self) -> Snapshot:
        """Copies of belief, landmarks, gates and noise adaptation.

        Returns
        -------
        Snapshot
            Arrays by name, as a checkpoint keeps them.
        """
        beliefs = {"mean": self.mean.copy(), "factor": self.factor.copy()}
        landmarks = {} if self._held is None else self._held.snapshot()
        others = (self._outliers, self._adaptation, self._curvature)
        return {
            **beliefs,
            **landmarks,
            **{key: value for each in others for key, value in each.snapshot().items()},
        }

    def restore(self, snapshot: Snapshot) -> None:
        """Take belief, landmarks, gates and noise adaptation from a `snapshot`.

        Parameters
        ----------
        snapshot : Snapshot
            Of a filter with the same process and options.
        """
        self.mean, self.factor = snapshot["mean"].copy(), snapshot["factor"].copy()
        self._held = HeldMap.restored(snapshot, self._options)
        self._outliers.restore(snapshot)
        self._adaptation.restore(snapshot)
        self._curvature.restore(snapshot)

    @property
    def _n(self) -> int:
        return self.layout.error_dim

    def _with_map(self) -> HeldMap:
        """The map; before the first landmark it gets modes that nothing depends on yet."""
        if self._held is None:
            self._held, size = HeldMap.empty(self._options), len(self.factor)
            factor = np.eye(size + self._options.modes)
            factor[:size, :size] = self.factor
            self.factor = factor
        return self._held

    def _anchor_map(self, dim: int, rows: Int[np.ndarray, " k"]) -> HeldMap:
        """The map, anchored at the present pose where too few of its landmarks are seen to fix a pose, but enough new ones."""
        held, known = self._with_map(), int(np.count_nonzero(rows >= 0))
        if len(held.landmarks) == 0 or dim * known >= GAUGE_DIM or dim * (len(rows) - known) < GAUGE_DIM:
            return held
        belief = anchored_at_pose(self.landmark_belief, self._options)
        self.factor, self._held = belief.factor, HeldMap.of(belief, self._options)
        return self._held

    def _update_by_landmarks(
        self,
        measurement: Measurement,
        ids: Int[np.ndarray, " k"],
        outliers: SensorOutlierRejection,
        scale: float,
    ) -> UpdateReport:
        """Correct state, modes and landmarks by observations of those in the map, and add new ones."""
        rows = self._with_map().landmarks.locate(ids)
        held = self._anchor_map(measurement.model.dim, rows)
        observations = held.observations(self.layout, measurement, rows, scale)
        solved = self.correct_by_landmarks(observations, outliers)
        correction = solved.correction
        mean = self.layout.retract(self.mean, correction.error[: self._n])
        if not (np.isfinite(mean).all() and np.isfinite(correction.factor).all()):
            return UpdateReport(0.0, 0, 0, len(ids), map_change=NOTHING_CHANGED)
        self.mean = mean
        self.factor, change = held.after(observations, measurement, solved, mean)
        self._adaptation.observe_measurement(measurement.model.name, correction)
        used = len(solved.used) + len(change.added)  # a landmark's first observation makes it
        return UpdateReport(
            correction.nis, correction.dof, used, len(ids) - used, correction.log_likelihood, change
        )


def propagate_factor(
    factor: Float[np.ndarray, "N N"], step: LinearisedProcess, noise: Float[np.ndarray, "n k"]
) -> Float[np.ndarray, "N N"]:
    """Lower triangular covariance factor after a step; rows after the state's n (modes, move) do not change with time.

    Parameters
    ----------
    noise : ndarray of float, shape (n, k)
        G as adapted.
    """
    n, size, k = len(step.transition), len(factor), noise.shape[1]
    if step.spread is None and size == n and k <= MOST_NOISE:
        compiled = compiled_propagation(n)
        if compiled is not None:
            return compiled(factor, step.transition, noise)
    spread = step.transition @ factor[:n] if step.spread is None else step.spread
    # [F S  G; rest 0], N x (r + k): its triangular factor has the covariance of the predicted errors.
    rows = np.zeros((size, spread.shape[1] + k))
    rows[:n, : spread.shape[1]], rows[:n, spread.shape[1] :] = spread, noise
    rows[n:, :size] = factor[n:]
    return covariance_factor(rows.T)


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
