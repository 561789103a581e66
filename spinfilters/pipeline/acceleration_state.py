"""A constant acceleration in the state where the data tell it.

Gravity, say; the first epochs of a recording ask for it.
Over an arc of much less than a turn the centripetal acceleration of an offset centre of mass, w x (w x c), is nearly constant and
looks like gravity: with c known to 1 m a toss at 2.6 rad/s tells gravity to 3 m/s^2. How far origins of poses lie from centres of
mass is then a hyperparameter, chosen by marginal likelihood among `CENTRE_STDS` unless the settings state it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from spinfilters.errors import InputError
from spinfilters.estimators.initialisation.initial_estimate import InitialEstimate
from spinfilters.estimators.initialisation.prior_change import with_narrower_prior
from spinfilters.estimators.model_errors.alternatives.acceleration_alternative import ConstantAcceleration
from spinfilters.linear_algebra.chi_square import chi_square_tail
from spinfilters.pipeline.identified_noise import smallest_level
from spinfilters.pipeline.log_evidence import cost_of_first_epochs
from spinfilters.pipeline.model_errors import tested_about
from spinfilters.pipeline.setup import Setup
from spinfilters.settings.run_settings import Settings
from spinfilters.state.blocks.acceleration import ACCELERATION
from spinfilters.state.blocks.rigid_body import CENTRE_OF_MASS
from spinfilters.state.gaussian import Gaussian

TOLD: Final = 1e-5
"""Probability of as large an acceleration by chance, below which it is told from zero."""
CENTRE_STDS: Final = (0.1, 0.03, 0.01)
"""Of the prior of the centre of mass that are tried beside the default, m; without an acceleration the first alone.

