"""Share of calibration errors in the covariance of estimates, by the sensitivity of the smoothed motion (Schmidt 1966).

A deviation that is stated is taken as it is; one that is not is as large as the residuals leave possible (`possible_deviation`).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.camera_trajectory import displaced
from spinfilters.core.errors import NUMERICAL_ERRORS
from spinfilters.filters.estimator import Measurement
from spinfilters.filters.history import EstimateHistory
from spinfilters.filters.timeline import LogTimeline, Timeline, run, times_of
from spinfilters.inference.estimator_entry import AnyEntry, begin_with_first_epoch
from spinfilters.inference.noise_choice import PRIOR
from spinfilters.inference.setup import Setup
from spinfilters.io.consider_parameter import ConsideredDeviation, ConsiderParameter, Displaced
from spinfilters.settings.run_settings import Settings
from spinfilters.smoother.batch_smoother import NO_LANDMARKS, smooth_problem
from spinfilters.smoother.motion_factors import STRETCH
from spinfilters.smoother.problem import problem_of
from spinfilters.verdict.model_errors.alternatives import CLOCK_DRIFT, table
from spinfilters.verdict.model_errors.linear_rows import Columns, Sensitivity
from spinfilters.verdict.model_errors.score_tests import ScoreTest
from spinfilters.verdict.model_errors.smoothed_motion import KnownCamera, SmoothedMotion, displaced_camera
from spinfilters.verdict.model_tests import (
    MOST_EPOCHS_WITH_MAP,
    linear_problem,
    smoothed_about,
    tested_about,
    tested_epochs,
)
from spinfilters.verdict.tested_models import TestedModels


def smoothed_sensitivity(motion: SmoothedMotion, considered: Sequence[ConsideredDeviation]) -> Sensitivity:
    """Errors of states and landmarks by each independent error of the calibration, times its deviation."""
    return motion.rows.sensitivity(_columns(motion, considered))


def calibration_moments(
    motion: SmoothedMotion, considered: Sequence[ConsideredDeviation]
) -> Float[np.ndarray, "c c"]:
    """Second moments of errors of the calibration about none, given the residuals, each in its deviations.

    With the information F and the score u = H'M y the covariance is (I + F)^-1 and the mean e = (I + F)^-1 u. The estimates are of
    no error, so that their own errors have the mean in them: the moments are (I + F)^-1 + e e'.
    """
    columns = _columns(motion, considered)
    covariance = np.linalg.inv(np.eye(columns.count) + _information(motion, columns))
    e = covariance @ columns.gram(motion.rows.left)[:, 0]
    return covariance + np.outer(e, e)


def _information(motion: SmoothedMotion, columns: Columns) -> Float[np.ndarray, "c c"]:
    """H'M H of columns H: what states and landmarks leave of them."""
    left = motion.rows.residual(columns)
    return left.gram(left)


def _columns(motion: SmoothedMotion, considered: Sequence[ConsideredDeviation]) -> Columns:
    return Columns.joined(
        [calibration_columns(motion, each.parameter).scaled(each.std) for each in considered]
    )


def calibration_columns(motion: SmoothedMotion, parameter: ConsiderParameter) -> Columns:
    """Derivative of the whitened right-hand side per unit of a calibration parameter, a column for each error."""
    if parameter.of_clock:
        return motion.longer()
    if parameter.displaced is not None:
        camera = KnownCamera.of(motion)
        if camera is None:
            return motion.rows.nothing(parameter.size)
        # were the poses displaced, what is expected then would be subtracted
        return displaced_camera(motion, parameter.displaced, camera).scaled(-1.0)
    found = motion.shifted(lambda each: each.by_calibration(parameter))
    return motion.rows.nothing(parameter.size) if found is None else found


UNKNOWN: Final = (
    "what errors of the calibration do to it could not be computed: its deviations are of chance alone"
)


