"""Tails and medians of distributions of sums of squares.

As `scipy.stats` has them, whose import takes as long as that of all else.
"""

import numpy as np
from scipy.special import chdtrc, fdtrc, gammaincinv

Numbers = np.ndarray | float


def chi_square_tail(value: Numbers, dof: Numbers) -> Numbers:
    """P(chi2_dof > value); 1 of negative values."""
    return chdtrc(dof, np.maximum(value, 0.0))


def chi_square_median(dof: Numbers) -> Numbers:
    """Median of chi2_dof."""
    return 2 * gammaincinv(0.5 * dof, 0.5)


def fisher_tail(value: float, first: float, second: float) -> float:
    """P(F > value) of Fisher's distribution; 1 of negative values."""
    return float(fdtrc(first, second, max(value, 0.0)))
