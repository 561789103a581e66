"""A data set and settings made ready for any estimator: process, timeline, initialisation.

Whether the state has a drag or a constant acceleration is decided by the evidence of the first epochs where settings leave it open.
No measurement is smoothed for the initialisation where a belief is given, as a user states it or drawn about the truth.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.chi_square import chi_square_tail
from spinfilters.core.errors import InputError
from spinfilters.core.working_time import working_seconds
from spinfilters.evaluation.consistency import true_states
from spinfilters.filters.timeline import build_timeline
from spinfilters.inference.first_epochs import (
    GivenInitialisation,
    Initialiser,
    NoisyModels,
    belief_beyond_tangent,
    with_identified_noise,
)
from spinfilters.inference.identified_noise import is_smallest
from spinfilters.inference.initial_estimate import DEFINED_ATTITUDE_STD, InitialEstimate
from spinfilters.inference.noise_choice import (
    considered_deviations,
    levels_of_rows,
    log_with_noise,
    stated_models,
    unstated_names,
    unstated_noise,
)
from spinfilters.inference.setup import NOTHING_SOUGHT, Setup, camera_view, layout_of, maps_landmarks
from spinfilters.io.dataset import Dataset
from spinfilters.io.sensor_tables import require_motion
from spinfilters.models.gauge import GAUGE_STD
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.models.state_blocks import ACCELERATION, ATTITUDE, CENTRE_OF_MASS, StateBlock
from spinfilters.models.state_layout import POSE_BLOCKS, Gaussian, StateLayout
from spinfilters.settings.run_settings import AUTO, LINEAR, QUADRATIC, InitialisationOptions, Settings
from spinfilters.settings.stated_belief import DRAWN_STD, WORDS, block_named, deviations_of, mean_by_block
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.verdict.model_errors.alternatives import CONSTANT_ACCELERATION
from spinfilters.verdict.model_tests import cost_of_first_epochs, tested_about

OTHER_STD = 1e-3
"""Deviation of a drawn block for which none is stated or usual."""


POSE_WORDS = tuple(word for word, name in WORDS.items() if name in POSE_BLOCKS)
"""Words of the blocks of a pose in the settings."""


def given_belief(dataset: Dataset, options: InitialisationOptions) -> GivenInitialisation | None:
    """The belief that the settings state for the first epoch of a data set; None where they state none.

    Raises
    ------
    InputError
        No truth to draw about; an error of the first pose where that defines frame g, because landmarks are not known.
    """
    if not options.states_belief:
        return None
    if maps_landmarks(dataset):
        options = _defining_g(options)
    if not options.from_truth:
        return lambda layout: stated_start(layout, options)
    truth = dataset.truth
    if truth is None:
        raise InputError(
            "a belief about the truth needs a truth, and this data set has none; state initialisation.mean"
        )
    first = float(dataset.log.times[0])
    row = int(np.argmin(np.abs(truth.time - first)))
    if truth.time[row] != first:
        raise InputError(
            f"the truth has no row at the first epoch, {first:g} s; give one, or state initialisation.mean"
        )

    def drawn(layout: StateLayout) -> InitialEstimate:
        """The drawn belief over a layout."""
        factor = _stated_factor(layout, options, DRAWN_STD)
        generator = np.random.default_rng(int(options.draw))
        return drawn_start(layout, true_states(truth, layout)[row], factor, generator)

    return drawn


def _defining_g(options: InitialisationOptions) -> InitialisationOptions:
    """The belief whose first pose defines frame g: no map does, and landmarks are placed by it.

    Raises
    ------
    InputError
        An error of that pose is stated.
    """
    stated = [word for word in POSE_WORDS if word in options.std]
    if stated or options.covariance:
        name = f"std states {stated[0]}" if stated else "covariance states the errors of the pose"
        raise InputError(
            f"initialisation.{name}, which has none where landmarks are not known: the first pose defines frame g; leave it out "
            "(give the others in initialisation.std), or give the landmarks' map (landmarks.csv, --known-map)"
        )
    return replace(options, std={**options.std, **dict.fromkeys(POSE_WORDS, GAUGE_STD)})


def stated_start(layout: StateLayout, options: InitialisationOptions) -> InitialEstimate:
    """An initialisation of one epoch from the mean and deviations of the settings.

    Blocks that are not stated begin at their origin with the deviation of their prior; pose and rate have to be stated, but
    for the attitude of a body of which only rates are measured: that defines frame i.

    Raises
    ------
    InputError
        A block of the state that must be stated and is not; one that the state does not have.
    """
    mean = layout.origin()
    points = mean_by_block(options.mean)
    for name in points:
        if name not in layout.blocks:
            raise InputError(
                f"initialisation.mean states {_word(name)}, which is not in the state of these measurements "
                f"({', '.join(map(_word, layout.blocks))}); leave it out"
            )
    for block in layout.members:
        if block.name in points:
            mean[layout.mean_slice(block.name)] = points[block.name]
        elif not block.prior_at_origin and not _defines_frame(layout, block):
            raise InputError(f"initialisation.mean does not state {_word(block.name)}; a belief needs it")
    usual = {block.name: options.prior_std(block) for block in layout.members if block.prior_at_origin}
    if ATTITUDE.name not in points and not layout.translates:
        usual[ATTITUDE.name] = DEFINED_ATTITUDE_STD
    return _start(layout, mean, _stated_factor(layout, options, usual))


def drawn_start(
    layout: StateLayout,
    true: Float[np.ndarray, " m"],
    factor: Float[np.ndarray, "n n"],
    generator: np.random.Generator,
) -> InitialEstimate:
    """An initialisation of one epoch whose error is drawn from its own covariance.

    The truth is ``mean [+] e`` with e ~ N(0, P); drawn as mean = true [+] (-e), which is the same to first order.
    """
    mean = layout.retract(true, factor @ generator.standard_normal(layout.error_dim))
    return _start(layout, mean, factor)


def _start(
    layout: StateLayout, mean: Float[np.ndarray, " m"], factor: Float[np.ndarray, "n n"]
) -> InitialEstimate:
    prior = FirstStatePrior.of_factor(mean, factor)
    return InitialEstimate(
        layout, prior, mean[np.newaxis], factor[np.newaxis], 0.0, 0, 0, 0, 0, converged=True
    )


def _stated_factor(
    layout: StateLayout, options: InitialisationOptions, usual: dict[str, float]
) -> Float[np.ndarray, "n n"]:
    """Square root of the stated covariance; ``usual`` are the deviations of blocks for which none is stated."""
    if options.covariance:
        matrix = np.array(options.covariance, dtype=np.float64)
        n = layout.error_dim
        order = ", ".join(f"{_word(block.name)} {block.dimension}" for block in layout.members)
        if matrix.shape != (n, n):
            raise InputError(
                f"initialisation.covariance is {matrix.shape[0]} x {matrix.shape[0]}; give {n} x {n}, of {order}"
            )
        if np.abs(matrix - matrix.T).max() > 1e-9 * np.abs(matrix).max():
            raise InputError("initialisation.covariance is not symmetric; give (P + P') / 2")
        try:
            return np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError:
            raise InputError(
                "initialisation.covariance is not positive definite; give every component a variance"
            ) from None
    stated = {block_named("std", name).name: value for name, value in options.std.items()}
    std = np.zeros(layout.error_dim)
    for block in layout.members:
        value = stated.get(block.name, usual.get(block.name))
        if value is None and not options.from_truth:
            raise InputError(
                f"initialisation.std does not state {_word(block.name)}; give its standard deviation, {block.unit}"
            )
        std[layout.slice(block.name)] = OTHER_STD if value is None else deviations_of(block, value)
    return np.diag(std)


def _defines_frame(layout: StateLayout, block: StateBlock) -> bool:
    """Whether the first epoch's value of a block defines a frame, as the attitude does where only rates are measured."""
    return block.name == ATTITUDE.name and not layout.translates


