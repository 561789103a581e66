"""Slips of a front end: one face of the body taken for another.

A tracker of poses, scans or landmarks that associates a symmetric body wrongly turns its attitude by a large angle, usually 180
degrees, from one epoch to the next, and goes on as before: R' = R S. The rotation from one epoch to the next, R_k+1 R_k', shows
S in that step alone and the body's own rotation in all others, before and behind it alike. No torque does that. A single epoch, or
two, is a gross error, which estimators refuse.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.attitude.conversions import (
    matrix_from_quaternion,
    quaternion_from_matrix,
    quaternion_from_rotation_vector,
    rotation_vector_from_quaternion,
)
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.sensor_format import sensor_format
from spinfilters.errors import NUMERICAL_ERRORS, InputError
from spinfilters.pipeline.setup import Setup, camera_view
from spinfilters.sensors.sensor_registry import sensor_of

NEIGHBOURS: Final = 2
"""Steps before and behind one, whose median rate says how far the body turned in it."""
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
    sensor: whose attitudes slip.   time: of the first epoch behind it, s.   angle: rad.   count: of slips in all.
    """

    sensor: str
    time: float
    angle: float
    count: int
    name: str = "slip"

    @property
    def sentence(self) -> str:
        """Sentence on the slip, with its time and angle."""
        more = f", the first of {self.count} jumps" if self.count > 1 else ""
        return (
            f"most like a slip of the front end: the attitude of {self.sensor} jumps by {np.degrees(self.angle):.0f} deg at "
            f"t = {self.time:.4g} s{more}, with the rate the same before and behind it, as where one face of the body is taken "
            "for another"
        )

    @property
    def cure(self) -> str:
        """Advice for the user."""
        return (
            "correct the association of the front end, or use the recording before or behind it (--segment); other causes are not "
            "named until then"
        )


def front_end_slips(setup: Setup, with_fits: bool) -> tuple[Slip, ...]:
    """Slips of the attitudes that streams tell, one for each sensor that slips.

    Parameters
    ----------
    with_fits: whether to look for them where every epoch's attitude has to be fitted to many rows, which takes time.
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
    return Slip(stream.sensor, float(samples.time[steps[0] + 1]), float(angles[0]), len(steps))


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
    rates = _rotation_vectors(steps) / dt[:, None]
    expected = _medians_of_neighbours(rates) * dt[:, None]
    turned = np.linalg.norm(expected, axis=1)
    departure = np.linalg.norm(_rotation_vectors(_rotations(-expected) @ steps), axis=1)
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
    """Median rate of the steps before and behind each one, fewer at the ends."""
    count, nothing = len(rates), np.full((NEIGHBOURS, 3), np.nan)
    padded = np.concatenate([nothing, rates, nothing])
    around = [k for k in range(2 * NEIGHBOURS + 1) if k != NEIGHBOURS]
    return np.nanmedian(np.stack([padded[k : k + count] for k in around]), axis=0)


def _without_gross_errors(found: Sequence[int]) -> Int[np.ndarray, " s"]:
    """Slips, without those that end after fewer epochs than `SHORTEST`."""
    gross = {step for pair in pairwise(found) if pair[1] - pair[0] < SHORTEST for step in pair}
    return np.array([step for step in found if step not in gross], dtype=int)


def _rotation_vectors(rotations: Float[np.ndarray, "k 3 3"]) -> Float[np.ndarray, "k 3"]:
    return rotation_vector_from_quaternion(quaternion_from_matrix(rotations))


def _rotations(vectors: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3 3"]:
    return matrix_from_quaternion(quaternion_from_rotation_vector(vectors))
