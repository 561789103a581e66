"""Jumps of a rotation between samples.

A touch changes the rate of a body at once, which its place shows only later.
"""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

LARGEST_JUMP: Final = 10.0
"""Of the mean rate between two samples to the next, in root mean squares of those amid the flight."""
TINY: Final = 1e-9
"""rad/s: what arithmetic leaves of a uniform rotation."""


def turns_on(
    time: Float[np.ndarray, " n"], attitude: Float[np.ndarray, "n 3 3"], margin: int
) -> Bool[np.ndarray, " n"]:
    """Which samples the rotation comes to without a jump.

    In the first and last ``margin``, of its rate.

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
