"""Free flights of a pose log: stretches in which a point of the body moves on a parabola.

A fixed point c of the body, its centre of mass, has a constant acceleration: p_k + R_k c = r + v t_k + g t_k^2 / 2, which is linear
in r, v, c and g. On the ground the acceleration found is another one, or none fits. Flights lie between jumps of rotation: a touch
changes the rate of a body at once, and so does a hand as it lets go, which its place shows only later.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.attitude_conversions import (
    angle_from_matrix,
    matrix_from_quaternion,
    rotation_vector_from_matrix,
)
from spinfilters.run.flight_windows import (
    Stretch,
    covered,
    noise_level,
    pieces_between_gaps,
    runs_of,
    window_samples,
    without_overlap,
)

GRAVITY: Final = 9.81
GRAVITY_TOLERANCE: Final = 0.1
"""Of `GRAVITY`, for that which a recording shows: a lens a few per cent off, a window that is short."""
FEWEST: Final = 12
CENTRE_STD: Final = 0.1
"""Standard deviation of a coordinate of the centre of mass in frame g, m: all a short flight says of it is weak."""
LARGEST_ERROR: Final = 5.0
"""Of a window in standard deviations of the positions' noise, with the noise at least `LEAST_NOISE`."""
LEAST_NOISE: Final = 2e-5
WEAKEST: Final = 0.03
"""m/s^2: a force of this size is noticed where there is no gravity; hands are a hundred times stronger."""
SHORTEST: Final = 0.08
"""s: of a flight under gravity; a hand that shakes a body is as fast as a fall for less."""
LONGER: Final = 1.5
"""Factor from windows to the next longer ones."""
ENDS: Final = 6
"""Share of a flight at each end, one over this, that is tested sample by sample against the parabola of the others."""
FEWEST_ENDS: Final = 4
WINDOW_SHARE: Final = 12
"""Windows begin this share of a window apart, or at every sample."""
LEAST_RUN: Final = 3
"""Windows in a row that make a flight."""
LEAST_ROTATION: Final = 1.0
"""Of a flight without gravity, rad: a body at rest flies through nothing."""
_WINDOWS_AT_ONCE = 512
_CURVATURE = 12.0 * np.sqrt(5.0)
"""Root mean square of t^2 / 2 over T, without its line, is T^2 over this number."""


@dataclass(frozen=True, eq=False)
class PoseLog:
    """Times (s), positions of g in i (m), attitudes R_ig and noise of the positions (m) of a pose log."""

    time: Float[np.ndarray, " n"]
    position: Float[np.ndarray, "n 3"]
    attitude: Float[np.ndarray, "n 3 3"]
    noise: float

    @classmethod
    def of(
        cls, time: Float[np.ndarray, " n"], values: Float[np.ndarray, "n 7"], stated: float | None
    ) -> "PoseLog":
        """Log of position and quaternion, scalar last.

        The noise is that of the data, or the stated one where that is more.
        """
        noise = max(noise_level(values[:, :3]), stated or 0.0, LEAST_NOISE)
        attitude = matrix_from_quaternion(
            values[:, 3:] / np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
        )
        return cls(time, values[:, :3], attitude, noise)

    def rotation(self, stretch: Stretch) -> float:
        """Angle through which the body turns within a stretch, rad."""
        rows = self.attitude[stretch.start : stretch.end]
        return float(angle_from_matrix(np.swapaxes(rows[:-1], 1, 2) @ rows[1:]).sum())


def pose_flights(log: PoseLog) -> list[Stretch]:
    """Stretches of free flight: under gravity, or else without any force.

    Gravity is the acceleration, within a tenth of 9.81 m/s^2, that most windows agree on.
    """
    pieces = pieces_between_gaps(log.time)
    falling = [flight for piece in pieces for flight in _falling(log, piece)]
    return falling or [flight for piece in pieces for flight in _floating(log, piece)]


def acceleration_of(log: PoseLog, stretch: Stretch) -> tuple[Float[np.ndarray, " 3"], float]:
    """Acceleration of the point that flies best, m/s^2, and the root mean square of what it leaves, m."""
    starts, ends = np.array([stretch.start]), np.array([stretch.end])
    solution, error = fit_parabola(log, starts, ends, None)
    return solution[0, 9:12], float(error[0])


