"""Initial guess of a trajectory from motion samples.

Attitudes and rates as sampled, inertia from conserved angular momentum, a straight path.
"""

import numpy as np
from jaxtyping import Float

from spinfilters.dynamics.mass_distribution import from_inertia
from spinfilters.estimators.initialisation.initial_motion import InitialMotion
from spinfilters.estimators.initialisation.momentum_inertia import fit_momentum
from spinfilters.estimators.initialisation.options import InitialisationOptions
from spinfilters.estimators.smoothing.state_prior import FirstStatePrior
from spinfilters.estimators.timeline import Timeline
from spinfilters.models.gauge import GAUGE_STD
from spinfilters.state.blocks.acceleration import ACCELERATION
from spinfilters.state.blocks.drag import DRAG
from spinfilters.state.blocks.rigid_body import ATTITUDE, CENTRE_OF_MASS, MASS_DISTRIBUTION, RATE, VELOCITY
from spinfilters.state.layout import POSE_BLOCKS, StateLayout

MOMENTUM_BLOCKS = (CENTRE_OF_MASS, MASS_DISTRIBUTION, DRAG, VELOCITY)
"""What conserved momentum and a straight path tell beyond what was seen."""
MASS_SHARES = (1.0, 0.3, 0.0)
"""Shares of the closed form's departure from a sphere from which a fit is tried, in this order."""
DEFINED_ATTITUDE_STD = 1e-9
"""Of an attitude that defines a frame rather than being measured, rad."""


def initial_state(layout: StateLayout, evidence: InitialMotion) -> tuple[Float[np.ndarray, " m"], float]:
    """First state and its constancy from conserved angular momentum and a straight path."""
    fit = fit_momentum(evidence.rotations, evidence.rates, evidence.time, layout.has(DRAG))
    x = layout.origin()
    x[layout.mean_slice("a")] = evidence.attitude[0]
    x[layout.mean_slice("w")] = evidence.rates[0]
    x[layout.mean_slice("s")] = from_inertia(fit.inertia)
    if layout.has(DRAG):
        x[layout.mean_slice("d")] = fit.drag
    if evidence.positions is not None and layout.translates:
        x[layout.mean_slice("t")] = evidence.positions[0]
        path = fit_path(evidence, layout.has(ACCELERATION))
        for block, value in path.items():
            x[layout.mean_slice(block)] = value
    return x, fit.residual


def fit_path(evidence: InitialMotion, accelerated: bool) -> dict[str, Float[np.ndarray, " 3"]]:
    """Straight or parabolic path: c, v and f by linear least squares.

    t_k + R_k c = r_0 + v s_k + f s_k^2 / 2, s_k = t_k - t_0.
    A centre of mass that rotations do not tell apart from the path is the least one.
    """
    assert evidence.positions is not None
    elapsed, rotations = (evidence.time - evidence.time[0])[:, None, None], evidence.rotations
    eye = np.broadcast_to(np.eye(3), rotations.shape)
    columns = [rotations, -eye, -eye * elapsed, *([-eye * elapsed**2 / 2] if accelerated else [])]
    A = np.concatenate(columns, axis=2).reshape(-1, 3 * len(columns))
    solution = np.linalg.lstsq(A, -evidence.positions.reshape(-1), rcond=1e-9)[0].reshape(-1, 3)
    names = (CENTRE_OF_MASS.name, "", VELOCITY.name, ACCELERATION.name)
    return {name: value for name, value in zip(names, solution, strict=False) if name}


def guessed_trajectory(
    layout: StateLayout, epochs: Timeline, first: np.ndarray, evidence: InitialMotion
) -> Float[np.ndarray, "k m"]:
    """Guessed state per epoch: the nearest sample with the constants of the first state."""
    trajectory = np.tile(first, (len(epochs), 1))
    nearest = [int(np.argmin(np.abs(evidence.time - epoch.time))) for epoch in epochs]
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
