"""Free flights of a recording, and the evidence for them: where some inertia tensor keeps the angular momentum of a gyro log, or
poses move as a free body does.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import cross_matrix
from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset, Segment
from spinfilters.io.measurement_log import Acceleration, MeasurementStream
from spinfilters.io.stated_values import to_state
from spinfilters.run.flight_windows import (
    ROTATION,
    MomentumChange,
    PoseLog,
    RotationHistory,
    Stretch,
    acceleration_of,
    covered,
    inertia_tensor,
    momentum_change,
    momentum_errors,
    noise_level,
    pieces_between_gaps,
    pose_flights,
    rotation_history,
    runs_of,
    window_ends,
    without_overlap,
)

LARGEST_ERROR: Final = 0.01
"""Of the momentum over a window: scale errors of gyros leave 0.1 to 0.9 %, a hand 2 % and more."""
NOISE_SHARE: Final = 4.0
LARGEST_NOISY_ERROR: Final = 0.05
"""The noise, over the rate and this many times, may come on top, up to here."""
OF_ITS_OWN: Final = 4.0
SMALLEST_ERROR: Final = 4e-3
"""A window counts as part of a flight up to so many times the flight's median error, and below the second in any case."""
SLOWEST_NOISE: Final = 10.0
SLOWEST_SHARE: Final = 0.02
"""Windows whose rate is below so many deviations of the noise, or this share of the log's largest rate, are at rest."""
LEAST_ROTATION: Final = 2 * ROTATION
FEWEST_SAMPLES: Final = 24
WINDOW_SHARE: Final = 16
"""Windows begin this share of a window apart, or at every sample."""


def gyro_flights(time: Float[np.ndarray, " n"], rates: Float[np.ndarray, "n 3"]) -> list[Stretch]:
    """Stretches of free flight of a log of body rates (s, rad/s)."""
    noise, largest = noise_level(rates), float(np.linalg.norm(rates, axis=1).max())
    slowest = max(SLOWEST_NOISE * noise, SLOWEST_SHARE * largest, 1e-12)
    found: list[Stretch] = []
    for piece in pieces_between_gaps(time):
        if len(piece) >= FEWEST_SAMPLES:
            rows = np.s_[piece.start : piece.end]
            history = rotation_history(time[rows], rates[rows])
            found += [
                Stretch(piece.start + each.start, piece.start + each.end)
                for each in _flights(history, noise, slowest)
            ]
    return found


def _flights(history: RotationHistory, noise: float, slowest: float) -> list[Stretch]:
    ends = window_ends(history)
    starts = np.flatnonzero(ends <= len(history.time))
    if not len(starts):
        return []
    starts = starts[:: max(1, int(np.median(ends[starts] - starts)) // WINDOW_SHARE)]
    ends = ends[starts]
    duration = history.time[ends - 1] - history.time[starts]
    speed = (history.angle[ends - 1] - history.angle[starts]) / duration
    moving = speed > slowest
    errors = np.full(len(starts), np.inf)
    errors[moving] = momentum_errors(history, starts[moving], ends[moving])
    allowed = LARGEST_ERROR + np.minimum(
        NOISE_SHARE * noise / np.maximum(speed, slowest), LARGEST_NOISY_ERROR
    )
    passed = errors <= allowed
    for run in runs_of(passed):
        inside = np.s_[run.start : run.end]
        own = max(OF_ITS_OWN * float(np.median(errors[inside])), SMALLEST_ERROR)
        passed[inside] &= errors[inside] <= own
    stretches = without_overlap(covered(runs_of(passed), starts, ends))
    return [each for each in stretches if _is_long(history, each)]


def _is_long(history: RotationHistory, stretch: Stretch) -> bool:
    rotation = history.angle[stretch.end - 1] - history.angle[stretch.start]
    return len(stretch) >= FEWEST_SAMPLES and rotation >= LEAST_ROTATION


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


LARGEST_FORCE: Final = 2.5
"""m/s^2, root mean square, that rotation may leave unexplained: drag and scale errors leave less, a hand or a table 9.8."""
FARTHEST: Final = 2.0
"""Metres from the centre of mass at which a sensor may sit, as standard deviation."""


def unexplained_force(
    force: Acceleration, time: Float[np.ndarray, " n"], rates: Float[np.ndarray, "n 3"]
) -> float | None:
    """Rms specific force beyond the best sensor place, m/s^2.

    Without that of the best place of the sensor.
    The force at r from the centre of mass is w' x r + w x (w x r), linear in r. None where fewer than four samples were taken.

    Parameters
    ----------
    time, rates
        Of the gyro, s and rad/s.
    """
    inside = (force.time >= time[0]) & (force.time <= time[-1])
    if np.count_nonzero(inside) < 4 or len(time) < 4:
        return None
    stamps, measured = force.time[inside], force.values[inside]
    slope = np.gradient(rates, time, axis=0)
    rate, acceleration = (
        np.column_stack([np.interp(stamps, time, column) for column in each.T]) for each in (rates, slope)
    )
    design = (cross_matrix(acceleration) + cross_matrix(rate) @ cross_matrix(rate)).reshape(-1, 3)
    prior = np.eye(3) * (LARGEST_FORCE / FARTHEST) ** 2
    place = np.linalg.solve(design.T @ design + prior, design.T @ measured.reshape(-1))
    left = measured.reshape(-1) - design @ place
    return float(np.sqrt(np.mean(left.reshape(-1, 3) ** 2) * 3))
