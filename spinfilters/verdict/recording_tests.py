"""Faults of a recording found without an estimator: slips of a front end, wrong units, attitude conventions, sparse poses."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.attitude_conversions import (
    angle_between,
    inverse,
    matrix_from_quaternion,
    quaternion_from_rotation_vector,
    rotation_vector_from_matrix,
)
from spinfilters.core.camera_trajectory import CameraTrajectory
from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.evaluation.epoch_spans import time_text
from spinfilters.inference.setup import Setup, camera_view
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_format import sensor_format
from spinfilters.io.stated_values import to_state
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.models.state_blocks import POSITION
from spinfilters.models.status import ALL, RATE, TRANSLATION, VELOCITY, Finding
from spinfilters.smoother.closed_form import path_rows
from spinfilters.verdict.checks import finding

NEIGHBOURS: Final = 2
"""Steps before and after one, whose median rate says how far the body turned in it."""
SMALLEST: Final = float(np.deg2rad(60.0))
"""Angle of a slip, rad: no face of a body that is mistaken for another lies nearer."""
BEYOND: Final = 6.0
"""Median departures of a step from its neighbours that a slip is, at least."""
LARGEST_DEPARTURE: Final = float(np.deg2rad(20.0))
"""Median departure, rad, beyond which steps say nothing of each other."""
LARGEST_TURN: Final = float(np.deg2rad(120.0))
"""Rotation in one step, rad, beyond which its sense is not known."""
SHORTEST: Final = 3
"""Epochs of a slip that ends: fewer are gross errors."""
MOST: Final = 0.1
"""Share of the steps that slip at most: more are attitudes of another convention, or none at all."""
FEWEST: Final = 8
"""Steps of a recording in which slips are looked for."""


@dataclass(frozen=True)
class Slip:
    """A slip of a front end.

    Attributes
    ----------
    sensor : str
        Whose attitudes slip.
    time, first : float
        Of the first epoch after it and of the first epoch of the recording, s.
    angle : float
        Rad.
    count : int
        Of slips in all.
    """

    sensor: str
    time: float
    first: float
    angle: float
    count: int
    name: str = "slip"

    @property
    def sentence(self) -> str:
        """Sentence on the slip, with its time and angle."""
        more = f", the first of {self.count} jumps" if self.count > 1 else ""
        return (
            f"most like a slip of the front end: the attitude of {self.sensor} jumps by {np.degrees(self.angle):.0f} deg at "
            f"{time_text(self.time, self.first)}{more}, with the rate the same before and after it, as where one face of the body "
            "is taken for another"
        )

    @property
    def cure(self) -> str:
        """Advice for the user."""
        return (
            "correct the association of the front end, or use the recording before or after it (--segment); other causes are not "
            "named until then"
        )


def front_end_slips(setup: Setup, with_fits: bool) -> tuple[Slip, ...]:
    """Slips of the attitudes that streams give, one for each sensor that slips.

    Parameters
    ----------
    with_fits : bool
        Whether to look for them where every epoch's attitude has to be fitted to many rows, which takes time.
    """
    found = []
    for stream in setup.log.streams:
        if with_fits or not sensor_format(stream.sensor).many_rows_an_epoch:
            slip = _slip_of(stream, setup)
            if slip is not None:
                found.append(slip)
    return tuple(found)


def _slip_of(stream: MeasurementStream, setup: Setup) -> Slip | None:
    try:
        with np.errstate(all="ignore"):
            samples = sensor_of(stream.sensor).initial_motion(stream, setup.noise, camera_view(setup.dataset))
    except (InputError, *NUMERICAL_ERRORS):
        return None
    if samples is None or samples.attitude is None:
        return None
    steps, angles = slipped_steps(samples.time, samples.attitude)
    if not steps.size:
        return None
    begin, first = float(samples.time[steps[0] + 1]), float(samples.time[0])
    return Slip(stream.sensor, begin, first, float(angles[0]), len(steps))


def slipped_steps(
    time: Float[np.ndarray, " k"], attitude: Float[np.ndarray, "k 4"]
) -> tuple[Int[np.ndarray, " s"], Float[np.ndarray, " s"]]:
    """Steps in which attitudes q_ig slip, and by which angle, rad.

    Step j leads from epoch j to epoch j + 1.
    """
    nothing, dt = (np.zeros(0, dtype=int), np.zeros(0)), np.diff(time)
    if len(dt) < FEWEST or not (np.isfinite(attitude).all() and dt.min() > 0):
        return nothing
    R = matrix_from_quaternion(attitude)
    steps = R[1:] @ np.swapaxes(R[:-1], 1, 2)
    rates = rotation_vector_from_matrix(steps) / dt[:, None]
    expected = _medians_of_neighbours(rates) * dt[:, None]
    turned = np.linalg.norm(expected, axis=1)
    back = matrix_from_quaternion(quaternion_from_rotation_vector(-expected))
    departure = np.linalg.norm(rotation_vector_from_matrix(back @ steps), axis=1)
    typical = float(np.median(departure))
    told = turned < LARGEST_TURN
    if typical > LARGEST_DEPARTURE or not np.median(told) > 0:
        return nothing
    found = np.flatnonzero(told & (departure > max(SMALLEST, BEYOND * typical)))
    if len(found) > max(MOST * len(dt), 1):
        return nothing
    found = _without_gross_errors(found.tolist())
    return found, departure[found]


def _medians_of_neighbours(rates: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
    """Median rate of the steps before and after each one, fewer at the ends."""
    count, nothing = len(rates), np.full((NEIGHBOURS, 3), np.nan)
    padded = np.concatenate([nothing, rates, nothing])
    around = [k for k in range(2 * NEIGHBOURS + 1) if k != NEIGHBOURS]
    return np.nanmedian(np.stack([padded[k : k + count] for k in around]), axis=0)


def _without_gross_errors(found: Sequence[int]) -> Int[np.ndarray, " s"]:
    """Slips, without those that end after fewer epochs than `SHORTEST`."""
    gross = {step for pair in pairwise(found) if pair[1] - pair[0] < SHORTEST for step in pair}
    return np.array([step for step in found if step not in gross], dtype=int)


FEWEST_EPOCHS: Final = 24
"""Fewer follow twelve numbers in any convention."""
LEAST_TURN: Final = 2.0
"""From the first attitude, rad: an arc that is shorter fits many readings."""
MOST_EPOCHS: Final = 1024
"""Of a recording that are compared."""
SHARE: Final = 0.5
"""Of the squares that the attitudes leave of the places as they are read, above which another reading may fit by chance."""
SHARE_OF_SLOW: Final = 0.02
"""The same where what the other reading leaves is slow, as of a body that is not rigid or not free."""
NOISY: Final = 1.5
"""Von Neumann's ratio of the squares of differences in time to the squares, 2 of white noise, below which a residual is slow."""

