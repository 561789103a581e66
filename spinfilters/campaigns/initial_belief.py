"""Beliefs drawn around the truth: a filter's begin without an initialisation from data."""

import numpy as np
from jaxtyping import Float

from spinfilters.campaigns.factors import BeliefFactor
from spinfilters.data.dataset import Dataset
from spinfilters.errors import InputError
from spinfilters.estimators.initialisation.initial_estimate import InitialEstimate
from spinfilters.estimators.smoothing.state_prior import FirstStatePrior
from spinfilters.evaluation.consistency import true_states
from spinfilters.pipeline.setup import Setup, knows_frames, prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.state.layout import StateLayout


def prepared_with_drawn_belief(
    dataset: Dataset, settings: Settings, belief: BeliefFactor, generator: np.random.Generator
) -> Setup:
    """A data set made ready for filters that begin at its first epoch from a belief drawn around the truth.

    Raises
    ------
    InputError: a data set whose sensors do not tell the frames of the truth, as that of unknown landmarks.
    """
    if not knows_frames(dataset) or dataset.truth is None:
        raise InputError(
            "a drawn belief needs a sensor that tells the frames of the truth; give sensor.known_map = true, or "
            'initialisation = "data"'
        )
    truth = dataset.truth

    def initial(layout: StateLayout) -> InitialEstimate:
        return drawn_start(layout, true_states(truth, layout)[0], belief, generator)

    return prepare(dataset, settings, initial)


def drawn_start(
    layout: StateLayout, true: Float[np.ndarray, " m"], belief: BeliefFactor, generator: np.random.Generator
) -> InitialEstimate:
    """An initialisation of one epoch whose error is drawn from its own covariance.

    The truth is ``mean [+] e`` with e ~ N(0, P); drawn as mean = true [+] (-e), which is the same to first order.
    """
    std = np.zeros(layout.error_dim)
    for block in layout.blocks:
        std[layout.slice(block)] = belief.by_block.get(block, 1e-3)
    mean = layout.retract(true, std * generator.standard_normal(layout.error_dim))
    prior = FirstStatePrior(mean, std)
    factor = prior.factor[np.newaxis]
    return InitialEstimate(layout, prior, mean[np.newaxis], factor, 0.0, 0, 0, 0, 0, converged=True)