def _word(letter: str) -> str:
    """Word of a state block in settings."""
    return next((word for word, name in WORDS.items() if name == letter), letter)


def prepare(dataset: Dataset, settings: Settings, initial: GivenInitialisation | None = None) -> Setup:
    """Join a data set with models and smooth its first epochs.

    Parameters
    ----------
    dataset : Dataset
        Measurements, and what is stated of their sensors.
    settings : Settings
        Of the run; what they leave open the data set states, or the first epochs decide.
    initial : GivenInitialisation or None
        Gives the initialisation where the first epochs are not to be smoothed.

    Raises
    ------
    InputError
        Too few epochs, no rotation, tracks that no pose can be found from. The text names the data set.
    """
    begin = working_seconds()
    with dataset.naming():
        initial = initial or given_belief(dataset, settings.initialisation)
        if initial is not None:
            setup = first_setup(dataset, settings, initial)
        else:
            settings = with_likelier_drag(dataset, settings)
            setup = first_setup(dataset, settings)
            if settings.process.gravity == AUTO:
                setup = with_acceleration_if_identified(setup, settings)
            if not setup.initial.has_landmarks:
                belief = belief_beyond_tangent(setup.process, setup.timeline, setup.initial)
                setup = replace(setup, belief=belief)
    return replace(setup, initial_seconds=working_seconds() - begin)


