"""Recursive estimator over the sliding-window smoother, and the record of how its estimates converge."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.core.working_time import working_seconds
from spinfilters.filters.estimator import Estimator, Measurement, ProcessModel, Snapshot, UpdateReport
from spinfilters.filters.measurement_prediction import predict_ahead
from spinfilters.filters.timeline import Epoch, OnEpoch, Timeline, times_of
from spinfilters.models.measurement import LandmarkSensor, MeasurementModel
from spinfilters.models.state_layout import POSE_BLOCKS, Gaussian, StateLayout
from spinfilters.models.status import EstimatorStatus, Verdict
from spinfilters.smoother.priors import MarginalizationPrior, StatePrior, VariableOrdering
from spinfilters.smoother.problem import InitialGuess
from spinfilters.smoother.restarts import RetrySchedule
from spinfilters.smoother.sliding_smoother import (
    MarginalizedState,
    SlidingSmoother,
    SmootherOptions,
    SmootherState,
    UpdateResult,
)
from spinfilters.smoother.window import Window, WindowObservations

_RETIRED = ("time", "mean", "factor")


class RecursiveSmoother(Estimator):
    """A sliding smoother that takes measurements as they come; those of one instant make one epoch.

    An epoch is made by the first measurement of an instant, and solved again with every further one, or once for all that come by
    `update_all`. Where nothing was measured the belief is predicted, and no epoch is made.

    Parameters
    ----------
    sensors : Sequence[MeasurementModel]
        Those of a run whose snapshot another object is to restore, in the same order; others are added at their first measurement.
    """

    name = "smoother"

    def __init__(
        self,
        process: ProcessModel,
        options: SmootherOptions | None = None,
        sensors: Sequence[MeasurementModel] = (),
    ) -> None:
        super().__init__(process)
        self.begun: list[UpdateResult] = []
        """What `begin` did, epoch by epoch."""
        self._options, self._sensors = options or SmootherOptions(), list(sensors)
        n = self.layout.error_dim
        self._begin_with(Gaussian(self.layout, self.layout.origin(), np.full((n, n), np.nan)))

    def start(self, belief: Gaussian) -> None:
        """Begin from a belief at time 0 with all its correlations.

        The pose of the landmarks' frame g is as certain as the belief says.

        Parameters
        ----------
        belief : Gaussian
            Of time 0.
        """
        if belief.layout != self.layout:
            raise InputError(
                f"belief has the blocks {belief.layout.blocks}, the process has {self.layout.blocks}"
            )
        self._begin_with(belief)
        self.sliding.add(Epoch(0.0, ()))
        self._time, self._belief = 0.0, belief

    def begin(self, prior: StatePrior, epochs: Timeline, first: InitialGuess) -> list[UpdateResult]:
        """Begin with the smoothed epochs of an initialisation, from the states and landmarks that it found for them.

        Parameters
        ----------
        epochs : Timeline
            Those of the initialisation.
        first : InitialGuess
            States of the epochs, with ids and points (m, frame g) of landmarks.
        prior : StatePrior
            Prior of the first epoch's state; its pose defines frame g.

        Returns
        -------
        list of UpdateResult
            What happened to the measurements of each epoch.
        """
        self._begin_with(prior)
        for epoch in epochs:
            self._number_sensors(epoch.measurements)
        self.begun = self.sliding.begin(epochs, first.trajectory, first.ids, first.points)
        self._time, self._belief = epochs[-1].time, self.sliding.belief
        return self.begun

    @property
    def belief(self) -> Gaussian:
        """Belief of the present time given all measurements so far."""
        return self._belief

    @property
    def status(self) -> EstimatorStatus:
        """Whether the belief can be relied upon already: see `SlidingSmoother.status`."""
        return self.sliding.status

    def predict(self, dt: float) -> None:
        """Predict dt > 0 seconds ahead. The window stays as it is until something is measured.

        Parameters
        ----------
        dt : float
            Duration, s; positive.
        """
        ahead = predict_ahead(self.process, self._belief, np.array([dt]))
        self._time, self._belief = self._time + dt, ahead.belief(0)

    def update(self, measurement: Measurement) -> UpdateReport:
        """Add one sensor's values to the epoch of the present time, and solve again.

        Parameters
        ----------
        measurement : Measurement
            One sensor's values of the present time.

        Returns
        -------
        UpdateReport
            How many values were used and rejected.
        """
        return self.update_all((measurement,))[0]

    def update_all(self, measurements: Sequence[Measurement]) -> list[UpdateReport]:
        """Take in what was measured at the present time, and solve once.

        Parameters
        ----------
        measurements : sequence of Measurement
            Of the present time, one for each sensor.

        Returns
        -------
        list of UpdateReport
            A report for each.
        """
        if not measurements:
            return []
        self._number_sensors(measurements)
        if self.sliding.window.epochs[-1].time < self._time:
            taken = self.sliding.add(Epoch(self._time, tuple(measurements)))
        else:
            taken = self.sliding.extend(tuple(measurements))
        self.marginalized += taken.marginalized
        self._belief = self.sliding.belief
        return [UpdateReport(0.0, 0, accepted, rejected) for accepted, rejected in taken.counts]

    def update_epochs(self, epochs: Sequence[Epoch]) -> None:
        """Add several later epochs and solve once.

        Parameters
        ----------
        epochs : sequence of Epoch
            In the order of time, later than the present.
        """
        measured = [epoch for epoch in epochs if epoch.measurements]
        for epoch in measured:
            self._number_sensors(epoch.measurements)
        if measured:
            self.marginalized += self.sliding.add_all(measured).marginalized
            self._time, self._belief = measured[-1].time, self.sliding.belief
        if epochs and epochs[-1].time > self._time:
            self.predict(epochs[-1].time - self._time)

    def smoothed(self) -> list[MarginalizedState]:
        """Every epoch so far, those in the window iterated until nothing moves.

        Returns
        -------
        list of MarginalizedState
            Time, mean and covariance factor of every epoch.
        """
        self.sliding.settle()
        return [*self.marginalized, *self.sliding.smoothed()]

    def snapshot(self) -> Snapshot:
        """Copies of the whole internal state.

        Returns
        -------
        Snapshot
            Arrays by name, as a checkpoint keeps them.
        """
        m = self.sliding.state
        flags = [
            m.prior_alive,
            m.poor_guess,
            m.determined,
            m.retry_schedule.next,
            m.retry_schedule.retry,
            m.mass_std,
            m.fits,
        ]
        marginalized = {
            name: np.array([getattr(row, name) for row in self.marginalized])
            for name in _RETIRED
            if self.marginalized
        }
        return {
            **marginalized,
            **window_arrays(self.sliding.window, self._sensors),
            "flags": np.array([self._time, *flags], dtype=float),
            "prior_mean": self._prior.mean.copy(),
            "prior_factor": self._prior.factor.copy(),
            "belief_mean": self._belief.mean.copy(),
            "belief_factor": self._belief.factor.copy(),
        }

    def restore(self, snapshot: Snapshot) -> None:
        """Continue from a snapshot. The smoother must have met the same sensors in the same order.

        Parameters
        ----------
        snapshot : Snapshot
            Of a smoother with the same process and options.
        """
        window = window_of(self.layout, snapshot, self._sensors)
        self._begin_with(
            Gaussian(self.layout, snapshot["prior_mean"].copy(), snapshot["prior_factor"].copy())
        )
        self._time, alive, poor_guess, determined, is_due, retry, std, fits = map(float, snapshot["flags"])
        retry_schedule = RetrySchedule(is_due, retry)
        state = SmootherState(bool(alive), bool(poor_guess), int(determined), retry_schedule, std, bool(fits))
        self.sliding.resume(window, state)
        mean, factor = snapshot["belief_mean"].copy(), snapshot["belief_factor"].copy()
        self._belief = Gaussian(self.layout, mean, factor)
        kept = [snapshot[name] for name in _RETIRED if name in snapshot]
        self.marginalized = [MarginalizedState(float(t), m, f) for t, m, f in zip(*kept, strict=True)]

    def _begin_with(self, prior: StatePrior) -> None:
        """Begin with this prior and no epoch."""
        self._prior, self.marginalized = prior, list[MarginalizedState]()
        has_landmarks = self.layout.blocks[:2] == POSE_BLOCKS
        self.sliding = SlidingSmoother(self.process, prior, self._options, has_landmarks)
        self._time, self._belief = 0.0, Gaussian(self.layout, prior.mean, prior.factor)

    def _number_sensors(self, measurements: Sequence[Measurement]) -> None:
        """Give new sensors a number."""
        for m in measurements:
            if not any(known is m.model for known in self._sensors):
                self._sensors.append(m.model)


_SEEN = ("epoch", "landmark", "sensor", "values", "parameters")
_MARGINAL_PRIOR = ("first", "information_sqrt", "right", "constant_cost")


def window_arrays(window: Window, sensors: Sequence[MeasurementModel]) -> Snapshot:
    """Copies of everything in a window; sensors are named by their number among ``sensors``."""
    arrays = {f"seen_{name}": getattr(window.seen, name).copy() for name in _SEEN}
    if window.marginal_prior is not None:
        arrays |= {name: np.array(getattr(window.marginal_prior, name)) for name in _MARGINAL_PRIOR}
    rest = [(k, m) for k, epoch in enumerate(window.epochs) for m in epoch.measurements]
    numbers = [(k, _number(m.model, sensors), len(m.values)) for k, m in rest]
    nothing = np.zeros(0)
    return arrays | {
        "window_time": np.array([epoch.time for epoch in window.epochs]),
        "window_sensors": np.array([_number(model, sensors) for model in window.models], dtype=int),
        "measured": np.array(numbers, dtype=int).reshape(-1, 3),
        "measured_values": np.concatenate([nothing, *(m.values.ravel() for _, m in rest)]),
        "measured_parameters": np.concatenate([nothing, *(m.parameters.ravel() for _, m in rest)]),
        "trajectory": window.trajectory.copy(),
        "ids": window.ids.copy(),
        "points": window.points.copy(),
    }


def window_of(layout: StateLayout, arrays: Snapshot, sensors: Sequence[MeasurementModel]) -> Window:
    """The window of some arrays.

    Raises
    ------
    InputError
        A sensor that is not among ``sensors``, or is another.
    """
    models = tuple(_landmark_sensor(sensors, number) for number in arrays["window_sensors"].tolist())
    return Window(
        _epochs(arrays, sensors),
        arrays["trajectory"].copy(),
        WindowObservations(*(arrays[f"seen_{name}"].copy() for name in _SEEN)),
        models,
        arrays["ids"].copy(),
        arrays["points"].copy(),
        _marginal_prior(layout, arrays),
    )


def _epochs(arrays: Snapshot, sensors: Sequence[MeasurementModel]) -> tuple[Epoch, ...]:
    """Epochs with their landmark-free measurements."""
    measured: list[list[Measurement]] = [[] for _ in arrays["window_time"]]
    value = parameter = 0
    for epoch, number, count in arrays["measured"].tolist():
        model = _sensor(sensors, number)
        ends = value + count * model.value_dim, parameter + count * model.parameter_dim
        values = arrays["measured_values"][value : ends[0]].reshape(count, model.value_dim)
        parameters = arrays["measured_parameters"][parameter : ends[1]].reshape(count, model.parameter_dim)
        measured[epoch].append(Measurement(model, values.copy(), parameters.copy()))
        value, parameter = ends
    rows = zip(arrays["window_time"].tolist(), measured, strict=True)
    return tuple(Epoch(time, tuple(here)) for time, here in rows)


def _marginal_prior(layout: StateLayout, arrays: Snapshot) -> MarginalizationPrior | None:
    if "information_sqrt" not in arrays:
        return None
    first, root, right, lost = (arrays[name].copy() for name in _MARGINAL_PRIOR)
    return MarginalizationPrior(
        VariableOrdering(layout, len(first), has_landmarks=True), first, root, right, float(lost)
    )


def _number(model: MeasurementModel, sensors: Sequence[MeasurementModel]) -> int:
    return next(k for k, known in enumerate(sensors) if known is model)


def _sensor(sensors: Sequence[MeasurementModel], number: int) -> MeasurementModel:
    if not 0 <= number < len(sensors):
        raise InputError(
            f"the snapshot names sensor {number}, {len(sensors)} are known; build the smoother with the sensors of its run"
        )
    return sensors[number]


def _landmark_sensor(sensors: Sequence[MeasurementModel], number: int) -> LandmarkSensor:
    model = _sensor(sensors, number)
    seeing = model.landmark_sensor
    if seeing is None:
        raise InputError(
            f"the snapshot's sensor {number} sees landmarks, {model.name} does not; build the smoother with the sensors of its run"
        )
    return seeing


MOST_EPOCHS = 600
"""Of a recording: a surface grows with their square."""

OUT_OF_VIEW, FEWEST_BACK = 4, 6
"""Epochs without a landmark after which it has come back, and how many have to come back to close a loop."""

SelectedQuantities = Callable[[Sequence[MarginalizedState]], Mapping[str, Float[np.ndarray, "k q"]]]
"""What is kept of the k smoothed epochs of a window, by name."""


@dataclass(frozen=True)
class ConvergenceRecord:
    """Beliefs of every solve, for figures of convergence.

    Attributes
    ----------
    time : ndarray of float, shape (f,)
        Times of the epochs, s; solve number k took in epoch number k.
    values : dict[str, ndarray of float, shape (f, f, q)]
        By name (f, f, q), solves by epochs by components; not a number where the epoch was not in the window.
    latest : tuple[MarginalizedState, ...]
        The epoch that each solve took in, as that solve saw it; it holds the constants of the solve.
    trusted : ndarray of bool, shape (f,)
        Whether the smoother vouched for its solve; before, it may sit in a wrong minimum.
    costs : ndarray of float, shape (f, 3)
        Seconds of every solve with the covariances of its epochs, landmarks and factors in its problem; not a number where there
        is no solve.
    closure : int or None
        Number of the first epoch, from 1, that closes a loop (`first_closure`).
    """

    time: Float[np.ndarray, " f"]
    values: dict[str, Float[np.ndarray, "f f q"]]
    latest: tuple[MarginalizedState, ...]
    trusted: Bool[np.ndarray, " f"]
    costs: Float[np.ndarray, "f 3"]
    closure: int | None


def states(window: Sequence[MarginalizedState]) -> dict[str, Float[np.ndarray, "k q"]]:
    """The states themselves: ``mean`` (k, m), and standard deviations of their errors ``std`` (k, n)."""
    factor = np.array([row.factor for row in window])
    return {"mean": np.array([row.mean for row in window]), "std": np.linalg.norm(factor, axis=2)}


def record_convergence(
    smoother: SlidingSmoother,
    timeline: Timeline,
    quantities: SelectedQuantities = states,
    on_epoch: OnEpoch = lambda *_: None,
) -> ConvergenceRecord:
    """Convergence record of a smoother fed epoch by epoch.

    The smoother must have seen nothing before.
    After a solve whose numbers lead nowhere there is none: from there on nothing is a number.
    The error of a first solve is raised.

    Raises
    ------
    InputError
        No epoch, or more than `MOST_EPOCHS`.
    """
    count = len(timeline)
    if not 1 <= count <= MOST_EPOCHS:
        raise InputError(
            f"the recording has {count} epochs; convergence is shown of 1 to {MOST_EPOCHS}: give a part of it"
        )
    values: dict[str, np.ndarray] = {}
    latest: list[MarginalizedState] = []
    trusted, costs = np.zeros(count, dtype=bool), np.full((count, 3), np.nan)
    for solve, epoch in enumerate(timeline):
        begin = working_seconds()
        try:
            smoother.add(epoch)
            window = smoother.smoothed()
            costs[solve] = working_seconds() - begin, len(smoother.window.ids), _factors(smoother)
            said = quantities(window)
        except NUMERICAL_ERRORS:
            if not latest:
                raise
            break
        trusted[solve] = smoother.status.verdict is Verdict.OK
        _record(values, solve, count, said)
        latest.append(window[-1])
        on_epoch(solve + 1, count)
    nothing = replace(latest[-1], mean=latest[-1].mean * np.nan, factor=latest[-1].factor * np.nan)
    latest += [replace(nothing, time=epoch.time) for epoch in timeline[len(latest) :]]
    closure = first_closure(timeline)
    return ConvergenceRecord(times_of(timeline), values, tuple(latest), trusted, costs, closure)


def first_closure(timeline: Timeline) -> int | None:
    """Number of the first epoch, from 1, that closes a loop: enough landmarks for a pose come back into view.

    Parameters
    ----------
    timeline : Timeline
        Epochs with measurements of landmarks.

    Returns
    -------
    int or None
        None where nothing comes back.
    """
    last_seen: dict[int, int] = {}
    for number, epoch in enumerate(timeline, start=1):
        ids = [each for m in epoch.measurements if m.ids is not None for each in m.ids.tolist()]
        back = sum(number - last_seen[each] > OUT_OF_VIEW for each in ids if each in last_seen)
        if back >= FEWEST_BACK:
            return number
        last_seen.update(dict.fromkeys(ids, number))
    return None


def _factors(smoother: SlidingSmoother) -> int:
    """Factors of a smoother's problem: observations, other measurements, motion between epochs, and a prior."""
    window = smoother.window
    others = sum(len(epoch.measurements) for epoch in window.epochs)
    return len(window.seen.epoch) + others + max(len(window.epochs) - 1, 0) + 1


def _record(
    values: dict[str, np.ndarray], solve: int, count: int, said: Mapping[str, Float[np.ndarray, "w q"]]
) -> None:
    """Enter what a solve says of the latest epochs; others stay NaN."""
    for name, rows in said.items():
        record = values.setdefault(name, np.full((count, count, rows.shape[1]), np.nan))
        record[solve, solve + 1 - len(rows) : solve + 1] = rows
