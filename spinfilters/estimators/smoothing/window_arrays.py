"""A smoother's window as named arrays of numbers, and back."""

from collections.abc import Sequence

import numpy as np

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Measurement, Snapshot
from spinfilters.estimators.smoothing.carried import Carried
from spinfilters.estimators.smoothing.unknowns import Unknowns
from spinfilters.estimators.smoothing.window import Seen, Window
from spinfilters.estimators.timeline import Frame
from spinfilters.models.landmark_sensor import LandmarkSensor
from spinfilters.models.measurement import MeasurementModel
from spinfilters.state.layout import StateLayout

_SEEN = ("frame", "landmark", "sensor", "values", "parameters")
_CARRIED = ("first", "root", "right", "lost")


def window_arrays(window: Window, sensors: Sequence[MeasurementModel]) -> Snapshot:
    """Copies of everything in a window; sensors are named by their number among ``sensors``."""
    arrays = {f"seen_{name}": getattr(window.seen, name).copy() for name in _SEEN}
    if window.carried is not None:
        arrays |= {name: np.array(getattr(window.carried, name)) for name in _CARRIED}
    rest = [(k, m) for k, frame in enumerate(window.frames) for m in frame.measurements]
    numbers = [(k, _number(m.model, sensors), len(m.values)) for k, m in rest]
    nothing = np.zeros(0)
    return arrays | {
        "window_time": np.array([frame.time for frame in window.frames]),
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
        _frames(arrays, sensors),
        arrays["trajectory"].copy(),
        Seen(*(arrays[f"seen_{name}"].copy() for name in _SEEN)),
        models,
        arrays["ids"].copy(),
        arrays["points"].copy(),
        _carried(layout, arrays),
    )


def _frames(arrays: Snapshot, sensors: Sequence[MeasurementModel]) -> tuple[Frame, ...]:
    """With what was measured beside landmarks."""
    measured: list[list[Measurement]] = [[] for _ in arrays["window_time"]]
    value = parameter = 0
    for frame, number, count in arrays["measured"].tolist():
        model = _sensor(sensors, number)
        ends = value + count * model.value_dim, parameter + count * model.parameter_dim
        values = arrays["measured_values"][value : ends[0]].reshape(count, model.value_dim)
        parameters = arrays["measured_parameters"][parameter : ends[1]].reshape(count, model.parameter_dim)
        measured[frame].append(Measurement(model, values.copy(), parameters.copy()))
        value, parameter = ends
    rows = zip(arrays["window_time"].tolist(), measured, strict=True)
    return tuple(Frame(time, tuple(here)) for time, here in rows)


def _carried(layout: StateLayout, arrays: Snapshot) -> Carried | None:
    if "root" not in arrays:
        return None
    first, root, right, lost = (arrays[name].copy() for name in _CARRIED)
    return Carried(Unknowns(layout, len(first), tied=True), first, root, right, float(lost))


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
    if not isinstance(model, LandmarkSensor):
        raise InputError(
            f"the snapshot's sensor {number} sees landmarks, {model.name} does not; build the smoother with the sensors of its run"
        )
    return model