@dataclass(frozen=True)
class CalibrationErrors:
    """Effect of calibration errors on one run.

    Attributes
    ----------
    ekf : AnyEntry
        Of the table of estimators; its differences represent those of a smoother that lets go of old epochs.
    """

    setup: Setup
    settings: Settings
    ekf: AnyEntry

    @property
    def considered(self) -> tuple[ConsideredDeviation, ...]:
        """Considered deviations that are not zero."""
        return tuple(each for each in self.setup.calibration if each.std > 0)

    def counted(self, history: EstimateHistory, entry: AnyEntry) -> EstimateHistory:
        """History with calibration errors counted in its covariance, ``degraded`` where that cannot be computed."""
        if not self.considered or history.has_failed:
            return history
        try:
            with np.errstate(all="ignore"):  # what is not finite becomes a status
                errors, untold = self._errors(history, entry), self._moments_given_residuals(history)
                counted = None
                if errors is not None and untold is not None and np.isfinite(errors).all():
                    counted = history.considering(errors @ untold)
        except NUMERICAL_ERRORS:
            counted = None
        if counted is None or not np.isfinite(counted.factor).all():
            return replace(history, status=history.status.degraded(UNKNOWN, "calibration-uncounted"))
        return counted

    def _moments_given_residuals(self, history: EstimateHistory) -> Float[np.ndarray, "c c"] | None:
        """Factor of the considered errors' second moments given the residuals, in their deviations.

        The identity of what no residual shows. Errors of an inspector's poses are separated from the motion where it does not move
        evenly (`calibration_moments`). A larger one is named.
        """
        sizes = [each.parameter.size for each in self.considered]
        every = np.eye(sum(sizes))
        of_inspector = np.repeat([each.parameter.displaced is not None for each in self.considered], sizes)
        if not of_inspector.any():
            return every
        epochs = self.setup.timeline[: min(len(history.time), MOST_EPOCHS_WITH_MAP)]
        motion = self._motion(epochs, history.mean[: len(epochs)])
        if motion is None:
            return None
        considered = [each for each in self.considered if each.parameter.displaced is not None]
        every[np.ix_(of_inspector, of_inspector)] = np.linalg.cholesky(
            calibration_moments(motion, considered)
        )
        return every

    def _errors(self, history: EstimateHistory, entry: AnyEntry) -> Float[np.ndarray, "n e c"] | None:
        epochs, first = self.setup.timeline[: len(history.time)], len(self.setup.initial.mean)
        if entry.continues:
            return self._of_filter(entry, epochs, history.mean[history.initialisation :])
        if not self.setup.initial.has_landmarks and len(epochs) > STRETCH:
            return self._of_long_smoother(epochs, history.mean)
        if not self.setup.initial.has_landmarks or len(epochs) <= MOST_EPOCHS_WITH_MAP:
            found = self._sensitivity(epochs, history.mean)
            return None if found is None else found.states
        ekf, initial = self.ekf, self.setup.initial
        means = self._run(ekf, epochs, np.zeros(initial.factor.shape[:2]), np.zeros(initial.points.shape))
        return None if means is None else self._of_filter(ekf, epochs[: first + len(means)], means)

    def _of_long_smoother(
        self, epochs: Timeline, trajectory: Float[np.ndarray, "k m"]
    ) -> Float[np.ndarray, "k e c"]:
        """Differences of what all epochs together say of data with an error each."""

        def smoothed(timeline: Timeline) -> Float[np.ndarray, "k m"]:
            """The initialisation smoothed with these epochs."""
            setup, loss = self.setup, self.settings.smoother.robust_loss
            problem = problem_of(setup.process, timeline, NO_LANDMARKS, setup.initial.prior, 2, loss)
            return smooth_problem(problem, trajectory).mean

        local, here = self.setup.process.layout.local, smoothed(epochs)
        return np.stack([local(here, smoothed(moved)) for moved in self._timelines(epochs)], axis=2)

    def _of_filter(
        self, entry: AnyEntry, epochs: Timeline, means: Float[np.ndarray, "j m"]
    ) -> Float[np.ndarray, "k e c"] | None:
        """Differences of a filter's estimates from those of faulty data.

        Data with an error each; those of the initialisation in front.
        """
        begun, columns = self._initialisation, []
        if begun is None:
            return None
        for number, moved in enumerate(self._timelines(epochs)):
            before, landmarks = begun.states[:, :, number], begun.landmarks[:, :, number]
            states = self._run(entry, moved, before, landmarks)
            if states is None:
                return None
            away = self.setup.process.layout.local(means, states)
            columns.append(np.concatenate([before, away]))
        return np.stack(columns, axis=2)

    def _run(
        self,
        entry: AnyEntry,
        timeline: Timeline,
        states: Float[np.ndarray, "k e"],
        landmarks: Float[np.ndarray, "L 3"],
    ) -> Float[np.ndarray, "n m"] | None:
        """States of a filter after an initialisation that has moved; None where it fails."""
        setup = self.setup
        mean = setup.process.layout.retract(setup.initial.mean, states)
        initial = replace(setup.initial, mean=mean, points=setup.initial.points + landmarks)
        belief = replace(setup.belief, mean=mean[-1])
        if belief.joint is not None:  # whose map is in frame g yet
            belief = replace(belief.joint, points=belief.joint.points + landmarks)
        moved = replace(setup, timeline=timeline, initial=initial, belief=belief)
        estimator = entry.build(moved, self.settings)
        begin_with_first_epoch(entry, estimator, moved)
        found = run(estimator, moved.end_of_initialisation, timeline[len(mean) :])
        return None if found.has_failed else found.mean

    def _timelines(self, epochs: Timeline) -> Iterator[Timeline]:
        """The epochs under each independent error, by one deviation."""
        assert isinstance(epochs, LogTimeline)
        for each in self.considered:
            for error in each.std * np.eye(each.parameter.size):
                yield with_error(epochs, each, error)

    @cached_property
    def _initialisation(self) -> Sensitivity | None:
        """Sensitivity of the initialisation; none of one that was given."""
        initial = self.setup.initial
        if self.setup.is_given:
            count = sum(each.parameter.size for each in self.considered)
            states = np.zeros((*initial.factor.shape[:2], count))
            return Sensitivity(states, np.zeros((*initial.points.shape, count)))
        return self._sensitivity(self.setup.timeline[: len(initial.mean)], initial.mean, initial.ids)

    def _sensitivity(
        self, epochs: Timeline, trajectory: Float[np.ndarray, "k m"], ids: Int[np.ndarray, " L"] | None = None
    ) -> Sensitivity | None:
        """Sensitivity of epochs smoothed together."""
        motion = self._motion(epochs, trajectory, ids)
        return None if motion is None else smoothed_sensitivity(motion, self.considered)

    def _motion(
        self, epochs: Timeline, trajectory: Float[np.ndarray, "k m"], ids: Int[np.ndarray, " L"] | None = None
    ) -> SmoothedMotion | None:
        """The most probable motion near a trajectory; None where there is none."""
        solved = smoothed_about(linear_problem(self.setup, epochs, ids), trajectory)
        return None if solved is None else SmoothedMotion(times_of(epochs), solved)


