"""Free flights of a recording, and the evidence for them: where some inertia tensor keeps the angular momentum of a gyro log, or
poses move as a free body does.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset, Segment
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.stated_values import to_state
from spinfilters.run.flight_windows import Stretch
from spinfilters.run.gyro_flights import (
    LARGEST_FORCE,
    MomentumChange,
    gyro_flights,
    inertia_tensor,
    momentum_change,
    rotation_history,
    unexplained_force,
)
from spinfilters.run.pose_flights import PoseLog, acceleration_of, pose_flights

LARGEST_GAIN: Final = 0.05
"""Share of the momentum that may come on top over a flight, by noise: air only takes some, and a hand gives it."""
LARGEST_STEP: Final[float] = np.pi
"""Rotation from one sample to the next, rad: of a flight that is sampled more slowly nothing is known in between."""
WHOLE: Final = 0.9
"""Share of a recording's time from which on it counts as all flight."""


@dataclass(frozen=True)
class FreeFlight:
    """A stretch in which no torque acts that the test could see.

    Attributes
    ----------
    start, end : float
        On the clock of the recording, s.
    epochs : int
        Measurements within.
    rotation : float
        Of the body within, rad.
    evidence : str
        In words.
    """

    start: float
    end: float
    epochs: int
    rotation: float
    evidence: str

    def segment(self, number: int) -> Segment:
        """The flight as a segment of a recording."""
        return Segment(number, self.start, self.end, True, self.evidence)


def find_flights(dataset: Dataset) -> list[FreeFlight]:
    """Free flights of a recording of body rates or poses, in order of time.

    Raises
    ------
    InputError
        Measurements of other kinds; rates between whose samples a body turns by more than half a revolution.
    """
    finder = _FINDERS.get(dataset.sensor)
    if finder is None:
        raise InputError(
            f"{dataset.name}: free flight is found in body rates and poses, these are {dataset.kind}; "
            "give its times as --segment START:END"
        )
    return finder(dataset, dataset.log.stream(dataset.sensor))


def flights_within(dataset: Dataset) -> list[FreeFlight]:
    """Free flights of a recording that is not all flight."""
    if dataset.sensor not in _FINDERS:
        return []
    flights = find_flights(dataset)
    flying = sum(flight.end - flight.start for flight in flights)
    return flights if flying < WHOLE * (dataset.log.end - dataset.log.start) else []


def flying_unit(dataset: Dataset) -> str:
    """Advice on the unit of lengths or time in which poses would show a flight; empty where none would."""
    finder = _UNITS.get(dataset.sensor)
    return "" if finder is None else finder(dataset.log.stream(dataset.sensor))


def _unit_of_poses(stream: MeasurementStream) -> str:
    small = np.array([1e-3, 1e-3, 1e-3, 1, 1, 1, 1])
    for advice, time, values in (
        ("the places are in mm: name their columns so (px_mm)", stream.time, stream.values * small),
        (f"the time stamps are in ms: give {to_state('clock', 'ms')}", stream.time * 1e-3, stream.values),
    ):
        if pose_flights(PoseLog.of(time, values, None)):
            return advice
    return ""


def _in_rates(dataset: Dataset, stream: MeasurementStream) -> list[FreeFlight]:
    """Flights by the angular momentum; an accelerometer, where there is one, has a veto."""
    found, too_far = [], []
    for stretch in gyro_flights(stream.time, stream.values):
        rows = np.s_[stretch.start : stretch.end]
        time, rates = stream.time[rows], stream.values[rows]
        force = None if dataset.acceleration is None else unexplained_force(dataset.acceleration, time, rates)
        if force is not None and force > LARGEST_FORCE:
            continue
        history = rotation_history(time, rates)
        step = float(history.angle[-1]) / (len(stretch) - 1)
        if step > LARGEST_STEP:
            too_far.append(step)
            continue
        change = momentum_change(history, inertia_tensor(history, 0, len(history.time)))
        if change.loss < -LARGEST_GAIN:
            continue
        found.append(_flight(stream, stretch, float(history.angle[-1]), _momentum_words(change, force)))
    if too_far and not found:
        raise InputError(
            f"{dataset.name}: the body turns by {min(too_far):.3g} rad from one sample to the next, too far to find a flight; "
            f"if the time stamps are in ms, give {to_state('clock', 'ms')}; if the rates are in deg/s, {to_state('unit', 'deg/s')}"
        )
    return found


def _momentum_words(change: MomentumChange, force: float | None) -> str:
    gone = f"{'falls' if change.loss > -5e-4 else 'grows'} {100 * abs(change.loss):.1f} %"
    words = f"momentum kept to {100 * change.error:.2g} %, {gone}, turns {np.rad2deg(change.turn):.1f} deg"
    return words if force is None else f"{words}, force {force:.2g} m/s^2"


def _in_poses(dataset: Dataset, stream: MeasurementStream) -> list[FreeFlight]:
    log = PoseLog.of(stream.time, stream.values, dataset.options.pose_position_std)
    found = []
    for stretch in pose_flights(log):
        acceleration, error = acceleration_of(log, stretch)
        words = f"acceleration {np.linalg.norm(acceleration):.2f} m/s^2, position left {1e3 * error:.2g} mm"
        found.append(_flight(stream, stretch, log.rotation(stretch), words))
    return found


def _flight(stream: MeasurementStream, stretch: Stretch, rotation: float, evidence: str) -> FreeFlight:
    start, end = float(stream.time[stretch.start]), float(stream.time[stretch.end - 1])
    return FreeFlight(start, end, len(stretch), rotation, evidence)


_UNITS: Final[dict[str, Callable[[MeasurementStream], str]]] = {"pose": _unit_of_poses}
_FINDERS: Final[dict[str, Callable[[Dataset, MeasurementStream], list[FreeFlight]]]] = {
    "gyro": _in_rates,
    "pose": _in_poses,
}
