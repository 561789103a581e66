"""A data set and settings made ready for any estimator: process, timeline, initialisation.

Whether the state has a drag or a constant acceleration is decided by the evidence of the first epochs where settings leave it open.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from spinfilters.core.chi_square import chi_square_tail
from spinfilters.core.errors import InputError
from spinfilters.core.working_time import working_seconds
from spinfilters.inference.first_epochs import BoundLog, GivenInitialisation
from spinfilters.inference.identified_noise import ROUNDS, smallest_level, with_identified_noise
from spinfilters.inference.initial_estimate import InitialEstimate
from spinfilters.inference.setup import NOTHING_SOUGHT, Setup, camera_view
from spinfilters.inference.stated_noise import (
    considered_deviations,
    layout_of,
    levels_of_rows,
    log_with_noise,
    models_beside,
    stated_models,
    unstated_names,
    unstated_noise,
)
from spinfilters.io.dataset import Dataset
from spinfilters.models.state_blocks import ACCELERATION, CENTRE_OF_MASS
from spinfilters.models.state_layout import Gaussian
from spinfilters.settings.run_settings import AUTO, LINEAR, QUADRATIC, Settings
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.verdict.model_errors.motion_alternatives import ConstantAcceleration
from spinfilters.verdict.model_tests import cost_of_first_epochs, tested_about


def with_narrower_prior(
    belief: Gaussian, prior: FirstStatePrior, block: str, std: float
) -> tuple[Gaussian, float]:
    """Belief given the same measurements, and what -2 ln evidence grows by.

    Parameters
    ----------
    prior: under which the belief was found.   block: constant block whose errors add.
    std: of its new prior about the same mean, at most what it was.

    Raises
    ------
    InputError: a wider prior.
    """
    layout = belief.layout
    part, wide = layout.slice(block), prior.std[layout.slice(block)]
    if not (0 < std <= wide.min() * (1 + 1e-12)):
        raise InputError(
            f"the prior of {block} is to have a deviation of {std:g}; give at most {wide.min():g}"
        )
    more = 1 / std**2 - 1 / wide**2
    if not more.any():
        return belief, 0.0
    away = belief.mean[layout.mean_slice(block)] - prior.mean[layout.mean_slice(block)]
    own = belief.factor[part]
    root = np.linalg.cholesky(np.eye(layout.error_dim) + own.T @ (more[:, np.newaxis] * own))
    factor = np.linalg.solve(root, belief.factor.T).T
    moved = factor @ (factor[part].T @ (more * away))
    grows = (more * away) @ (away - moved[part]) + 2 * float(np.log(np.diag(root)).sum())
    grows += 2 * float(np.log(std / wide).sum())
    return Gaussian(layout, layout.retract(belief.mean, -moved), factor), float(grows)


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


LAWS: Final = (QUADRATIC, LINEAR)
"""Laws that are compared; the first is the plainer one where neither is likelier."""
WORTH: Final = 10.0
"""Fall of -2 ln evidence that a drag must bring to be told from none."""


def with_likelier_drag(make: Make, settings: Settings) -> Settings:
    """The settings with the likeliest law in place of "auto", false where the first epochs tell no drag."""
    if settings.process.drag != AUTO:
        return settings
    first = _setup(make, _with_drag_law(settings, QUADRATIC), None)
    costs = {law: _cost_of_law(_setup(make, _with_drag_law(settings, law), first)) for law in (False, *LAWS)}
    best = min(LAWS, key=costs.__getitem__)
    told = np.isfinite(costs[best]) and costs[best] < costs[False] - WORTH
    return replace(settings, process=replace(settings.process, drag=best if told else False))


def _with_drag_law(settings: Settings, law: str | bool) -> Settings:
    """With a law, and with the acceleration that a sensor of places may need: it is decided later."""
    process = settings.process
    return replace(
        settings,
        process=replace(process, drag=law, gravity=True if process.gravity == AUTO else process.gravity),
    )


def _setup(make: Make, settings: Settings, beside: Setup | None) -> Setup | None:
    try:
        return make(settings, beside)
    except InputError:  # of which the caller's own setup tells
        return None


def _cost_of_law(setup: Setup | None) -> float:
    """-2 ln marginal likelihood of the first epochs, infinite without any."""
    return np.inf if setup is None else cost_of_first_epochs(setup)


BESIDE_ROUNDS = 2
"""Initialisations at most from the noise of another setup."""


def prepare(dataset: Dataset, settings: Settings, initial: GivenInitialisation | None = None) -> Setup:
    """Join a data set with models and smooth its first epochs.

    Parameters
    ----------
    initial: gives the initialisation where the first epochs are not to be smoothed.

    Raises
    ------
    InputError: too few epochs, no rotation, tracks that no pose can be found from. The text names the data set.
    """
    begin = working_seconds()

    def make(own: Settings, beside: Setup | None) -> Setup:
        """The setup with these settings, see `Make`."""
        return _setup_of(dataset, own, None, beside)

    with dataset.naming():
        if initial is None:
            settings = with_likelier_drag(make, settings)
        if initial is not None or settings.process.gravity != AUTO:
            setup = _setup_of(dataset, settings, initial)
        else:
            setup = with_acceleration_if_told(make, settings)
    return replace(setup, initial_seconds=working_seconds() - begin)


def _setup_of(
    dataset: Dataset, settings: Settings, initial: GivenInitialisation | None, beside: Setup | None = None
) -> Setup:
    """Beside another setup from its noise and body."""
    log = log_with_noise(dataset.log, settings)
    layout = layout_of(log, settings)
    if beside is None:
        stated, likely = stated_models(dataset, log, layout, settings), None
    else:
        stated, likely = models_beside(beside, layout, settings), beside.initial
    silent, view = NOTHING_SOUGHT, camera_view(dataset)
    binding = BoundLog(replace(dataset, log=log), view, layout, settings, initial, likely)
    if initial is not None:
        made, components = binding(stated.process, stated.noise, None), ()
    else:
        silent = unstated_noise(log, dataset, settings, stated.unknown) if beside is None else beside.sought
        rounds = ROUNDS if beside is None else BESIDE_ROUNDS
        made, components = with_identified_noise(binding, stated.process, stated.noise, silent, rounds)
    known = None if dataset.known_map is None else dataset.known_map.points
    return Setup(
        *(dataset, log, made.process, made.timeline, made.noise, made.start),
        belief=made.start.joint_belief(settings.landmarks),
        map_points=made.start.points if made.start.has_landmarks else known,
        gyro_noise=stated.gyro_noise,
        identified=components,
        unstated=unstated_names(dataset, settings),
        sought=silent,
        is_given=initial is not None,
        calibration=considered_deviations(dataset, settings, layout),
        inflation=levels_of_rows(log, dataset),
    )
