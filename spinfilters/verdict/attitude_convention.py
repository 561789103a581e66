"""Conventions of attitude that the places of a recording contradict.

A tracked point of a free body is at p = c + v t + a t^2 / 2 + R(q) d, with an offset d from the centre of mass. Attitudes that are
read inverted, with the scalar first where it is last, or in a left-handed frame turn as another body may turn, so that no residual
of theirs shows it; but places follow them in the right convention alone.
"""

from collections.abc import Callable
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import angle_between, inverse, matrix_from_quaternion
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.estimators.smoothing.closed_form import path_rows

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


def _mirrored(axis: int) -> Callable[[Quaternions], Matrices]:
    """Attitudes in a frame of which one axis points the other way."""
    signs = np.where(np.arange(3) == axis, -1.0, 1.0)
    return lambda q: signs[:, None] * matrix_from_quaternion(q)


OTHERS: Final[dict[str, Callable[[Quaternions], Matrices]]] = {
    "inverted": lambda q: matrix_from_quaternion(inverse(q)),
    "with the scalar first": lambda q: matrix_from_quaternion(_scalar_first(q)),
    "with the scalar first, and inverted": lambda q: matrix_from_quaternion(inverse(_scalar_first(q))),
    "in a frame with another x axis": _mirrored(0),
    "in a frame with another y axis": _mirrored(1),
    "in a frame with another z axis": _mirrored(2),
}
"""Rotations of quaternions that are not x, y, z, w of the body's attitude in the right-handed frame of its places."""


def contradicted_convention(stream: MeasurementStream) -> tuple[str, float, float] | None:
    """Convention that explains places of poses, and the rms (m) of both.

    It and the one that is read leave these; None where the latter explains places as well.

    Parameters
    ----------
    stream: of poses (p m, q_ig) in its columns.
    """
    time, values = stream.time[:MOST_EPOCHS], stream.values[:MOST_EPOCHS]
    if len(time) < FEWEST_EPOCHS:
        return None
    places, q = values[:, :3], values[:, 3:]
    if angle_between(q, q[:1]).max() < LEAST_TURN:
        return None
    read = _rms(_unexplained(time, places, matrix_from_quaternion(q)))
    left = {name: _unexplained(time, places, other(q)) for name, other in OTHERS.items()}
    best = min(left, key=lambda name: _rms(left[name]))
    rest = _rms(left[best])
    ratio = np.sum(np.diff(left[best], axis=0) ** 2) / max(np.sum(left[best] ** 2), np.finfo(float).tiny)
    share = SHARE if ratio > NOISY else SHARE_OF_SLOW
    return (best, rest, read) if rest**2 < share * read**2 else None


def _rms(residual: Places) -> float:
    """Root mean square, corrected for the twelve numbers that were fitted."""
    return float(np.sqrt(np.sum(residual**2) / (residual.size - 12)))


def _unexplained(time: Float[np.ndarray, " n"], places: Places, R: Matrices) -> Places:
    """Places (m) about a parabola and an offset that turns with the attitude."""
    A = path_rows((time - time[0]) / (time[-1] - time[0]), R, accelerated=True)
    right = -(places - places.mean(axis=0)).reshape(-1)
    return (right - A @ np.linalg.lstsq(A, right, rcond=None)[0]).reshape(-1, 3)
