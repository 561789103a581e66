"""Free flights in a gyro log: where some inertia tensor keeps the angular momentum."""

from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.flight.momentum import (
    ROTATION,
    RotationHistory,
    momentum_errors,
    rotation_history,
    window_ends,
)
from spinfilters.flight.stretches import (
    Stretch,
    covered,
    noise_level,
    pieces_between_gaps,
    runs_of,
    without_overlap,
)

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