def first_setup(dataset: Dataset, settings: Settings, initial: GivenInitialisation | None = None) -> Setup:
    """The setup of exactly these settings: no drag and no acceleration but those that they state.

    Parameters
    ----------
    dataset : Dataset
        Measurements, and what is stated of their sensors.
    settings : Settings
        Of the run; "auto" means a quadratic drag here, and no acceleration.
    initial : GivenInitialisation or None
        Gives the initialisation where the first epochs are not to be smoothed.

    Returns
    -------
    Setup
        What every estimator of the run shares.

    Raises
    ------
    InputError
        As `prepare`.
    """
    # Process, sensors and noise, as settings and data set state them.
    log = log_with_noise(dataset.log, settings)
    layout = layout_of(log, settings)
    stated = stated_models(dataset, log, layout, settings)
    # First epochs: given, or smoothed at the noise that they identify.
    view, sought, identified = camera_view(dataset), NOTHING_SOUGHT, ()
    if initial is not None:
        timeline = build_timeline(log, layout, stated.noise, view)
        require_motion(len(timeline))
        made = NoisyModels(stated.process, stated.noise, timeline, initial(layout))
    else:
        sought = unstated_noise(log, dataset, settings, stated.unknown)
        initialiser = Initialiser(replace(dataset, log=log), view, layout, settings.initialisation)
        made, identified = with_identified_noise(initialiser, stated.process, stated.noise, sought)
    # What every estimator begins from, and what is known of the noise and the calibration.
    start, known = made.start, dataset.known_map
    return Setup(
        *(dataset, log, made.process, made.timeline, made.noise, start),
        belief=start.joint_belief(settings.landmarks),
        map_points=start.points if start.has_landmarks else known and known.points,
        gyro_noise=stated.gyro_noise,
        identified=identified,
        unstated=unstated_names(dataset, settings),
        sought=sought,
        is_given=initial is not None,
        calibration=considered_deviations(dataset, settings, layout),
        inflation=levels_of_rows(log, dataset),
    )


ROUNDS_BESIDE: Final = 2
"""Initialisations at most from the noise of another setup."""


def setup_beside(setup: Setup, settings: Settings) -> Setup:
    """The setup with another model of the motion, from its noise and body, of a number of epochs that depends on neither.

    It is compared with others made so; estimators begin from a `first_setup`.

    Raises
    ------
    InputError
        As `prepare`.
    """
    layout = layout_of(setup.log, settings)
    process = TorqueFreeProcess(layout, setup.process.noise, settings.process.tolerance)
    dataset, view = replace(setup.dataset, log=setup.log), camera_view(setup.dataset)
    initialiser = Initialiser(dataset, view, layout, settings.initialisation, setup.initial)
    made, identified = with_identified_noise(initialiser, process, setup.noise, setup.sought, ROUNDS_BESIDE)
    return replace(
        setup,
        process=made.process,
        timeline=made.timeline,
        noise=made.noise,
        initial=made.start,
        belief=made.start.joint_belief(settings.landmarks),
        identified=identified,
    )


def _setup_or_none(setup: Setup, settings: Settings) -> Setup | None:
    """`setup_beside`; None where these settings fail, which the caller's own settings would report."""
    try:
        return setup_beside(setup, settings)
    except InputError:
        return None


LAWS: Final = (QUADRATIC, LINEAR)
"""Laws that are compared; the first is the plainer one where neither is likelier."""
LEAST_FALL: Final = 10.0
"""Of -2 ln evidence that a drag must bring to be identified."""


