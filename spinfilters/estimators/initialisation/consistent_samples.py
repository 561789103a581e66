"""Removal of single gross errors from motion samples before closed-form estimation.

A sample counts as wrong where it lies far from the line through its neighbours, and where without it they lie on one. A motion that
is fast for a few samples is left alone: without one of them the others lie no better.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from spinfilters.sensors.sensor import MotionSamples

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