def with_error(epochs: LogTimeline, considered: ConsideredDeviation, error: np.ndarray) -> LogTimeline:
    """Epochs as they would be, were the calibration larger by an error."""
    parameter = considered.parameter
    if parameter.of_clock:
        begin = epochs.time[0]
        return replace(epochs, time=begin + (epochs.time - begin) * (1 + error[0]))
    if parameter.displaced is not None:
        return _with_displaced_camera(epochs, parameter.displaced, error)
    assert parameter.moved is not None
    sensors = []
    for part in epochs.sensors:
        every = part.every
        if every.model.name in parameter.sensors:
            changed = every.model.with_error(parameter.moved, error, every.values, every.parameters)
            part = replace(part, every=Measurement(every.model, *changed, every.ids))
        sensors.append(part)
    return replace(epochs, sensors=tuple(sensors))


def _with_displaced_camera(epochs: LogTimeline, displacement: Displaced, error: np.ndarray) -> LogTimeline:
    """Epochs with the known poses of the camera displaced."""
    sensors = []
    for part in epochs.sensors:
        pose, parameters = part.every.model.known_pose, part.every.parameters
        if pose is not None:
            rows = np.concatenate([np.arange(a, b) for a, b in zip(part.first, part.end, strict=True)])
            time = epochs.time.repeat(part.end - part.first)
            stamps, first, which = np.unique(time, return_index=True, return_inverse=True)
            poses = parameters[rows, pose]
            by = displacement(stamps, poses[first]) @ error
            parameters = parameters.copy()
            parameters[rows, pose] = displaced(poses, by[which.reshape(-1)])
            part = replace(part, every=replace(part.every, parameters=parameters))
        sensors.append(part)
    return replace(epochs, sensors=tuple(sensors))