def with_likelier_drag(dataset: Dataset, settings: Settings) -> Settings:
    """The settings with the likeliest law in place of "auto", false where the first epochs identify no drag."""
    if settings.process.drag != AUTO:
        return settings
    try:
        first = first_setup(dataset, _with_drag(settings, QUADRATIC))
    except InputError:  # the setup without a drag says the same, or does without
        return replace(settings, process=replace(settings.process, drag=False))
    costs = {}
    for law in (False, *LAWS):
        setup = _setup_or_none(first, _with_drag(settings, law))
        costs[law] = np.inf if setup is None else cost_of_first_epochs(setup)
    best = min(LAWS, key=costs.__getitem__)
    is_identified = np.isfinite(costs[best]) and costs[best] < costs[False] - LEAST_FALL
    return replace(settings, process=replace(settings.process, drag=best if is_identified else False))


def _with_drag(settings: Settings, law: str | bool) -> Settings:
    """With a law, and with the acceleration that a sensor of places may need: that is decided later."""
    gravity = True if settings.process.gravity == AUTO else settings.process.gravity
    return replace(settings, process=replace(settings.process, drag=law, gravity=gravity))


LARGEST_CHANCE: Final = 1e-5
"""Probability of as large an acceleration by chance, below which it differs from zero."""
CENTRE_STDS: Final = (0.1, 0.03, 0.01)
"""Of the prior of the centre of mass that are compared with the default, m; without an acceleration the first alone.

The fits with each are made: they take gravity for disturbances, of which each prior leaves others."""
KNOWN_CENTRE: Final = 0.1
"""Standard deviation of the centre of mass over that of its default prior, below which the motion determines it."""
ALIKE: Final = 10.0
"""Of -2 ln likelihood, within which the data do not distinguish two priors: the smaller offset is the plainer explanation."""
CLEAR_FIT: Final = 1.5
"""Rms of whitened residuals of the first epochs above which a score about them says little: the acceleration is tried."""


@dataclass(frozen=True)
class AccelerationExplanation:
    """First epochs with a prior of the centre of mass, with or without an acceleration.

    Attributes
    ----------
    centre_std : float
        Of the prior, m.
    cost : float
        -2 ln evidence.
    accelerates : bool
        Whether an acceleration differs from zero.
    """

    centre_std: float
    cost: float
    accelerates: bool


def with_acceleration_if_identified(setup: Setup, settings: Settings) -> Setup:
    """The setup with a constant acceleration where its first epochs ask for one and distinguish it from zero.

    Parameters
    ----------
    setup : Setup
        The first one of these settings, without an acceleration.
    """
    if not setup.process.layout.translates:
        return setup
    centre_std = settings.initialisation.centre_std
    if centre_std != CENTRE_OF_MASS.prior_std or _determines_centre(setup.initial):
        if not _needs_acceleration(setup):
            return setup
        accelerated = first_setup(setup.dataset, _with_gravity(settings, True, centre_std))
        return accelerated if _accelerates(accelerated.initial.belief) else setup
    # An unknown offset of the centre of mass moves as an acceleration does: both are compared under several priors of it.
    explanations = explanations_with_acceleration(setup, settings)
    if not any(each.accelerates for each in explanations):  # then the fits without one need not be made
        return setup
    for std in (CENTRE_OF_MASS.prior_std, CENTRE_STDS[0]):
        without = _setup_or_none(setup, _with_gravity(settings, False, std))
        explanations.append(AccelerationExplanation(std, _cost(without), accelerates=False))
    least = min(each.cost for each in explanations)
    alike = [each for each in explanations if each.cost <= least + ALIKE]
    best = min(alike, key=lambda each: (not each.accelerates, each.centre_std))
    if not best.accelerates:
        return setup
    return first_setup(setup.dataset, _with_gravity(settings, True, best.centre_std))


def explanations_with_acceleration(setup: Setup, settings: Settings) -> list[AccelerationExplanation]:
    """Explanations of the first epochs with an acceleration, by every prior of the centre.

    All from the fit with the widest that leads anywhere: the noise that an offset leaves is that of the acceleration as well.
    """
    stds = (CENTRE_OF_MASS.prior_std, *CENTRE_STDS)
    for k, widest in enumerate(stds):
        accelerated = _setup_or_none(setup, _with_gravity(settings, True, widest))
        cost = _cost(accelerated)
        if accelerated is None or accelerated.initial.marginals is None or not np.isfinite(cost):
            continue
        start, found = accelerated.initial, []
        assert start.marginals is not None
        wide = Gaussian(start.layout, start.mean[-1], start.marginals.factors[-1])
        for std in stds[k:]:
            belief, more = with_narrower_prior(wide, start.prior, CENTRE_OF_MASS.name, std)
            found.append(AccelerationExplanation(std, cost + more, _accelerates(belief)))
        return found
    return []


