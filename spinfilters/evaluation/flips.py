"""Flips of a tumble (Dzhanibekov).

The rotation about the intermediate axis reverses, from one plateau to the next.
"""

from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.evaluation.body import BodyEstimate

PLATEAU: Final = 0.5**0.5
"""Share of the rate that is along the intermediate axis on a plateau: at 45 degrees from it a body turns about another axis."""
CLEAR: Final = 3.0
"""Standard deviations between two moments, below which it is open which axis is the intermediate one."""


def count_flips(rate: Float[np.ndarray, "n 3"], intermediate: int = 1) -> int:
    """Reversals of the rotation about the intermediate axis.

    From within 45 degrees of the axis to within 45 degrees of its opposite.
    A rate that only crosses zero, as in every nutation about another axis, is none, nor is a reversal that is not complete.

    Parameters
    ----------
    rate: along the principal axes, rad/s.
    """
    along, length = rate[:, intermediate], np.linalg.norm(rate, axis=1)
    plateau = np.sign(along[np.abs(along) > PLATEAU * length])
    return int(np.count_nonzero(np.diff(plateau)))


def knows_intermediate_axis(body: BodyEstimate) -> bool:
    """Whether the moments are distinct, so that axes are known.

    The axes of two equal moments are no axes, and no flip is about them.
    """
    moments, covariance = body.principal_moments, body.principal_moments_cov
    variance = np.diag(covariance)
    apart = variance[1:] + variance[:-1] - 2 * np.diag(covariance, 1)
    return bool(np.all(np.diff(moments) > CLEAR * np.sqrt(np.maximum(apart, 0.0))))
