"""Constancy of the angular momentum over windows of a gyro log, and the stretches of samples that pass.

The inertia tensor is the one that keeps it best. Attitudes R_k of the body come from the rates themselves; in flight R_k J
w_k = h is constant, or only falls where the air brakes. That is linear in the six elements of J and in h: no inertia need be
known.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import scipy.linalg
from jaxtyping import Bool, Float, Int

from spinfilters.core.attitude_conversions import integrate_gyro, matrix_from_quaternion

ROTATION: Final = 2.0
"""Of a window, rad: less says little of a tensor."""
FEWEST: Final = 16
MOST: Final = 32
"""Samples of a window that are looked at."""
_WINDOWS_AT_ONCE = 2048
_NEEDLE = 1e-4
"""Weight of |J|^2 |w|^2 against |J w|^2: keeps away tensors to which the rates of a window are blind."""
DRAGS: Final = (0.0, 0.0075, 0.015, 0.03)
"""Shares of |h| that air may take per rad: a racquet loses 0.0145."""
_UNKNOWNS = 9  # of J up to scale, of h, of the drag


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


def rotation_history(time: Float[np.ndarray, " n"], rates: Float[np.ndarray, "n 3"]) -> RotationHistory:
    """Attitudes from the first sample on, by rates that are linear between samples."""
    step, middle = np.diff(time)[:, None], 0.5 * (rates[1:] + rates[:-1])
    attitude = matrix_from_quaternion(integrate_gyro(time, rates, np.array([0.0, 0.0, 0.0, 1.0])))
    angle = np.concatenate([[0.0], np.cumsum(np.linalg.norm(middle, axis=1) * step[:, 0])])
    return RotationHistory(time, rates, angle, attitude @ _tensor_rows(rates))


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
    count = min(MOST, int((ends - starts).max()))
    chosen = np.rint(np.linspace(starts, ends - 1, count, axis=1)).astype(int)
    rows, angle = history.momentum[chosen], history.angle[chosen]
    angle = angle - angle.mean(axis=1, keepdims=True)
    size = np.einsum("mkij,mkil->mjl", rows, rows)
    errors = []
    for drag in DRAGS:
        kept = (
            rows * np.exp(drag * angle)[:, :, None, None]
        )  # constant where the air takes that share of h per rad
        left = kept - kept.mean(axis=1, keepdims=True)
        errors.append(_smallest(np.einsum("mkij,mkil->mjl", left, left), size))
    return np.min(errors, axis=0) * np.sqrt(3 * count / max(3 * count - _UNKNOWNS, 1))


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


def _tensor_rows(rates: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 6"]:
    """J w as a matrix times the elements xx, yy, zz, xy, xz, yz of J."""
    x, y, z = rates.T
    o = np.zeros_like(x)
    return np.stack(
        [np.stack([x, o, o, y, z, o], 1), np.stack([o, y, o, x, o, z], 1), np.stack([o, o, z, o, x, y], 1)], 1
    )


LONGEST_STEP: Final = 5.0
"""Of the median step: a longer one is a gap, which no stretch spans."""


@dataclass(frozen=True)
class Stretch:
    """Samples start to end, the last one excluded."""

    start: int
    end: int

    def __len__(self) -> int:
        return self.end - self.start


def pieces_between_gaps(time: Float[np.ndarray, " n"]) -> list[Stretch]:
    """Stretches of a log that no gap interrupts."""
    step = np.diff(time)
    cuts = np.flatnonzero(step > LONGEST_STEP * np.median(step)) + 1 if len(step) else np.empty(0, int)
    edges = [0, *map(int, cuts), len(time)]
    return [Stretch(first, last) for first, last in pairwise(edges)]


def runs_of(passed: Bool[np.ndarray, " m"]) -> list[Stretch]:
    """Runs of consecutive windows that pass."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], passed.astype(int), [0]])))
    return [Stretch(int(first), int(last)) for first, last in edges.reshape(-1, 2)]


def covered(runs: list[Stretch], starts: Int[np.ndarray, " m"], ends: Int[np.ndarray, " m"]) -> list[Stretch]:
    """Samples that runs of windows cover; two that share more than half a window are one."""
    found: list[Stretch] = []
    for run in runs:
        stretch = Stretch(int(starts[run.start]), int(ends[run.end - 1]))
        window = int(ends[run.start] - starts[run.start])
        if found and 2 * (found[-1].end - stretch.start) > window:
            found[-1] = Stretch(found[-1].start, max(found[-1].end, stretch.end))
        else:
            found.append(stretch)
    return found


def without_overlap(stretches: list[Stretch]) -> list[Stretch]:
    """Stretches that share samples, such as flights before and after a bounce, each without them."""
    cut = list(stretches)
    for k in range(len(cut) - 1):
        if cut[k].end > cut[k + 1].start:
            first, last = cut[k + 1].start, cut[k].end
            cut[k], cut[k + 1] = Stretch(cut[k].start, first), Stretch(last, cut[k + 1].end)
    return [stretch for stretch in cut if stretch.end > stretch.start]


def noise_level(values: Float[np.ndarray, "n k"]) -> float:
    """Standard deviation of white noise on smooth components, by the median of their fourth differences."""
    if len(values) < 6:
        return 0.0
    difference = np.diff(values, 4, axis=0) / np.sqrt(70.0)
    return float(np.median(np.abs(difference), axis=0).max() / 0.6745)