def _with_gravity(settings: Settings, gravity: bool, centre_std: float) -> Settings:
    process = replace(settings.process, gravity=gravity)
    initialisation = replace(settings.initialisation, centre_std=centre_std)
    return replace(settings, process=process, initialisation=initialisation)


def _determines_centre(start: InitialEstimate) -> bool:
    """Whether the centre of mass is known from the motion, rather than from its prior."""
    factor = start.factor[-1, start.layout.slice(CENTRE_OF_MASS.name)]
    std = np.linalg.norm(factor, axis=1).max()
    return bool(std < KNOWN_CENTRE * CENTRE_OF_MASS.prior_std)


def _cost(setup: Setup | None) -> float:
    """-2 ln marginal likelihood of the first epochs; infinite where noise that is not stated is not identified from them.

    Levels are identified that differ from zero, or that are the least there are with every measurement accepted. Levels that are
    neither belong to epochs whose gates have refused everything.
    """
    if setup is None:
        return np.inf
    sensors = [each for each in setup.identified if not each.is_density]
    is_free_of_noise = bool(sensors) and all(map(is_smallest, sensors))
    differs = any(each.told for each in setup.identified)
    if setup.sought and not (differs or (is_free_of_noise and not setup.initial.rejected)):
        return np.inf
    return cost_of_first_epochs(setup)


def _needs_acceleration(setup: Setup) -> bool:
    """Whether epochs without an acceleration could not be smoothed, identify no noise, do not fit, or score for one."""
    start = setup.initial
    if setup.sought and not setup.identified:
        return True
    if not start.has_states:
        return True
    if not start.fit < CLEAR_FIT or start.rejected > start.accepted:
        return True
    return bool(tested_about(setup, start.mean, [CONSTANT_ACCELERATION], lambda motion: ()).named)


def _accelerates(belief: Gaussian) -> bool:
    """Whether the acceleration differs from zero by more than its covariance explains."""
    value = belief.mean[belief.layout.mean_slice(ACCELERATION.name)]
    factor = belief.factor[belief.layout.slice(ACCELERATION.name)]
    if not (np.isfinite(value).all() and np.isfinite(factor).all()):
        return False
    distance = value @ np.linalg.solve(factor @ factor.T, value)
    return bool(chi_square_tail(distance, len(value)) < LARGEST_CHANCE)


def with_narrower_prior(
    belief: Gaussian, prior: FirstStatePrior, block: str, std: float
) -> tuple[Gaussian, float]:
    """Belief given the same measurements under a narrower prior of a constant block, and the growth of -2 ln evidence.

    Parameters
    ----------
    belief : Gaussian
        Of the measurements and the wide prior.
    prior : FirstStatePrior
        Under which the belief was found.
    block : str
        Constant block whose errors add.
    std : float
        Of its new prior about the same mean, at most what it was.

    Raises
    ------
    InputError
        A wider prior.
    """
    layout = belief.layout
    part, wide = layout.slice(block), prior.std[layout.slice(block)]
    if not (0 < std <= wide.min() * (1 + 1e-12)):
        raise InputError(
            f"the prior of {block} is to have a deviation of {std:g}; give at most {wide.min():g}"
        )
    # information that the narrower prior adds to the block's three components
    more = 1 / std**2 - 1 / wide**2
    if not more.any():
        return belief, 0.0
    away = belief.mean[layout.mean_slice(block)] - prior.mean[layout.mean_slice(block)]
    # factor F' of the belief with it: F'F'^T = (P^-1 + E more E^T)^-1 with P = F F^T, by F' = F L^-T, L L^T = I + F_b^T more F_b
    own = belief.factor[part]
    root = np.linalg.cholesky(np.eye(layout.error_dim) + own.T @ (more[:, np.newaxis] * own))
    factor = np.linalg.solve(root, belief.factor.T).T
    # shift of the mean towards that of the prior, then what the exponent, the determinant and the prior's norm add to the evidence
    shift = factor @ (factor[part].T @ (more * away))
    grows = (more * away) @ (away - shift[part]) + 2 * float(np.log(np.diag(root)).sum())
    grows += 2 * float(np.log(std / wide).sum())
    return Gaussian(layout, layout.retract(belief.mean, -shift), factor), float(grows)
