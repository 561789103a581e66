"""A constant acceleration (gravity) in the state where the first epochs of a recording ask for it and tell it."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.stats import chi2

from spinfilters.estimators.initialisation.initial_estimate import InitialEstimate
from spinfilters.estimators.model_errors.alternatives.acceleration import ConstantAcceleration
from spinfilters.pipeline.model_errors import tested_about
from spinfilters.settings.run_settings import Settings
from spinfilters.state.blocks.acceleration import ACCELERATION

if TYPE_CHECKING:
    from spinfilters.pipeline.setup import Setup

TOLD: Final = 1e-5
"""Probability of as large an acceleration by chance, below which it is told from zero."""
CLEAR_FIT: Final = 1.5
"""Rms of whitened residuals of the first epochs above which a score about them says little: the acceleration is tried."""


def with_acceleration_if_told(make: "Callable[[Settings], Setup]", settings: Settings) -> "Setup":
    """The setup without a constant acceleration, or with one where the first epochs ask for it and tell it from zero."""
    without = make(settings)
    if not without.process.layout.translates or not _asks(without):
        return without
    accelerated = make(replace(settings, process=replace(settings.process, gravity=True)))
    return accelerated if _tells(accelerated.initial) else without


def _asks(setup: "Setup") -> bool:
    """Whether epochs without it could not be smoothed, identify no noise, do not fit, or score for it."""
    start = setup.initial
    if setup.sought and not setup.identified:
        return True
    if start.has_failed or not np.isfinite(start.mean).all():
        return True
    if not start.fit < CLEAR_FIT or start.rejected > start.accepted:
        return True
    return bool(tested_about(setup, start.mean, [ConstantAcceleration()]).named)


def _tells(start: InitialEstimate) -> bool:
    """Whether the acceleration differs from zero by more than its covariance explains."""
    value = start.mean[-1, start.layout.mean_slice(ACCELERATION.name)]
    factor = start.factor[-1, start.layout.slice(ACCELERATION.name)]
    if start.has_failed or not (np.isfinite(value).all() and np.isfinite(factor).all()):
        return False
    return bool(chi2.sf(value @ np.linalg.solve(factor @ factor.T, value), len(value)) < TOLD)
