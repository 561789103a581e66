"""A smoother's window as named arrays of numbers, and back."""

from collections.abc import Sequence

import numpy as np

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Measurement, Snapshot
from spinfilters.estimators.smoothing.factors.marginalization_prior import MarginalizationPrior
from spinfilters.estimators.smoothing.factors.variable_ordering import VariableOrdering
from spinfilters.estimators.smoothing.window.smoother_window import Window, WindowObservations
from spinfilters.estimators.timeline import Epoch
from spinfilters.models.landmark_sensor import LandmarkSensor
from spinfilters.models.measurement import MeasurementModel
from spinfilters.state.layout import StateLayout

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
    InputError: a sensor that is not among ``sensors``, or is another.
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
    """With what was measured beside landmarks."""
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
