"""The initialisation where a belief is given: as a user states it, or drawn about the truth. No measurement is smoothed for it."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.evaluation.consistency import true_states
from spinfilters.inference.first_epochs import GivenInitialisation
from spinfilters.inference.initial_estimate import InitialEstimate
from spinfilters.inference.initialisation import DEFINED_ATTITUDE_STD
from spinfilters.inference.setup import maps_landmarks
from spinfilters.io.dataset import Dataset
from spinfilters.models.gauge import GAUGE_STD
from spinfilters.models.state_blocks import ATTITUDE, StateBlock
from spinfilters.models.state_layout import POSE_BLOCKS, StateLayout
from spinfilters.settings.run_settings import InitialisationOptions
from spinfilters.settings.stated_belief import DRAWN_STD, WORDS, block_named, deviations_of, mean_by_block
from spinfilters.smoother.priors import FirstStatePrior

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
