"""Free flights of a gyro log: stretches in which some inertia tensor keeps the angular momentum constant.

Attitudes R_k of the body come from the rates themselves; in flight R_k J w_k = h is constant, or only falls where the air brakes.
That is linear in the six elements of J and in h: no inertia need be known, the tensor is the one that keeps h best.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg
from jaxtyping import Float, Int

from spinfilters.core.attitude_conversions import cross_matrix, integrate_gyro, matrix_from_quaternion
from spinfilters.io.measurement_log import Acceleration
from spinfilters.run.flight_windows import (
    Stretch,
    covered,
    noise_level,
    pieces_between_gaps,
    runs_of,
    window_samples,
    without_overlap,
)

ROTATION: Final = 2.0
"""Of a window, rad: less says little of a tensor."""
FEWEST: Final = 16
_WINDOWS_AT_ONCE = 2048
_NEEDLE = 1e-4
"""Weight of |J|^2 |w|^2 against |J w|^2: keeps away tensors to which the rates of a window are blind."""
DRAGS: Final = (0.0, 0.0075, 0.015, 0.03)
"""Shares of |h| that air may take per rad: a racquet loses 0.0145."""
_UNKNOWNS = 9  # of J up to scale, of h, of the drag
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


@dataclass(frozen=True, eq=False)
class RotationHistory:
    """Attitudes from body rates.

    Attributes
    ----------
    time : ndarray of float, shape (n,)
        Stamps, s.
    rates : ndarray of float, shape (n, 3)
        Body rates, rad/s.
    angle : ndarray of float, shape (n,)
        Rotated since the first sample, rad.
    momentum : ndarray of float, shape (n, 3, 6)
        Angular momentum R J w over the elements xx, yy, zz, xy, xz, yz of J.
    """

    time: Float[np.ndarray, " n"]
    rates: Float[np.ndarray, "n 3"]
    angle: Float[np.ndarray, " n"]
    momentum: Float[np.ndarray, "n 3 6"]


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


def rotation_history(time: Float[np.ndarray, " n"], rates: Float[np.ndarray, "n 3"]) -> RotationHistory:
    """Attitudes from the first sample on, by rates that are linear between samples."""
    step, middle = np.diff(time)[:, None], 0.5 * (rates[1:] + rates[:-1])
    attitude = matrix_from_quaternion(integrate_gyro(time, rates, np.array([0.0, 0.0, 0.0, 1.0])))
    angle = np.concatenate([[0.0], np.cumsum(np.linalg.norm(middle, axis=1) * step[:, 0])])
    return RotationHistory(time, rates, angle, attitude @ _tensor_rows(rates))


def _tensor_rows(rates: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 6"]:
    """J w as a matrix times the elements xx, yy, zz, xy, xz, yz of J."""
    x, y, z = rates.T
    o = np.zeros_like(x)
    return np.stack(
        [np.stack([x, o, o, y, z, o], 1), np.stack([o, y, o, x, o, z], 1), np.stack([o, o, z, o, x, y], 1)], 1
    )


def window_ends(history: RotationHistory) -> Int[np.ndarray, " n"]:
    """Exclusive ends of the windows from each sample on.

    Beyond the last sample where a window does not fit.
    """
    turned = np.searchsorted(history.angle, history.angle + ROTATION) + 1
    ends = np.maximum(turned, np.arange(len(history.time)) + FEWEST)
    return np.where(turned > len(history.time), len(history.time) + 1, ends)


def momentum_errors(
    history: RotationHistory, starts: Int[np.ndarray, " m"], ends: Int[np.ndarray, " m"]
) -> Float[np.ndarray, " m"]:
    """Root mean square of R J w - h over |J w| of every window.

    J, h and drag are the best ones of the window.
    """
    return np.concatenate(
        [
            _errors(history, starts[k : k + _WINDOWS_AT_ONCE], ends[k : k + _WINDOWS_AT_ONCE])
            for k in range(0, len(starts), _WINDOWS_AT_ONCE)
        ]
        or [np.empty(0)]
    )


def _errors(
    history: RotationHistory, starts: Int[np.ndarray, " m"], ends: Int[np.ndarray, " m"]
) -> Float[np.ndarray, " m"]:
    chosen = window_samples(starts, ends)
    rows, angle, count = history.momentum[chosen], history.angle[chosen], 3 * chosen.shape[1]
    angle = angle - angle.mean(axis=1, keepdims=True)
    size = np.einsum("mkij,mkil->mjl", rows, rows)
    errors = []
    for drag in DRAGS:
        # constant where the air takes that share of h per rad
        kept = rows * np.exp(drag * angle)[:, :, None, None]
        left = kept - kept.mean(axis=1, keepdims=True)
        errors.append(_smallest(np.einsum("mkij,mkil->mjl", left, left), size))
    return np.min(errors, axis=0) * np.sqrt(count / max(count - _UNKNOWNS, 1))


def _smallest(error: Float[np.ndarray, "m 6 6"], size: Float[np.ndarray, "m 6 6"]) -> Float[np.ndarray, " m"]:
    """Root of the smallest of j' error j over j' size j."""
    trace = np.trace(size, axis1=1, axis2=2)
    ridge = np.maximum(_NEEDLE * trace / 6, 1e-300)[:, None, None]
    lower = np.linalg.cholesky(size + ridge * np.eye(6))
    half = np.linalg.solve(lower, error)
    whitened = np.linalg.solve(lower, half.transpose(0, 2, 1))
    smallest = np.linalg.eigvalsh(0.5 * (whitened + whitened.transpose(0, 2, 1)))[:, 0]
    return np.sqrt(np.maximum(smallest, 0.0))


def inertia_tensor(history: RotationHistory, start: int, end: int) -> Float[np.ndarray, "3 3"]:
    """Least-squares inertia over a stretch, of unit largest moment, not necessarily physical."""
    rows, angle = history.momentum[start:end], history.angle[start:end]
    basis, _ = np.linalg.qr(np.column_stack([np.ones(len(angle)), angle - angle.mean()]))
    flat = rows.reshape(len(rows), 18)
    left = (flat - basis @ (basis.T @ flat)).reshape(-1, 6)
    size = rows.reshape(-1, 6).T @ rows.reshape(-1, 6)
    ridge = _NEEDLE * np.trace(size) / 6 + 1e-300
    j = scipy.linalg.eigh(left.T @ left, size + ridge * np.eye(6))[1][:, 0]
    tensor = np.array([[j[0], j[3], j[4]], [j[3], j[1], j[5]], [j[4], j[5], j[2]]])
    tensor *= np.sign(np.trace(tensor)) or 1.0
    return tensor / np.abs(np.linalg.eigvalsh(tensor)).max()


@dataclass(frozen=True)
class MomentumChange:
    """Change of a stretch's angular momentum, for an inertia tensor.

    Attributes
    ----------
    error : float
        Root mean square about a straight line over the angle, over |h|.
    loss : float
        Of |h| from start to end, as a share.
    turn : float
        Of its direction from start to end, rad; air slows a body, but what turns h is another torque.
    """

    error: float
    loss: float
    turn: float


def momentum_change(history: RotationHistory, tensor: Float[np.ndarray, "3 3"]) -> MomentumChange:
    """Momentum, in the attitudes' frame, as a straight line over the rotation angle."""
    elements = tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    momentum = history.momentum @ elements
    basis = np.column_stack([np.ones(len(momentum)), history.angle])
    line, *_ = np.linalg.lstsq(basis, momentum, rcond=None)
    first, last = basis[[0, -1]] @ line
    size = np.linalg.norm(first), np.linalg.norm(last)
    error = np.sqrt(np.mean(np.sum((momentum - basis @ line) ** 2, axis=1)))
    turn = np.arctan2(np.linalg.norm(np.cross(first, last)), first @ last)
    return MomentumChange(float(error / size[0]), float(1 - size[1] / size[0]), float(turn))


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
