"""Initial guess of a trajectory from motion samples, and its prior.

Attitudes and rates as sampled, constants in closed form (`spinfilters.estimators.smoothing.closed_form`).
"""

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.initialisation.options import InitialisationOptions
from spinfilters.estimators.smoothing.initial_motion import InitialMotion
from spinfilters.estimators.smoothing.state_prior import FirstStatePrior
from spinfilters.estimators.timeline import Timeline, times_of
from spinfilters.models.gauge import GAUGE_STD
from spinfilters.state.blocks.rigid_body import ATTITUDE, RATE
from spinfilters.state.layout import POSE_BLOCKS, StateLayout

DEFINED_ATTITUDE_STD = 1e-9
"""Of an attitude that defines a frame rather than being measured, rad."""


def guessed_trajectory(
    layout: StateLayout, epochs: Timeline, first: np.ndarray, evidence: InitialMotion
) -> Float[np.ndarray, "k m"]:
    """Guessed state per epoch: the nearest sample with the constants of the first state."""
    trajectory = np.tile(first, (len(epochs), 1))
    nearest = [int(np.argmin(np.abs(evidence.time - time))) for time in times_of(epochs)]
    trajectory[:, layout.mean_slice("a")] = evidence.attitude[nearest]
    trajectory[:, layout.mean_slice("w")] = evidence.rates[nearest]
    if evidence.positions is not None and layout.translates:
        trajectory[:, layout.mean_slice("t")] = evidence.positions[nearest]
    return trajectory


def wide_prior(
    layout: StateLayout, first: np.ndarray, options: InitialisationOptions, evidence: InitialMotion
) -> FirstStatePrior:
    """Wide prior of the first state at the measured pose and rate.

    Tight only where the first epoch defines a frame.
    """
    mean, std = first.copy(), np.zeros(layout.error_dim)
    for block in layout.members:
        std[layout.slice(block.name)] = options.prior_std(block)
        if block.prior_at_origin:
            mean[layout.mean_slice(block.name)] = block.origin
    std[layout.slice(RATE.name)] = max(float(np.linalg.norm(evidence.rates, axis=1).max()), 1e-3)
    if evidence.defines_attitude and not layout.translates:
        std[layout.slice(ATTITUDE.name)] = DEFINED_ATTITUDE_STD
    return FirstStatePrior(mean, std)


def defining_g(
    layout: StateLayout, prior: FirstStatePrior, first: Float[np.ndarray, " m"]
) -> FirstStatePrior:
    """Prior whose first pose defines frame g. It is held where the state has a pose."""
    mean, std = prior.mean.copy(), prior.std.copy()
    for block in POSE_BLOCKS:
        mean[layout.mean_slice(block)] = first[layout.mean_slice(block)]
        std[layout.slice(block)] = GAUGE_STD
    return FirstStatePrior(mean, std)