def _falling(log: PoseLog, piece: Stretch) -> list[Stretch]:
    windows = _windows(log, piece, GRAVITY)
    if windows is None:
        return []
    starts, ends = windows
    solution, error = fit_parabola(log, starts, ends, None)
    strength = np.linalg.norm(solution[:, 9:12], axis=1)
    near = np.abs(strength - GRAVITY) <= GRAVITY_TOLERANCE * GRAVITY
    gravity = _agreed_acceleration(solution[near & (error <= LARGEST_ERROR * log.noise), 9:12])
    if gravity is None:
        return []
    return _flights(log, piece, gravity, 1.0)


def _flights(log: PoseLog, piece: Stretch, gravity: Float[np.ndarray, " 3"], factor: float) -> list[Stretch]:
    """Stretches that fall freely as a whole and in their windows.

    Those of which only the windows fall freely are sought with longer windows.

    Parameters
    ----------
    factor : float
        On the length of windows: what a hand does over a short one a centre of mass somewhere else explains.
    """
    windows = _windows(log, piece, GRAVITY, factor)
    if windows is None:
        return []
    starts, ends = windows
    _, error = fit_parabola(log, starts, ends, gravity)
    found: list[Stretch] = []
    for each in _stretches(error <= LARGEST_ERROR * log.noise, starts, ends):
        trimmed = _trim_stretch(log, each)
        if len(trimmed) >= FEWEST and _falls(log, trimmed, gravity):
            found.append(_let_go(log, trimmed))
        elif len(each) > ends[0] - starts[0]:
            found += _flights(log, each, gravity, LONGER * factor)
    return found


def _falls(log: PoseLog, stretch: Stretch, gravity: Float[np.ndarray, " 3"]) -> bool:
    """Whether a stretch is one parabola with the acceleration of gravity."""
    if log.time[stretch.end - 1] - log.time[stretch.start] < SHORTEST * (1 - 1e-9):
        return False
    acceleration, error = acceleration_of(log, stretch)
    return (
        error <= LARGEST_ERROR * log.noise
        and float(np.linalg.norm(acceleration - gravity)) <= 2 * GRAVITY_TOLERANCE * GRAVITY
    )


def _floating(log: PoseLog, piece: Stretch) -> list[Stretch]:
    windows = _windows(log, piece, WEAKEST)
    if windows is None:
        return []
    starts, ends = windows
    _, error = fit_parabola(log, starts, ends, np.zeros(3))
    found = _stretches(error <= LARGEST_ERROR * log.noise, starts, ends)
    return [each for each in found if _reach(log, each) >= LEAST_ROTATION]


