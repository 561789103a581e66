"""Initial beliefs drawn around the truth instead of initialisation from data."""

import numpy as np
from jaxtyping import Float

from spinfilters.campaigns.recording_factors import BeliefFactor, SensorFactor
from spinfilters.data.dataset import Dataset
from spinfilters.data.sensor_format import dataset_kinds
from spinfilters.errors import InputError
from spinfilters.estimators.initialisation.initial_estimate import InitialEstimate
from spinfilters.estimators.smoothing.state_prior import FirstStatePrior
from spinfilters.evaluation.consistency import true_states
from spinfilters.pipeline.preparation import prepare
from spinfilters.pipeline.setup import Setup
from spinfilters.sensors.sensor_registry import sensor_of
from spinfilters.settings.run_settings import Settings
from spinfilters.state.layout import StateLayout


def prepared_with_drawn_belief(
    dataset: Dataset, settings: Settings, belief: BeliefFactor, generator: np.random.Generator
) -> Setup:
    """Prepared data set with an initial belief drawn around the truth.

    It is one of `require_frames`, for filters that begin at its first epoch.
    """
    truth = dataset.truth
    assert truth is not None  # what is simulated has one

    def initial(layout: StateLayout) -> InitialEstimate:
        """The drawn belief as an initialisation over a layout."""
        return drawn_start(layout, true_states(truth, layout)[0], belief, generator)

    return prepare(dataset, settings, initial)


def require_frames(sensor: SensorFactor) -> None:
    """Refuse sensors whose frames are not those of the truth.

    A belief is drawn in the frames of the truth, which unknown landmarks do not tell.
    """
    if not sensor.known_map and not sensor_of(dataset_kinds()[sensor.kind].name).tells_frames:
        raise InputError(
            "a drawn belief needs a sensor that tells the frames of the truth; give sensor.known_map = true, or "
            'initialisation = "data"'
        )


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
