"""Marginal standard deviations and errors by Table 6.4.

In the quantities of Tweddle (2013), and the errors that they should predict.
Attitude is that of the geometric frame and rotations are given about the principal axes x major, y intermediate, z minor. The
thesis' attitude is of the principal frame, whose uncertainty in g it prints again as that of the principal axes.
"""

from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import quaternion_from_matrix, rotation_vector_from_quaternion
from spinfilters.evaluation.consistency import true_states
from spinfilters.evaluation.estimated_motion import body_history, trajectory_of
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.truth import Truth
from spinfilters.models.body import BodyHistory

MAJOR_FIRST: Final = [2, 1, 0]
"""Order of principal axes: ours ascend."""
QUANTITIES: Final[tuple[tuple[str, str, float], ...]] = (
    ("position", "mm", 1e3),
    ("velocity", "mm/s", 1e3),
    ("attitude", "mrad", 1e3),
    ("angular velocity", "deg/s", 180 / np.pi),
    ("centre of mass", "mm", 1e3),
    ("principal axes", "mrad", 1e3),
    ("inertia ratio", "1e-3", 1e3),
)
"""Name, unit, and the unit's number in SI units."""
THESIS: Final = np.array(
    [
        [0.343, 0.287, 0.329],
        [0.509, 0.566, 0.457],
        [7.4, 6.3, 3.0],
        [0.228, 0.254, 0.296],
        [3.72, 4.34, 3.57],
        [7.4, 6.3, 3.0],
        [2.5, 1.9, np.nan],
    ]
)
"""Tweddle (2013), Table 6.4, in the units of `QUANTITIES`: after 115 frames, poses' means over them. Its author doubts them."""


def marginal_std(history: EstimateHistory) -> Float[np.ndarray, "7 3"]:
    """Root mean square over the frames after the first, which defines g; SI units."""
    layout, trajectory, bodies = history.layout, trajectory_of(history), body_history(history)
    axes = _axes(bodies)
    attitude, rate = axes @ history.factor[:, layout.slice("a")], axes @ history.factor[:, layout.slice("w")]
    principal = np.einsum("nii->ni", bodies.principal_axes_cov)[:, MAJOR_FIRST]
    assert bodies.center_of_mass_std is not None
    squares = (
        trajectory.std_position**2,
        trajectory.std_velocity**2,
        np.square(attitude).sum(axis=2),
        np.square(rate).sum(axis=2),
        bodies.center_of_mass_std**2,
        principal,
        _padded(bodies.log_ratios_std**2),
    )
    return np.sqrt([each[1:].mean(axis=0) for each in squares])


def actual_errors(history: EstimateHistory, truth: Truth) -> Float[np.ndarray, "7 3"]:
    """Mean squared errors over the frames after the first of what `marginal_std` gives; SI units.

    Parameters
    ----------
    truth: in the history's own g and at its stamps.
    """
    layout, trajectory, bodies = history.layout, trajectory_of(history), body_history(history)
    assert truth.principal_moments is not None
    axes, states = _axes(bodies), true_states(truth, layout)
    error = layout.local(history.mean, states)
    true = np.sort(truth.principal_moments)
    errors = (
        trajectory.position - truth.center_of_mass,
        trajectory.velocity - truth.velocity,
        np.einsum("nij,nj->ni", axes, error[:, layout.slice("a")]),
        np.einsum("nij,nj->ni", axes, error[:, layout.slice("w")]),
        error[:, layout.slice("c")],
        _axes_errors(bodies, truth)[:, MAJOR_FIRST],
        _padded(bodies.log_ratios - np.log(true[[2, 1]] / true[[1, 0]])),
    )
    return np.array([np.square(each[1:]).mean(axis=0) for each in errors])


def _axes(bodies: BodyHistory) -> Float[np.ndarray, "n 3 3"]:
    """Rows are the principal axes in g, the major one first."""
    return bodies.principal_axes_g[:, MAJOR_FIRST]


def _axes_errors(bodies: BodyHistory, truth: Truth) -> Float[np.ndarray, "n 3"]:
    """Rotation from true to estimated principal axes, about themselves in ascending order of their moments."""
    assert truth.principal_axes_g is not None
    assert truth.principal_moments is not None
    true = truth.principal_axes_g[np.argsort(truth.principal_moments)]
    signs = np.sign(np.einsum("nki,ki->nk", bodies.principal_axes_g, true))
    turn = true @ np.swapaxes(signs[..., np.newaxis] * bodies.principal_axes_g, 1, 2)
    return rotation_vector_from_quaternion(quaternion_from_matrix(turn))


def _padded(ratios: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    return np.pad(ratios, ((0, 0), (0, 1)), constant_values=np.nan)
