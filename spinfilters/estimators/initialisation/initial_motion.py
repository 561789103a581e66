"""Attitudes, body rates and positions measured directly in the first epochs.

Single gross errors are removed before closed-form estimation. A sample counts as wrong where it lies far from the line through
its neighbours, and where without it they lie on one. A motion that is fast for a few samples is left alone: without one of them
the others lie no better.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int

from spinfilters.attitude.conversions import (
    integrate_gyro,
    inverse,
    matrix_from_quaternion,
    multiply,
    rotation_vector_from_quaternion,
)
from spinfilters.errors import InputError
from spinfilters.sensors.sensor import MotionSamples

DEGREE = 4
"""Of the polynomial that a window of rotation vectors is fitted with; a steady spin is a straight line."""
LARGEST_TURN = 2.2
"""Rad from the middle of a window: well below pi, where rotation vectors stop being unique."""
LARGEST_WINDOW = 15


@dataclass(frozen=True)
class InitialMotion:
    """Motion at k times.

    Attributes
    ----------
    time: (k,) s.   attitude: (k, 4) q_ig.   rates: (k, 3) body rates, rad/s, g axes.
    positions: (k, 3) origins of g in i, m, or None when nothing measures them.
    defines_attitude: whether the first attitude is a definition of frame i rather than measured.
    """

    time: Float[np.ndarray, " k"]
    attitude: Float[np.ndarray, "k 4"]
    rates: Float[np.ndarray, "k 3"]
    positions: Float[np.ndarray, "k 3"] | None = None
    defines_attitude: bool = field(default=False, kw_only=True)

    @property
    def rotations(self) -> Float[np.ndarray, "k 3 3"]:
        """R_ig at every time."""
        return matrix_from_quaternion(self.attitude)


def initial_motion(samples: MotionSamples, epochs: int) -> InitialMotion:
    """Initial motion samples from the first ``epochs`` samples.

    Attitudes integrated from rates, or rates differenced from attitudes, as is missing.

    The rate at an attitude is the slope of a polynomial through the rotation vectors around it.

    Raises
    ------
    InputError: neither attitudes nor rates; without rates fewer than 4 attitudes, or a body that turns by more than half a
        revolution between two of them.
    """
    first = {name: getattr(samples, name) for name in ("attitude", "rates", "positions")}
    given = {name: None if values is None else values[:epochs] for name, values in first.items()}
    samples = consistent_samples(replace(samples, time=samples.time[:epochs], **given))
    time, positions = samples.time, samples.positions
    if samples.attitude is None and samples.rates is None:
        raise InputError(
            "a motion needs attitudes or body rates; give measurements of a sensor that tells them"
        )
    if samples.attitude is None:
        assert samples.rates is not None
        attitude = integrate_gyro(time, samples.rates, np.array([0.0, 0.0, 0.0, 1.0]))
        return InitialMotion(time, attitude, samples.rates, positions, defines_attitude=True)
    rates = _differenced(time, samples.attitude) if samples.rates is None else samples.rates
    return InitialMotion(time, samples.attitude, rates, positions)


def _differenced(time: Float[np.ndarray, " k"], q: Float[np.ndarray, "k 4"]) -> Float[np.ndarray, "k 3"]:
    """Body rates of attitudes."""
    if len(time) < 4:
        raise InputError(
            f"a start from poses needs at least 4 epochs, got {len(time)}; give a longer recording"
        )
    return _rates(time, q)


def _rates(time: Float[np.ndarray, " k"], q: Float[np.ndarray, "k 4"]) -> Float[np.ndarray, "k 3"]:
    """Slope at every pose of a polynomial through the rotation vectors to the poses around it."""
    half = LARGEST_WINDOW // 2
    around = np.arange(len(time))[:, None] + np.arange(-half, half + 1)
    inside = (around >= 0) & (around < len(time))
    around = np.clip(around, 0, len(time) - 1)
    phi = rotation_vector_from_quaternion(multiply(inverse(q)[:, None], q[around]))
    turn = np.linalg.norm(phi, axis=2)
    near = inside & (turn < LARGEST_TURN)
    reach = np.logical_and.accumulate
    used = np.concatenate([reach(near[:, half::-1], axis=1)[:, :0:-1], reach(near[:, half:], axis=1)], axis=1)
    count = np.count_nonzero(used, axis=1)
    if count.min() < 2:
        k = int(np.argmin(count))
        beside = turn[k, [half - 1, half + 1]][inside[k, [half - 1, half + 1]]]
        raise InputError(
            f"the body turns by {np.degrees(beside.min()):.0f} deg between epochs near t = {time[k]:.3f} s; "
            "more than about half a revolution per epoch cannot be told from its opposite: give a faster frame rate"
        )
    elapsed = np.where(used, time[around] - time[:, None], 0.0)
    scale = np.abs(elapsed).max(axis=1, keepdims=True)
    powers = (elapsed / scale)[..., None] ** np.arange(DEGREE + 1)
    told = used[..., None] & (np.arange(DEGREE + 1) < count[:, None, None])
    slope = np.linalg.pinv(np.where(told, powers, 0.0))[:, 1:2] @ phi
    return slope[:, 0] / scale


OUTLYING = 8.0
"""Times the median distance from the neighbours' line, beyond which a sample may be wrong."""
SMALLEST = 1e-3
"""Distance, of the largest value, below which no sample is wrong: exact samples have no median distance."""
MOST = 0.1
"""Share of the samples that may be wrong."""
AROUND = 3
"""Samples on either side of a suspect that its absence must put right."""