def _windows(
    log: PoseLog, piece: Stretch, weakest: float, factor: float = 1.0
) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"]] | None:
    """Windows long enough to resolve an acceleration, m/s^2, or None."""
    duration = factor * np.sqrt(2 * LARGEST_ERROR * log.noise * _CURVATURE / weakest)
    time = log.time[piece.start : piece.end]
    last = np.maximum(np.searchsorted(time, time + duration), np.arange(len(time)) + int(factor * FEWEST) - 1)
    starts = np.flatnonzero(last < len(time))
    if not len(starts):
        return None
    starts = starts[:: max(1, int(np.median(last[starts] - starts)) // WINDOW_SHARE)]
    return starts + piece.start, last[starts] + 1 + piece.start


def _stretches(
    passed: Bool[np.ndarray, " m"], starts: Int[np.ndarray, " m"], ends: Int[np.ndarray, " m"]
) -> list[Stretch]:
    runs = [run for run in runs_of(passed) if len(run) >= LEAST_RUN]
    return without_overlap(covered(runs, starts, ends))


def _reach(log: PoseLog, stretch: Stretch) -> float:
    """Largest angle from the first attitude of a stretch, rad, in which noise does not add up."""
    rows = log.attitude[stretch.start : stretch.end]
    return float(angle_from_matrix(rows[0].T @ rows).max())


def _agreed_acceleration(found: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, " 3"] | None:
    """The acceleration with most others about it, as their median; None of none."""
    if not len(found):
        return None
    seeds = found[:: max(1, len(found) // 500)]
    near = np.linalg.norm(found[None] - seeds[:, None], axis=2) <= GRAVITY_TOLERANCE * GRAVITY
    best = near[np.argmax(near.sum(axis=1))]
    return np.median(found[best], axis=0)


def fit_parabola(
    log: PoseLog,
    starts: Int[np.ndarray, " m"],
    ends: Int[np.ndarray, " m"],
    gravity: Float[np.ndarray, " 3"] | None,
) -> tuple[Float[np.ndarray, "m unknowns"], Float[np.ndarray, " m"]]:
    """Parabola of every window by least squares, and its residual.

    Over r, v, c and, where it is not given, g; root mean square that is left, m.
    """
    parts = [
        _fit_windows(log, starts[k : k + _WINDOWS_AT_ONCE], ends[k : k + _WINDOWS_AT_ONCE], gravity)
        for k in range(0, len(starts), _WINDOWS_AT_ONCE)
    ]
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def _fit_windows(
    log: PoseLog,
    starts: Int[np.ndarray, " m"],
    ends: Int[np.ndarray, " m"],
    gravity: Float[np.ndarray, " 3"] | None,
) -> tuple[Float[np.ndarray, "m unknowns"], Float[np.ndarray, " m"]]:
    chosen = window_samples(starts, ends)
    time = log.time[chosen] - log.time[chosen].mean(axis=1, keepdims=True)
    scale = np.maximum(np.abs(time).max(axis=1, keepdims=True), 1e-300)
    design, target = _equations(log, chosen, time / scale, gravity, scale)
    unknowns = design.shape[2]
    normal = np.einsum("mij,mik->mjk", design, design) + _prior(log, unknowns)
    right = np.einsum("mij,mi->mj", design, target)
    solution = np.linalg.solve(normal, right[..., None])[..., 0]
    left = target - np.einsum("mij,mj->mi", design, solution)
    solution[:, 3:6] /= scale
    solution[:, 9:12] /= scale**2
    return solution, np.sqrt((left**2).sum(axis=1) / (target.shape[1] - unknowns))


def _equations(
    log: PoseLog,
    chosen: Int[np.ndarray, "m k"],
    time: Float[np.ndarray, "m k"],
    gravity: Float[np.ndarray, " 3"] | None,
    scale: Float[np.ndarray, "m 1"],
) -> tuple[Float[np.ndarray, "m rows unknowns"], Float[np.ndarray, "m rows"]]:
    """Design matrix over r, v, c (and g) and window positions, with time in units of ``scale`` seconds."""
    square = 0.5 * time**2
    eye = np.broadcast_to(np.eye(3), (*chosen.shape, 3, 3))
    columns, target = [eye, eye * time[..., None, None], -log.attitude[chosen]], log.position[chosen]
    if gravity is None:
        columns.append(eye * square[..., None, None])
    else:
        target = target - gravity * (square * scale**2)[..., None]
    rows = 3 * chosen.shape[1]
    return np.concatenate(columns, axis=3).reshape(len(chosen), rows, -1), target.reshape(len(chosen), rows)


def _prior(log: PoseLog, unknowns: int) -> Float[np.ndarray, "unknowns unknowns"]:
    """Information of the centre of mass in units of the positions' noise."""
    information = np.zeros((unknowns, unknowns))
    information[6:9, 6:9] = (log.noise / CENTRE_STD) ** 2 * np.eye(3)
    return information


def _trim_stretch(log: PoseLog, stretch: Stretch) -> Stretch:
    """The stretch without end samples that are off its middle's parabola, or before which the rotation jumps."""
    margin = max(FEWEST_ENDS, len(stretch) // ENDS)
    core = np.arange(stretch.start + margin, stretch.end - margin)
    if len(core) < FEWEST // 2:
        return stretch
    chosen = np.arange(stretch.start, stretch.end)[None]
    time = (log.time[chosen] - log.time[core].mean()) / (log.time[core[-1]] - log.time[core[0]])
    scale = np.full((1, 1), log.time[core[-1]] - log.time[core[0]])
    design, target = _equations(log, chosen, time, None, scale)
    within = np.repeat((chosen[0] >= core[0]) & (chosen[0] <= core[-1]), 3)
    normal = design[0][within].T @ design[0][within] + _prior(log, design.shape[2])
    error = target[0] - design[0] @ np.linalg.solve(normal, design[0][within].T @ target[0][within])
    spread = 1.0 + np.einsum("ij,ji->i", design[0], np.linalg.solve(normal, design[0].T))
    noise = max(float(np.sqrt(np.mean(error[within] ** 2))), log.noise)
    good = (np.abs(error) <= LARGEST_ERROR * noise * np.sqrt(spread)).reshape(-1, 3).all(axis=1)
    good &= turns_on(log.time[chosen[0]], log.attitude[chosen[0]], margin)
    bad = np.flatnonzero(~good)
    before, after = bad[bad < margin], bad[bad >= len(good) - margin]
    first = stretch.start + (int(before[-1]) + 1 if len(before) else 0)
    return Stretch(first, stretch.start + (int(after[0]) if len(after) else len(good)))


def _let_go(log: PoseLog, stretch: Stretch) -> Stretch:
    """A flight without the end samples whose rates are not its own."""
    rows, margin = np.s_[stretch.start : stretch.end], max(FEWEST_ENDS, len(stretch) // ENDS)
    good = np.flatnonzero(leads_on(log.time[rows], log.attitude[rows], margin))
    return Stretch(stretch.start + int(good[0]), stretch.start + int(good[-1]) + 1)


LARGEST_JUMP: Final = 10.0
"""Of the mean rate between two samples to the next, in root mean squares of those amid the flight."""
LARGEST_DEVIATION: Final = 2.5
"""Of a rate at an end from the parabola of those after it, in standard deviations of that: four of a hundred by chance."""
SLOWEST_RELEASE: Final = 4
"""Rates at each end, at most, that a hand may have changed."""
FEWEST_RATES: Final = 8
REACH: Final = 0.5
"""Rates that a parabola is fitted to, and rad within which it represents them."""
REMAINDER: Final = 1 / 24
"""Of the third order that a parabola leaves, over the rate and the cube of the angle."""
TINY: Final = 1e-9
"""rad/s: what arithmetic leaves of a uniform rotation."""


def turns_on(
    time: Float[np.ndarray, " n"], attitude: Float[np.ndarray, "n 3 3"], margin: int
) -> Bool[np.ndarray, " n"]:
    """Samples of the first and last ``margin`` reached without a rate jump.

    Parameters
    ----------
    attitude : ndarray of float, shape (n, 3, 3)
        R_ig at the stamps.
    margin : int
        Samples at each end; those between show how much the rate changes in flight.
    """
    good, rates = np.ones(len(time), dtype=bool), _body_rates(time, attitude)
    jumps = np.linalg.norm(np.diff(rates, axis=0), axis=1)  # of samples k, k + 1 and k + 2
    amid = jumps[margin : len(time) - margin - 2]
    if not amid.size or margin < 1:
        return good
    large = jumps > LARGEST_JUMP * max(float(np.sqrt(np.mean(amid**2))), TINY)
    good[:margin] = ~large[:margin]
    good[-margin:] = ~large[-margin:]
    return good


def leads_on(
    time: Float[np.ndarray, " n"], attitude: Float[np.ndarray, "n 3 3"], margin: int
) -> Bool[np.ndarray, " n"]:
    """Samples reached at the rate of the flight's middle.

    False of the first and last ones in a row whose rate is another. Parameters: as `turns_on`.
    """
    good, margin = np.ones(len(time), dtype=bool), min(margin, SLOWEST_RELEASE)
    if margin < 1 or len(time) - 1 - 2 * margin < FEWEST_RATES:
        return good
    rates, middle = _body_rates(time, attitude), (time[1:] + time[:-1]) / 2
    good[: _count_departing(middle, rates, margin)] = False
    good[len(time) - _count_departing(-middle[::-1], rates[::-1], margin) :] = False
    return good


def _count_departing(time: Float[np.ndarray, " r"], rates: Float[np.ndarray, "r 3"], margin: int) -> int:
    """Number of leading rates, up to ``margin``, off the parabola of those after."""
    angle = np.linalg.norm(np.median(rates[margin : len(rates) - margin], axis=0)) * np.abs(time - time[0])
    last = max(margin + FEWEST_RATES, int(np.searchsorted(angle, REACH)))
    near = np.s_[margin : min(last, len(rates) - margin)]
    design = np.vander((time - time[near].mean()) / np.ptp(time[near]), 3)
    normal = design[near].T @ design[near]
    error = rates - design @ np.linalg.solve(normal, design[near].T @ rates[near])
    noise = np.sqrt(np.sum(error[near] ** 2) / (3 * (len(design[near]) - 3)))
    spread = np.sqrt(1 + np.einsum("ij,ji->i", design, np.linalg.solve(normal, design.T)))
    speed = angle[near][-1] / abs(time[near][-1] - time[0])
    remainder = REMAINDER * speed * (angle[near][-1] - angle) ** 3
    size = np.abs(error).max(axis=1)
    off = size > LARGEST_DEVIATION * max(noise, TINY) * spread + remainder
    off[1:] &= size[1:] <= size[:-1]  # what a hand leaves decays; what grows inwards is a gross error
    return margin if off[:margin].all() else int(np.argmin(off[:margin]))


def _body_rates(
    time: Float[np.ndarray, " n"], attitude: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, "r 3"]:
    """Mean rates between attitudes R_ig, rad/s, body axes."""
    by = np.swapaxes(attitude[:-1], 1, 2) @ attitude[1:]
    return rotation_vector_from_matrix(by) / np.diff(time)[:, None]
