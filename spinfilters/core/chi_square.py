"""Probabilities of the chi-square and F distributions, apart from what every command loads: they need SciPy's special functions."""

import numpy as np
from scipy.special import chdtrc, fdtrc, gammaincinv

Numbers = np.ndarray | float


def chi_square_tail(value: Numbers, dof: Numbers) -> Numbers:
    """P(chi2_dof > value); 1 for negative values."""
    return chdtrc(dof, np.maximum(value, 0.0))


def chi_square_median(dof: Numbers) -> Numbers:
    """Median of the chi-square distribution with ``dof`` degrees of freedom."""
    return 2 * gammaincinv(0.5 * dof, 0.5)


def fisher_tail(value: float, first: float, second: float) -> float:
    """P(F > value) for Fisher's distribution with ``first`` and ``second`` degrees of freedom; 1 for negative values."""
    return float(fdtrc(first, second, max(value, 0.0)))
