"""Values of a recording that no recording has in the unit in which they are read.

A wrong unit scales time, rates or lengths by a factor that torque-free motion allows, so that no residual shows it. What shows it
is the size of things: what cameras, bodies and gyros are like, and that rates change little while the body turns many times.
A wrong convention of attitudes is contradicted by the places beside them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from spinfilters.data.dataset import Dataset
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.sensors.sensor_registry import sensor_of
from spinfilters.state.quantities import ALL, RATE, TRANSLATION, VELOCITY
from spinfilters.verdict.attitude_convention import contradicted_convention

SHORTEST_INTERVAL: Final = 2e-5
"""Between epochs of the fastest gyros, s."""
LONGEST_INTERVAL: Final = 60.0
"""Between images of the slowest cameras, s."""
LARGEST_BASELINE: Final = 20.0
"""Of a pair of cameras, m."""
FARTHEST: Final = 300.0
"""Of a tracked body from the origin of its poses, m."""
LARGEST_RATE: Final = float(np.deg2rad(4000.0))
"""Median of a gyro's rates, rad/s: the full scale of the fastest common sensors, which a thrown disc nearly reaches."""
SMOOTH: Final = 0.3
"""Change of a rate from one sample to the next, relative to it, below which a body does not turn much in between."""
OF_CLOCK: Final = frozenset({VELOCITY, RATE})
"""Quantities that a wrong unit of time scales: free rotation has no time of its own, so that moments and axes stay."""
LONGEST_TURN: Final = 6 * np.pi
"""Rotation from one sample to the next of slow telemetry, rad."""


@dataclass(frozen=True)
class WrongUnit:
    """A unit or convention that is probably another.

    Its name among model errors, what shows it, what to do, and the quantities that it changes.
    """

    name: str
    sentence: str
    cure: str
    about: frozenset[str] = ALL


def wrong_units(dataset: Dataset) -> list[WrongUnit]:
    """Wrong units of streams and cameras; empty where all are plausible."""
    found = [each for stream in dataset.log.streams for each in _of_stream(stream)]
    if dataset.rig is not None and dataset.rig.baseline_m > LARGEST_BASELINE:
        sentence = f"the cameras' baseline is {dataset.rig.baseline_m:.3g} m"
        found.append(WrongUnit("length-unit", sentence, "give the calibration in m, not in mm", TRANSLATION))
    return list({each.name: each for each in found}.values())


def _of_stream(stream: MeasurementStream) -> Iterator[WrongUnit]:
    times = stream.epoch_times
    interval = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    if not SHORTEST_INTERVAL <= interval <= LONGEST_INTERVAL:
        sentence = f"{stream.sensor} measurements are {interval:.3g} s apart"
        yield WrongUnit(
            "clock-unit", sentence, "state the unit of the time stamps (--clock ms, us or ns)", OF_CLOCK
        )
    rates = sensor_of(stream.sensor).measured_rates(stream)
    if rates is not None and len(rates) > 1:
        yield from _of_rates(stream, rates, interval)
    elif sensor_of(stream.sensor).sees_place and stream.values.shape[1] == 7:
        farthest = float(np.median(np.linalg.norm(stream.values[:, :3], axis=1)))
        if farthest > FARTHEST:
            sentence = f"the poses are {farthest:.3g} m away"
            yield WrongUnit("length-unit", sentence, "give places in m, not in mm", TRANSLATION)
        yield from _of_attitudes(stream)


def _of_attitudes(stream: MeasurementStream) -> Iterator[WrongUnit]:
    found = contradicted_convention(stream)
    if found is None:
        return
    name, left, read = found
    sentence = f"places follow the attitudes to {left:.2g} m where these are read {name}, as they are to {read:.2g} m"
    cure = "give quaternions of the body's attitude in the frame of its places (q_ig), the scalar last"
    yield WrongUnit("attitude-convention", sentence, cure)


def _of_rates(stream: MeasurementStream, rates: np.ndarray, interval: float) -> Iterator[WrongUnit]:
    sizes = np.linalg.norm(rates, axis=1)
    size, turn = float(np.median(sizes)), float(np.median(sizes)) * interval
    change = float(np.median(np.linalg.norm(np.diff(rates, axis=0), axis=1))) / max(size, 1e-300)
    aliased = turn > LONGEST_TURN and change < SMOOTH
    if not (aliased or size > LARGEST_RATE):
        return
    sentence = f"the {stream.sensor} reads {size:.3g} rad/s"
    if aliased:
        sentence += f", {turn:.3g} rad between samples that differ by {change:.0%}"
    yield WrongUnit("gyro-unit", sentence, "state the unit of its rates (--unit deg/s), or that of its clock")
