"""Probabilities of the chi-square and F distributions.

`scipy.stats` has them too, but its import takes as long as that of all else. SciPy's special functions are imported where they are
called: commands that refuse a recording need none of them.
"""

import numpy as np

Numbers = np.ndarray | float
MOST: float = 4e3
"""Value beyond which no probability is left in numbers."""


def chi_square_tail(value: Numbers, dof: Numbers) -> Numbers:
    """P(chi2_dof > value); 1 for negative values."""
    from scipy.special import chdtrc, erfc

    positive = np.maximum(value, 0.0)
    if np.ndim(dof) or dof != 3:
        return chdtrc(dof, positive)
    # in closed form for the rows of a measurement of three components, of which there are ten thousands
    half = np.minimum(positive, MOST) / 2
    return erfc(np.sqrt(half)) + np.sqrt(half / np.pi) * 2 * np.exp(-half)


def chi_square_median(dof: Numbers) -> Numbers:
    """Median of the chi-square distribution with ``dof`` degrees of freedom."""
    from scipy.special import gammaincinv

    return 2 * gammaincinv(0.5 * dof, 0.5)


def fisher_tail(value: float, first: float, second: float) -> float:
    """P(F > value) for Fisher's distribution with ``first`` and ``second`` degrees of freedom; 1 for negative values."""
    from scipy.special import fdtrc

    return float(fdtrc(first, second, max(value, 0.0)))