Quaternions = Float[np.ndarray, "n 4"]
Matrices = Float[np.ndarray, "n 3 3"]
Places = Float[np.ndarray, "n 3"]


def _scalar_first(q: Quaternions) -> Quaternions:
    """Quaternions of which the first number is the scalar, read as if the last were."""
    return np.roll(q, -1, axis=1)


def _mirror_axis(axis: int) -> Callable[[Quaternions], Matrices]:
    """Attitudes in a frame of which one axis points the other way."""
    signs = np.where(np.arange(3) == axis, -1.0, 1.0)
    return lambda q: signs[:, None] * matrix_from_quaternion(q)


OTHERS: Final[dict[str, Callable[[Quaternions], Matrices]]] = {
    "inverted": lambda q: matrix_from_quaternion(inverse(q)),
    "with the scalar first": lambda q: matrix_from_quaternion(_scalar_first(q)),
    "with the scalar first, and inverted": lambda q: matrix_from_quaternion(inverse(_scalar_first(q))),
    "in a frame with another x axis": _mirror_axis(0),
    "in a frame with another y axis": _mirror_axis(1),
    "in a frame with another z axis": _mirror_axis(2),
}
"""Rotations of quaternions that are not x, y, z, w of the body's attitude in the right-handed frame of its places."""


def contradicted_convention(stream: MeasurementStream) -> tuple[str, float, float] | None:
    """Convention that explains places of poses, and the rms (m) of both.

    It and the one that is read leave these; None where the latter explains places as well.

    Parameters
    ----------
    stream : MeasurementStream
        Of poses (p m, q_ig) in its columns.
    """
    time, values = stream.time[:MOST_EPOCHS], stream.values[:MOST_EPOCHS]
    if len(time) < FEWEST_EPOCHS:
        return None
    places, q = values[:, :3], values[:, 3:]
    if angle_between(q, q[:1]).max() < LEAST_TURN:
        return None
    read = _rms(_remove_parabola(time, places, matrix_from_quaternion(q)))
    left = {name: _remove_parabola(time, places, other(q)) for name, other in OTHERS.items()}
    best = min(left, key=lambda name: _rms(left[name]))
    rest = _rms(left[best])
    ratio = np.sum(np.diff(left[best], axis=0) ** 2) / max(np.sum(left[best] ** 2), np.finfo(float).tiny)
    share = SHARE if ratio > NOISY else SHARE_OF_SLOW
    return (best, rest, read) if rest**2 < share * read**2 else None


