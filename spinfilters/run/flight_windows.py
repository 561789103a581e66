"""Windows and stretches of a recording's samples, in which a body may fly freely."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

MOST: Final = 32
"""Samples of a window that are looked at."""
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


def window_samples(starts: Int[np.ndarray, " m"], ends: Int[np.ndarray, " m"]) -> Int[np.ndarray, "m k"]:
    """Samples of each window that are looked at, evenly spread."""
    count = min(MOST, int((ends - starts).max()))
    return np.rint(np.linspace(starts, ends - 1, count, axis=1)).astype(int)


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