@dataclass(frozen=True)
class _SampleSequence:
    """Samples of one quantity; of unit quaternions both signs mean the same."""

    time: Float[np.ndarray, " n"]
    values: Float[np.ndarray, "n v"]
    has_signs: bool

    def distances(self, kept: Int[np.ndarray, " k"]) -> Float[np.ndarray, " d"]:
        """Distances of inner kept samples from the line through their kept neighbours."""
        time, values = self.time[kept], self.values[kept]
        before, here, after = values[:-2], values[1:-1], values[2:]
        if self.has_signs:
            before, after = (_aligned(each, here) for each in (before, after))
        share = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None]
        line = (1 - share) * before + share * after
        if self.has_signs:
            line /= np.maximum(np.linalg.norm(line, axis=1, keepdims=True), SMALLEST)
        return np.linalg.norm(here - line, axis=1)

    def wrong(self) -> Int[np.ndarray, " w"]:
        """Indices of the samples with gross errors."""
        kept, removed = np.arange(len(self.time)), []
        distances = self.distances(kept)
        allowed = max(OUTLYING * float(np.median(distances)), SMALLEST * float(np.abs(self.values).max()))
        doubted = set[int]()
        while len(removed) < MOST * len(self.time):
            suspects = [k for k in np.flatnonzero(distances > allowed) if int(kept[k + 1]) not in doubted]
            if not suspects:
                break
            worst = max(suspects, key=lambda k: distances[k]) + 1
            number = self._explaining(kept, int(worst), allowed)
            if number is None:
                doubted.add(int(kept[worst]))
                continue
            removed.append(int(kept[number]))
            kept = np.delete(kept, number)
            distances = self.distances(kept)
        return np.array(removed, dtype=int)

    def _explaining(self, kept: Int[np.ndarray, " k"], worst: int, allowed: float) -> int | None:
        """Index in ``kept`` of the sample that explains the largest distance.

        It is the worst or beside it: without it its surroundings lie on lines; None without one.
        """
        left = {}
        for place in (worst, worst - 1, worst + 1):
            first = max(place - AROUND, 0)
            near = np.delete(kept[first : place + AROUND + 1], place - first)
            left[place] = float(self.distances(near).max(initial=0.0))
        best = min(left, key=lambda place: left[place])
        return best if left[best] <= allowed else None


def consistent_samples(samples: MotionSamples) -> MotionSamples:
    """Samples without single gross errors of attitude, rate or position."""
    if len(samples.time) < 2 * AROUND:
        return samples
    given = {name: getattr(samples, name) for name in ("attitude", "rates", "positions")}
    wrong = [
        _SampleSequence(samples.time, values, values is samples.attitude).wrong()
        for values in given.values()
        if values is not None
    ]
    good = np.setdiff1d(np.arange(len(samples.time)), np.concatenate(wrong))
    kept = {name: None if values is None else values[good] for name, values in given.items()}
    return replace(samples, time=samples.time[good], **kept)


def _aligned(q: Float[np.ndarray, "n v"], to: Float[np.ndarray, "n v"]) -> Float[np.ndarray, "n v"]:
    """Quaternions of the sign that is nearer to others."""
    return q * np.where(np.sum(q * to, axis=1, keepdims=True) < 0, -1.0, 1.0)