POINTS: Final = 20001
"""Of the integrals over [-S, S]: a default of S / 50 spans 200 of them."""
LARGEST: Final = 4.0
"""Deviations within which a verdict promises an estimate to be."""
BEYOND: Final = 5e-3
"""Probability of an error beyond them that is allowed, as of an over-confident filter (`HELD` of `verdict.filter_diagnostics`)."""


CHANCE: Final = 3.0
"""Deviations of a size beyond what is plausible, from which it is no chance: then it is as large as the residuals show."""


def enlargements(
    considered: Sequence[ConsideredDeviation], tests: Iterable[ScoreTest]
) -> Float[np.ndarray, " c"]:
    """Times the considered deviation of every independent error, at least 1.

    Parameters
    ----------
    considered : sequence of ConsideredDeviation
        Those of the run that are not zero.
    tests : iterable of ScoreTest
        Score tests of the recording. An error without one, which no residual shows, keeps its deviation.

    Returns
    -------
    array (c,)
        In the order of the columns of `EstimateHistory.calibration`.
    """
    by_name = {each.error.parameter.name: each for each in tests if each.error.parameter is not None}
    found = []
    for each in considered:
        test = by_name.get(each.parameter.name)
        if each.source != PRIOR or test is None:
            found.append(np.ones(each.parameter.size))
            continue
        found.append(
            np.array(
                [
                    possible_deviation(size, std, each.std, test.error.plausible) / each.std
                    for size, std in zip(test.size, test.std, strict=True)
                ]
            )
        )
    return np.concatenate(found) if found else np.ones(0)


def enlarged_words(considered: Iterable[ConsideredDeviation]) -> list[str]:
    """Words for the considered parameters that are not stated and have a score test, so that `enlargements` may exceed 1."""
    tested = {each.parameter.name for each in table().values() if each.parameter is not None}
    return [
        each.parameter.words
        for each in considered
        if each.std > 0 and each.source == PRIOR and each.parameter.name in tested
    ]


def possible_deviation(size: float, std: float, default: float, plausible: float) -> float:
    """Deviation of a calibration error that is not stated, at least the default one.

    A default deviation s describes a good calibration, which this one may not be. Its error x therefore has a prior with tails, the
    Cauchy density 1 / (1 + (x / s)^2) up to the size S that is plausible at all. The score test of the same error gives its size z
    with the standard deviation d, without a prior. The posterior density is in proportion to

        p(x) = exp(-(z - x)^2 / 2 d^2) / (1 + (x / s)^2),   |x| <= S.

    The deviation is its root mean square, at least s, and large enough that four of them are exceeded with a probability of 0.5 %
    only: this posterior has tails that a normal one has not. Residuals that determine the error better than s leave s; such as
    hardly determine it raise s by a few times, and such as contradict s by as much as they show.

    Parameters
    ----------
    size, std : float
        Of the error by the residuals alone, with its standard deviation; zero or not finite where they show nothing.
    default : float
        Scale of the prior.
    plausible : float
        Largest size that is considered, unless the residuals are beyond it by more than chance.
    """
    if not (np.isfinite([size, std, plausible]).all() and std > 0 and plausible > default):
        return default
    if abs(size) - plausible > CHANCE * std:
        plausible = abs(size) + CHANCE * std
    x = np.linspace(-plausible, plausible, POINTS)
    log_density = -0.5 * ((size - x) / std) ** 2 - np.log1p((x / default) ** 2)
    density = np.exp(log_density - log_density.max())
    density /= density.sum()
    farthest = np.argsort(-np.abs(x), kind="stable")
    beyond = np.abs(x[farthest[np.searchsorted(np.cumsum(density[farthest]), BEYOND)]])
    return max(default, float(np.sqrt(density @ x**2)), float(beyond) / LARGEST)