def _rms(residual: Places) -> float:
    """Root mean square, corrected for the twelve numbers that were fitted."""
    return float(np.sqrt(np.sum(residual**2) / (residual.size - 12)))


def _remove_parabola(time: Float[np.ndarray, " n"], places: Places, R: Matrices) -> Places:
    """Places (m) about a parabola and an offset that turns with the attitude."""
    A = path_rows((time - time[0]) / (time[-1] - time[0]), R, accelerated=True)
    right = -(places - places.mean(axis=0)).reshape(-1)
    return (right - A @ np.linalg.lstsq(A, right, rcond=None)[0]).reshape(-1, 3)


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
            "clock-unit",
            sentence,
            f"give the unit of the time stamps, {to_state('clock', 'ms, us or ns')}",
            OF_CLOCK,
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
    yield WrongUnit(
        "gyro-unit",
        sentence,
        f"give the unit of its rates, {to_state('unit', 'deg/s')}, or that of its clock",
    )


FEWEST_REPEATS: Final = 3
"""Intervals of one pose, from which it has not come about by rounding."""
ROUNDING: Final = 1e-9
"""m and rad: smaller errors of an interpolation are rounding of numbers, not bends of a path."""
ABRUPT: Final = 0.5
"""Of the step next to a repeated pose in the one before it, from which the camera did not come to rest: evenly braked it is 1/3."""


def pose_findings(setup: Setup) -> list[Finding]:
    """Findings about the given poses of an inspector."""
    return [*sparse_poses(setup), *repeated_poses(setup)]


def repeated_poses(setup: Setup) -> list[Finding]:
    """Findings where poses of a moving inspector stop from one to the next, as of a tracker that is lost or a log that ends."""
    trajectory = CameraTrajectory.of(setup.dataset.inspector)
    if trajectory is None:
        return []
    return [
        finding("repeated-inspector-poses", {"begin": begin, "end": end})
        for begin, end in repeats(trajectory)
    ]


def repeats(trajectory: CameraTrajectory) -> Iterator[tuple[float, float]]:
    """First and last time of each pose that repeats exactly right after, or before, poses that move on evenly."""
    steps = np.abs(np.diff(trajectory.poses, axis=0)).max(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], steps > 0, [True]]).astype(int)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        before, behind = steps[:first][::-1][:2], steps[last:][:2]
        is_abrupt = any(len(pair) == 2 and pair[0] > ABRUPT * pair[1] for pair in (before, behind))
        if last - first >= FEWEST_REPEATS and is_abrupt:
            yield float(trajectory.time[first]), float(trajectory.time[last])


def sparse_poses(setup: Setup) -> list[Finding]:
    """A finding where interpolated poses of the inspector are off by more than noise leaves of an epoch's pose.

    The errors of the interpolation follow from how its poses bend; in pixels they are common to an image, and compared with the
    pixel noise over the root of its observations.
    """
    dataset = setup.dataset
    trajectory, rig = CameraTrajectory.of(dataset.inspector), dataset.rig
    streams = [each for each in dataset.log.streams if sensor_format(each.sensor).calibration is not None]
    if trajectory is None or rig is None or not streams or setup.initial.has_failed:
        return []
    epochs = np.unique(np.concatenate([each.time for each in streams]))
    place, turn = trajectory.interpolation_errors(epochs)
    first = epochs[: len(setup.initial.mean)]
    body = setup.initial.mean[: len(first), setup.process.layout.mean_slice(POSITION.name)]
    distance = float(np.median(np.linalg.norm(body - trajectory.at(first)[:, :3], axis=1)))
    pixels = _root_mean_square(float(rig.calibration[0]) * (place / distance + turn))
    seen = sum(len(each) for each in streams) / len(epochs)
    if not pixels > setup.noise.pixel_std / np.sqrt(seen):
        return []
    apart = float(np.median(np.diff(trajectory.time)))
    off, turned = (
        size if size > ROUNDING else 0.0 for size in (_root_mean_square(place), _root_mean_square(turn))
    )
    numbers = {"interval": apart, "millimetres": 1e3 * off, "rotation": turned, "pixels": pixels}
    return [finding("sparse-inspector-poses", numbers)]


def _root_mean_square(values: Float[np.ndarray, " k"]) -> float:
    return float(np.sqrt(np.mean(values**2)))
