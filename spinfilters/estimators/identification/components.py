"""Variance components of the whitened residuals.

Which part of them each noise level explains, and what is identified of it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from spinfilters.estimators.filters.density_mean import raised_logarithm

FORCE_PSD: Final = "force_psd"
TORQUE_PSD: Final = "torque_psd"
DISTURBANCES: Final = (FORCE_PSD, TORQUE_PSD)
"""Names of the densities of the process, as in the settings' table [process]."""
TOLD_LOG_STD: Final = 0.6
"""Standard deviation of ln variance above which the data only bound a component from above."""
BOUND_STD: Final = 2.0
"""Standard deviations of ln variance from the estimate to the upper bound that is stated of such a component."""


@dataclass(frozen=True)
class ComponentRows:
    """A noise level of sensors: the innovations that it is the standard deviation of.

    Attributes
    ----------
    name: of the noise option.   value: that the problem was stated with, in the option's unit.
    sensors: rows of the innovation, by the sensor's number in `Motion.sensors`.
    landmarks: whether observations of landmarks are scaled by it.
    smallest: level below which an identification does not go, in the option's unit; 0 for no bound.
    """

    name: str
    value: float
    sensors: Mapping[int, tuple[int, ...]] = field(default_factory=dict)
    landmarks: bool = False
    smallest: float = 0.0


@dataclass(frozen=True)
class VarianceComponent:
    """An identified noise level.

    Attributes
    ----------
    value: standard deviation of a sensor in the unit of its option, or density of a disturbance.
    log_std: standard deviation of ln variance (of a density, of its ln).
    share: of the level in the variance of what tells it, beside all other noise.
    """

    name: str
    value: float
    log_std: float
    share: float = 1.0

    @property
    def is_density(self) -> bool:
        """Whether it is the density of a disturbance."""
        return self.name in DISTURBANCES

    @property
    def told(self) -> bool:
        """Whether the data tell it from zero; if not, `upper` is what they say."""
        return self.log_std < TOLD_LOG_STD

    @property
    def expected(self) -> float:
        """Level to estimate with: of a density its mean."""
        if not self.is_density:
            return self.value
        return self.value * float(np.exp(raised_logarithm(self.log_std**2, self.share)))

    @property
    def upper(self) -> float:
        """Upper bound, in the unit of the value."""
        half = 1.0 if self.is_density else 0.5
        return self.value * float(np.exp(half * BOUND_STD * self.log_std))

    def scaled(self, log_variance: float, share: float) -> "VarianceComponent":
        """Of exp(log_variance) times the variance, with this share of the deviation."""
        half = 1.0 if self.is_density else 0.5
        value = self.value * float(np.exp(half * log_variance))
        return VarianceComponent(self.name, value, share * self.log_std, self.share)

    @property
    def std(self) -> float:
        """Standard deviation of the value, to first order."""
        half = 1.0 if self.is_density else 0.5
        return self.value * half * self.log_std
