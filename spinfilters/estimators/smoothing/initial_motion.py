"""Attitudes, body rates and positions measured directly in the first epochs.

Single gross errors are removed before closed-form estimation. A sample counts as wrong where it lies far from the line through
its neighbours, and where without it they lie on one. A motion that is fast for a few samples is left alone: without one of them
the others lie no better.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Int

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
MOST_APART = 0.34
"""Share of the attitudes that may be farther than `LARGEST_TURN` from both neighbours: wrong ones. More are a fast rotation."""


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

    The rate at an attitude is the slope of a polynomial through the rotation vectors around it. An attitude that is far from
    both of its neighbours, such as a pose from too few common landmarks, is left out.

    Raises
    ------
    InputError: neither attitudes nor rates; without rates fewer than 4 attitudes, or more than `MOST_APART` of them farther than
        `LARGEST_TURN` from their neighbours.
    """
    first = {name: getattr(samples, name) for name in ("attitude", "rates", "positions")}
    shared = None if samples.shared is None else samples.shared[:epochs]
    given = {name: None if values is None else values[:epochs] for name, values in first.items()}
    samples = consistent_samples(replace(samples, time=samples.time[:epochs], shared=shared, **given))
    time, positions = samples.time, samples.positions
    if samples.attitude is None and samples.rates is None:
        raise InputError(
            "a motion needs attitudes or body rates; give measurements of a sensor that tells them"
        )
    if samples.attitude is None:
        assert samples.rates is not None
        attitude = integrate_gyro(time, samples.rates, np.array([0.0, 0.0, 0.0, 1.0]))
        return InitialMotion(time, attitude, samples.rates, positions, defines_attitude=True)
    if samples.rates is not None:
        return InitialMotion(time, samples.attitude, samples.rates, positions)
    rates = _differenced(time, samples.attitude, samples.shared)
    near = ~np.isnan(rates[:, 0])
    positions = None if positions is None else positions[near]
    return InitialMotion(time[near], samples.attitude[near], rates[near], positions)


def _differenced(
    time: Float[np.ndarray, " k"], q: Float[np.ndarray, "k 4"], shared: Int[np.ndarray, " k"] | None
) -> Float[np.ndarray, "k 3"]:
    """Body rates of attitudes; NaN of one that is too far from both neighbours.

    Parameters
    ----------
    shared: landmarks in common with the epoch before, where the attitudes come from tracks.
    """
    if len(time) < 4:
        raise InputError(
            f"a start from poses needs at least 4 epochs, got {len(time)}; give a longer recording"
        )
    rates = _rates(time, q)
    apart = np.isnan(rates[:, 0])
    if np.count_nonzero(~apart) < 4 or np.count_nonzero(apart) > MOST_APART * len(time):
        raise InputError(_too_far_apart(time, q, apart, shared))
    return rates


def _too_far_apart(
    time: Float[np.ndarray, " k"],
    q: Float[np.ndarray, "k 4"],
    apart: Bool[np.ndarray, " k"],
    shared: Int[np.ndarray, " k"] | None,
) -> str:
    """Sentence on attitudes that are too far from their neighbours: why, and the cure."""
    step = np.linalg.norm(rotation_vector_from_quaternion(multiply(inverse(q[:-1]), q[1:])), axis=1)
    first = int(np.argmax(apart))
    beside = int(np.clip(first, 0, len(step) - 1))
    told = (
        f"{np.count_nonzero(apart)} of the first {len(time)} epochs are more than {np.degrees(LARGEST_TURN):.0f} deg from "
        f"their neighbours ({np.degrees(step[beside]):.0f} deg at t = {time[first]:.3f} s), too far to follow"
    )
    if shared is None:
        return f"{told}: give a faster frame rate, or check the attitudes"
    return (
        f"{told}. Images share {int(np.median(shared[1:]))} landmarks with the one before (median), so that poses may be wrong: "
        "give a faster frame rate, or more landmarks"
    )


def _rates(time: Float[np.ndarray, " k"], q: Float[np.ndarray, "k 4"]) -> Float[np.ndarray, "k 3"]:
    """Slope at every pose of a polynomial through the rotation vectors to the poses around it.

    NaN where both neighbours are farther than `LARGEST_TURN`.
    """
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
    elapsed = np.where(used, time[around] - time[:, None], 0.0)
    scale = np.maximum(np.abs(elapsed).max(axis=1, keepdims=True), np.finfo(float).tiny)
    powers = (elapsed / scale)[..., None] ** np.arange(DEGREE + 1)
    told = used[..., None] & (np.arange(DEGREE + 1) < count[:, None, None])
    slope = np.linalg.pinv(np.where(told, powers, 0.0))[:, 1:2] @ phi
    return np.where(count[:, None] < 2, np.nan, slope[:, 0] / scale)


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
    given["shared"] = samples.shared
    kept = {name: None if values is None else values[good] for name, values in given.items()}
    return replace(samples, time=samples.time[good], **kept)


def _aligned(q: Float[np.ndarray, "n v"], to: Float[np.ndarray, "n v"]) -> Float[np.ndarray, "n v"]:
    """Quaternions of the sign that is nearer to others."""
    return q * np.where(np.sum(q * to, axis=1, keepdims=True) < 0, -1.0, 1.0)
