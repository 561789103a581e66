"""Posterior mean of a disturbance density, from its identified most probable value.

n squares tell a density theta beside other noise: their variance is 1 - q + q theta / theta_0, with q the share of the density in
it and theta_0 the most probable density under a prior that is flat in its standard deviation. With y = ln theta / theta_0,

    ln p(y) = -n/2 (ln w + s / w) + y / 2,   w = 1 - q + q e^y,   s = 1 - 1 / (n q),   information of the data n q^2 / 2.

Squares of the density alone (q = 1) are skewed upwards: its mean lies by 2 / n above. Where other noise is larger (q near 0)
likelihood and prior reach down to zero, and the mean lies below the most probable value. A covariance in proportion to the mean
is that of the errors, whatever the density is.
"""

from functools import lru_cache
from typing import Final

import numpy as np

PRIOR_INFORMATION: Final = 0.5
"""Of the logarithm of a level, by a prior that is flat in its standard deviation."""
LEAST_INFORMATION: Final = 1e-3
"""Of the data, below which they tell nothing at all."""
SMALLEST_VARIANCE: Final = 1e-9
DEVIATIONS: Final = np.linspace(-12.0, 5.0, 600)
"""Over which y is integrated, in its own standard deviations, of which none is taken for more than 1."""


@lru_cache(maxsize=1024)
def raised_logarithm(variance: float, share: float = 1.0) -> float:
    """Logarithm of a density's mean over the most probable one.

    Parameters
    ----------
    variance: of the density's logarithm, prior included.
    share: of the density in what tells it; at most the data's share of the information, so that s is positive.
    """
    variance = max(variance, SMALLEST_VARIANCE)
    information = max(1 / variance - PRIOR_INFORMATION, LEAST_INFORMATION)
    q = min(share, information / (information + PRIOR_INFORMATION))
    n = 2 * information / q**2
    y = min(variance, 1.0) ** 0.5 * DEVIATIONS
    w = 1 - q + q * np.exp(y)
    log_posterior = -n / 2 * (np.log(w) + (1 - 1 / (n * q)) / w) + y / 2
    weight = np.exp(log_posterior - log_posterior.max())
    return float(np.log(np.sum(weight * np.exp(y)) / np.sum(weight)))
