"""Rotation jumps at the ends of a flight.

Jumps between samples, and rates that the middle does not lead to. A touch changes the rate of a body at once, and a hand
as it lets go, which its place shows only later.
"""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

LARGEST_JUMP: Final = 10.0
"""Of the mean rate between two samples to the next, in root mean squares of those amid the flight."""
LARGEST_DEVIATION: Final = 2.5
"""Of a rate at an end from the parabola of those behind it, in standard deviations of that: four of a hundred by chance."""
SLOWEST_RELEASE: Final = 4
"""Rates at each end, at most, that a hand may have changed."""
FEWEST: Final = 8
REACH: Final = 0.5
"""Rates that a parabola is fitted to, and rad within which it stands for them."""
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
    attitude: R_ig at times in s.   margin: samples at each end; those between tell how much the rate changes in flight.
    """
    good, by = (
        np.ones(len(time), dtype=bool),
        Rotation.from_matrix(np.swapaxes(attitude[:-1], 1, 2) @ attitude[1:]),
    )
    rates = by.as_rotvec() / np.diff(time)[:, None]
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
    if margin < 1 or len(time) - 1 - 2 * margin < FEWEST:
        return good
    by = Rotation.from_matrix(np.swapaxes(attitude[:-1], 1, 2) @ attitude[1:])
    rates, middle = by.as_rotvec() / np.diff(time)[:, None], (time[1:] + time[:-1]) / 2
    good[: _departing(middle, rates, margin)] = False
    good[len(time) - _departing(-middle[::-1], rates[::-1], margin) :] = False
    return good


def _departing(time: Float[np.ndarray, " r"], rates: Float[np.ndarray, "r 3"], margin: int) -> int:
    """Number of leading rates, up to ``margin``, off the parabola of those behind."""
    angle = np.linalg.norm(np.median(rates[margin : len(rates) - margin], axis=0)) * np.abs(time - time[0])
    last = max(margin + FEWEST, int(np.searchsorted(angle, REACH)))
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