def stated_deviation(size: float, std: float, stated: float) -> float:
    """Deviation of a calibration error of a stated normal prior, about zero, given the score test of the same error.

    Parameters
    ----------
    size, std : float
        Of the error by the residuals alone, with its standard deviation; not finite where they show nothing.
    stated : float
        Standard deviation of the prior.

    Returns
    -------
    float
        Root mean square of the posterior N(w z, w d^2), w = s^2 / (s^2 + d^2), for an estimate that does not correct the error.
    """
    if not (np.isfinite([size, std]).all() and std > 0):
        return stated
    share = stated**2 / (stated**2 + std**2)
    return float(np.hypot(share * size, np.sqrt(share) * std))


LARGEST_DRIFT: Final = 0.05
"""Of a recording's duration, by which stamps may be late at its ends, not its middle: the clock's rate is then 20 % off there."""


MOST_DRIFTING: Final = 8192
"""Epochs of a recording without landmarks over which a drift of its clock is counted."""


def possible_clock_drift(
    setup: Setup, best: EstimateHistory, tested: TestedModels
) -> Float[np.ndarray, "k n"] | None:
    """Error of the states by one deviation of a clock's drift, where the clock is not stated to be exact.

    The deviation of a clock is one of its rate. Rates that seem to change are those of another body for a gyro alone. Poses and
    tracks of a body whose spin hardly nutates leave a slow change to the torques that disturb it, so that a drift may be beyond
    the deviations before it is beyond chance. Stamps are then late by x (2 t / T - 1)^2 at the time t of a recording of the
    duration T. Where the clock is unspecified, x has the prior of `possible_deviation`, with the default T times the deviation of
    the clock. A stated deviation s is that of the rate at the ends, so that x has s T / 4 (`stated_deviation`).

    Parameters
    ----------
    best : EstimateHistory
        Whose motion was tested.
    tested : TestedModels
        Of its first epochs, with what was solved. The drift of a longer one is tested anew over all of its epochs.

    Returns
    -------
    (k, n) float array or None
        Of every epoch; None where the clock is exact, or the recording is too long.
    """
    clock = next((each for each in setup.calibration if each.parameter.of_clock), None)
    if clock is None or clock.std == 0:
        return None
    if len(best.time) > tested_epochs(setup):
        if setup.initial.has_landmarks or len(best.time) > MOST_DRIFTING:
            return None
        tested = tested_about(setup, best.mean, [CLOCK_DRIFT], lambda _: ())
    if tested.solved is None:
        return None
    motion = SmoothedMotion(times_of(setup.timeline[: len(best.time)]), tested.solved)
    columns = CLOCK_DRIFT.columns(motion)
    if columns is None:
        return None
    test = tested.test_of(CLOCK_DRIFT)
    size, std = (0.0, np.inf) if test is None else (float(test.size[0]), float(test.std[0]))
    span = float(motion.time[-1] - motion.time[0])
    if clock.source == PRIOR:
        deviation = possible_deviation(size, std, clock.std * span, LARGEST_DRIFT * span)
    else:
        deviation = stated_deviation(size, std, clock.std * span / 4)
    return deviation * motion.rows.sensitivity(columns).states[:, :, 0]
