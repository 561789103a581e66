"""Steps of a motion to first order in the errors of the state."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class LinearisedStep(NamedTuple):
    """A step of a motion to first order in its errors.

    Attributes
    ----------
    after: (m,) the point at its end.   transition: (n, n) of the multiplicative error, or (n, n + constants).
    noise_factor: (n, q) G of the noise covariance Q = G G'.
    """

    after: Float[np.ndarray, " m"]
    transition: Float[np.ndarray, "n c"]
    noise_factor: Float[np.ndarray, "n q"]


class LinearisedSteps(NamedTuple):
    """k steps to first order in their errors.

    e_there = defect + transition e_here + noise_factor n.

    Attributes
    ----------
    defect: (k, n) error that takes ``there`` to the end of the step from ``here``.
    transition: (k, n, n).   noise_factor: (k, n, q), of unit noise.
    """

    defect: Float[np.ndarray, "k n"]
    transition: Float[np.ndarray, "k n n"]
    noise_factor: Float[np.ndarray, "k n q"]