Its fits are made: they take gravity for disturbances, of which each prior leaves others."""
KNOWN_CENTRE: Final = 0.1
"""Standard deviation of the centre of mass over that of its default prior, below which the motion tells it."""
ALIKE: Final = 10.0
"""Of -2 ln likelihood, within which the data do not tell two priors apart: the smaller offset is the plainer explanation."""
CLEAR_FIT: Final = 1.5
"""Rms of whitened residuals of the first epochs above which a score about them says little: the acceleration is tried."""
AT_FLOOR: Final = 1.01
"""Times the smallest level that can be identified, below which an identified one is that smallest level."""

Make = Callable[[Settings, "Setup | None"], Setup]
"""Makes the setup of a recording with these settings; beside another one from its noise and body, of a common number of epochs."""


@dataclass(frozen=True)
class _Explanation:
    """First epochs with a prior of the centre of mass, with or without an acceleration.

    Attributes
    ----------
    cost: -2 ln evidence.   told: whether an acceleration is told from zero.
    """

    centre_std: float
    cost: float
    told: bool


def with_acceleration_if_told(make: Make, settings: Settings) -> Setup:
    """The setup with a constant acceleration if the data tell one.

    The first epochs ask for it and tell it from zero.
    """
    without = make(settings, None)
    if not without.process.layout.translates:
        return without
    stated = settings.initialisation.centre_std != CENTRE_OF_MASS.prior_std
    if not stated and not _knows_centre(without.initial):
        likeliest = _likeliest(make, settings, without)
        return without if likeliest is None else make(likeliest, None)
    if not _asks(without):
        return without
    accelerated = make(_with(settings, gravity=True, centre_std=settings.initialisation.centre_std), None)
    return accelerated if _tells(accelerated.initial.belief) else without


def _likeliest(make: Make, settings: Settings, without: Setup) -> Settings | None:
    """Settings with an acceleration told from zero, if most likely.

    Where no prior of the centre lets the data tell one, the fit without is not made.
    """
    found = _accelerated(make, settings, without)
    if not any(each.told for each in found):
        return None
    for std in (CENTRE_OF_MASS.prior_std, CENTRE_STDS[0]):
        setup = _tried(make, _with(settings, gravity=False, centre_std=std), without)
        found.append(_Explanation(std, np.inf if setup is None else _cost(setup), told=False))
    least = min(each.cost for each in found)
    alike = [each for each in found if each.cost <= least + ALIKE]
    best = min(alike, key=lambda each: (not each.told, each.centre_std))
    return _with(settings, gravity=True, centre_std=best.centre_std) if best.told else None


def _accelerated(make: Make, settings: Settings, without: Setup) -> list[_Explanation]:
    """Explanations with an acceleration by every prior of the centre.

    All from the fit with the widest that leads anywhere: the noise that an offset leaves is that of the acceleration as well.
    """
    stds = (CENTRE_OF_MASS.prior_std, *CENTRE_STDS)
    for k, widest in enumerate(stds):
        setup = _tried(make, _with(settings, gravity=True, centre_std=widest), without)
        cost = np.inf if setup is None else _cost(setup)
        if setup is None or not np.isfinite(cost):
            continue
        start, found = setup.initial, []
        assert start.marginals is not None  # a finite cost has been solved
        wide = Gaussian(start.layout, start.mean[-1], start.marginals.factors[-1])
        for std in stds[k:]:
            belief, more = with_narrower_prior(wide, start.prior, CENTRE_OF_MASS.name, std)
            found.append(_Explanation(std, cost + more, _tells(belief)))
        return found
    return []


def _tried(make: Make, settings: Settings, without: Setup) -> "Setup | None":
    try:
        return make(settings, without)
    except InputError:  # of which the caller's own settings tell
        return None


def _with(settings: Settings, gravity: bool, centre_std: float) -> Settings:
    process = replace(settings.process, gravity=gravity)
    return replace(
        settings, process=process, initialisation=replace(settings.initialisation, centre_std=centre_std)
    )


def _knows_centre(start: InitialEstimate) -> bool:
    """Whether the centre of mass is known from the motion, rather than from its prior."""
    factor = start.factor[-1, start.layout.slice(CENTRE_OF_MASS.name)]
    std = np.linalg.norm(factor, axis=1).max()
    return bool(std < KNOWN_CENTRE * CENTRE_OF_MASS.prior_std)


def _cost(setup: Setup) -> float:
    """-2 ln marginal likelihood of the first epochs.

    Infinite where noise that nobody states is not identified from them.
    """
    return np.inf if setup.sought and not _identifies_noise(setup) else cost_of_first_epochs(setup)


def _identifies_noise(setup: Setup) -> bool:
    """Whether levels differ from zero, or are the least there are with every measurement accepted.

    Levels that do neither belong to epochs whose gates have refused everything.
    """
    sensors = [each for each in setup.identified if not each.is_density]
    is_free_of_noise = bool(sensors) and all(
        each.value < AT_FLOOR * smallest_level(each.name) for each in sensors
    )
    return any(each.told for each in setup.identified) or (is_free_of_noise and not setup.initial.rejected)


def _asks(setup: Setup) -> bool:
    """Whether epochs without an acceleration ask for it.

    They could not be smoothed, identify no noise, do not fit, or score for it.
    """
    start = setup.initial
    if setup.sought and not setup.identified:
        return True
    if start.has_failed or not np.isfinite(start.mean).all():
        return True
    if not start.fit < CLEAR_FIT or start.rejected > start.accepted:
        return True
    return bool(tested_about(setup, start.mean, [ConstantAcceleration()], lambda motion: ()).named)


def _tells(belief: Gaussian) -> bool:
    """Whether the acceleration differs from zero by more than its covariance explains."""
    value = belief.mean[belief.layout.mean_slice(ACCELERATION.name)]
    factor = belief.factor[belief.layout.slice(ACCELERATION.name)]
    if not (np.isfinite(value).all() and np.isfinite(factor).all()):
        return False
    return bool(chi_square_tail(value @ np.linalg.solve(factor @ factor.T, value), len(value)) < TOLD)
