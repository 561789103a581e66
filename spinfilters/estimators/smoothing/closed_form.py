"""Motion of the first epochs in closed form: inertia from conserved angular momentum, a straight path.

R_k J w_k = h is linear in J and h.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import eigh, null_space

from spinfilters.dynamics.mass_distribution import from_inertia
from spinfilters.errors import InputError
from spinfilters.estimators.smoothing.initial_motion import InitialMotion
from spinfilters.state.block import StateBlock
from spinfilters.state.blocks.acceleration import ACCELERATION
from spinfilters.state.blocks.drag import DRAG
from spinfilters.state.blocks.linear_drag import LINEAR_DRAG
from spinfilters.state.blocks.rigid_body import CENTRE_OF_MASS, MASS_DISTRIBUTION, VELOCITY
from spinfilters.state.layout import StateLayout

MOMENTUM_BLOCKS = (CENTRE_OF_MASS, MASS_DISTRIBUTION, DRAG, LINEAR_DRAG, VELOCITY)
"""What conserved momentum and a straight path tell beyond what was seen."""
MASS_SHARES = (1.0, 0.3, 0.0)
"""Shares of the closed form's departure from a sphere from which a fit is tried, in this order."""


def initial_state(layout: StateLayout, evidence: InitialMotion) -> tuple[Float[np.ndarray, " m"], float]:
    """First state and its constancy from conserved angular momentum and a straight path."""
    braking = next((block for block in (DRAG, LINEAR_DRAG) if layout.has(block)), None)
    fit = fit_momentum(evidence.rotations, evidence.rates, evidence.time, braking)
    x = layout.origin()
    x[layout.mean_slice("a")] = evidence.attitude[0]
    x[layout.mean_slice("w")] = evidence.rates[0]
    x[layout.mean_slice("s")] = from_inertia(fit.inertia)
    if braking is not None:
        x[layout.mean_slice(braking.name)] = fit.drag
    if evidence.positions is not None and layout.translates:
        x[layout.mean_slice("t")] = evidence.positions[0]
        path = fit_path(evidence, layout.has(ACCELERATION))
        for block, value in path.items():
            x[layout.mean_slice(block)] = value
    return x, fit.residual


def path_rows(
    elapsed: Float[np.ndarray, " k"], rotations: Float[np.ndarray, "k 3 3"], accelerated: bool
) -> Float[np.ndarray, "k3 c"]:
    """Rows of -t_k by c, r_0, v and, where accelerated, f; see `fit_path`."""
    s, eye = elapsed[:, None, None], np.broadcast_to(np.eye(3), rotations.shape)
    columns = [rotations, -eye, -eye * s, *([-eye * s**2 / 2] if accelerated else [])]
    return np.concatenate(columns, axis=2).reshape(-1, 3 * len(columns))


def fit_path(evidence: InitialMotion, accelerated: bool) -> dict[str, Float[np.ndarray, " 3"]]:
    """Straight or parabolic path: c, v and f by linear least squares.

    t_k + R_k c = r_0 + v s_k + f s_k^2 / 2, s_k = t_k - t_0.
    A centre of mass that rotations do not tell apart from the path is the least one.
    """
    assert evidence.positions is not None
    A = path_rows(evidence.time - evidence.time[0], evidence.rotations, accelerated)
    solution = np.linalg.lstsq(A, -evidence.positions.reshape(-1), rcond=1e-9)[0].reshape(-1, 3)
    names = (CENTRE_OF_MASS.name, "", VELOCITY.name, ACCELERATION.name)
    return {name: value for name, value in zip(names, solution, strict=False) if name}


SMALLEST_SECOND_MOMENT = 2e-3
"""Floor of the second moments relative to the largest: a flat plate of 1 : 20 stays, noise cannot make a body impossible."""
LARGEST_DRAG = 0.2
"""Upper end of the drag coefficients tried, 1/rad: at this value |h| halves within half a revolution."""

SHAPE_STD = 0.3
"""Of the entries of J (trace 2) about the sphere: it only speaks where the motion says nothing of a direction of J."""
_TRACELESS = null_space(np.array([[1.0, 1.0, 1.0, 0.0, 0.0, 0.0]]))


@dataclass(frozen=True)
class MomentumFit:
    """Inertia J (3, 3) in g axes with trace 2, a rigid body.

    Drag in the unit of its block; and how far momentum was from constant (relative rms).
    """

    inertia: Float[np.ndarray, "3 3"]
    drag: float
    residual: float


def fit_momentum(
    rotations: Float[np.ndarray, "k 3 3"],
    rates: Float[np.ndarray, "k 3"],
    time: Float[np.ndarray, " k"],
    braking: StateBlock | None,
) -> MomentumFit:
    """Least-squares J up to scale from attitudes and body rates.

    R_ig and rad/s, g axes, at k >= 4 times (s).
    With drag, |h| decays with the angle turned, h_k = h_0 exp(-d angle_k), or if it is linear in the rate with time, h_k = h_0
    exp(-k t_k); the fit is linear for each d or k, which is found by a bounded search of one variable.

    Raises
    ------
    InputError: with fewer than 4 epochs, or a body that does not rotate.
    """
    if len(rates) < 4:
        raise InputError(
            f"a start from data needs at least 4 epochs with attitude and rate, got {len(rates)}"
        )
    speed = np.linalg.norm(rates, axis=1)
    if not speed.max() * (time[-1] - time[0]) > 1e-3:
        raise InputError(
            "the body does not rotate in the first epochs, so its inertia leaves no trace; choose a part where it does"
        )
    angle = np.concatenate([[0.0], np.cumsum(np.diff(time) * (speed[1:] + speed[:-1]) / 2)])
    drag, decay, largest = 0.0, angle, LARGEST_DRAG
    if braking is LINEAR_DRAG:
        decay, largest = time - time[0], LARGEST_DRAG * float(speed.max())
    if braking is not None:
        from scipy.optimize import minimize_scalar  # here alone: a tenth of a second of every command's start

        found: Any = minimize_scalar(
            lambda d: _smallest(rotations, rates, decay, d)[1], bounds=(0.0, largest), method="bounded"
        )
        drag = float(found.x)
    J, residual = _smallest(rotations, rates, decay, drag)
    return MomentumFit(_physical(J), drag, residual)


def _smallest(
    rotations: np.ndarray, rates: np.ndarray, decay: np.ndarray, drag: float
) -> tuple[np.ndarray, float]:
    """J with trace 2 whose momentum varies least, and the relative size of that variation.

    Noise in attitude and rate adds the same amount to the variation of every J of one Frobenius norm. It is the smallest
    generalised eigenvalue, and is taken off before J is solved for, so that noise does not bend J towards bodies that move little.
    """
    momentum = rotations @ _momentum_rows(rates) * np.exp(drag * decay)[:, None, None]
    variation = (momentum - momentum.mean(axis=0)).reshape(-1, 6)
    gram = variation.T @ variation
    norm = np.diag([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    noise = float(eigh(gram, norm, eigvals_only=True, subset_by_index=[0, 0])[0])
    sphere = np.array([2.0, 2.0, 2.0, 0.0, 0.0, 0.0]) / 3
    level = max(noise, np.finfo(float).eps * float(np.trace(gram))) / max(3 * len(rates) - 9, 1)
    A = _TRACELESS.T @ (gram - noise * norm) @ _TRACELESS + level / SHAPE_STD**2 * np.eye(5)
    j = sphere - _TRACELESS @ np.linalg.solve(A, _TRACELESS.T @ (gram - noise * norm) @ sphere)
    J = np.array([[j[0], j[3], j[4]], [j[3], j[1], j[5]], [j[4], j[5], j[2]]])
    size = np.linalg.norm(momentum.mean(axis=0) @ j) * np.sqrt(len(rates))
    return J, float(np.sqrt(max(j @ gram @ j, 0.0)) / max(size, np.finfo(float).tiny))


def _momentum_rows(w: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3 6"]:
    """Rows that take (Jxx, Jyy, Jzz, Jxy, Jxz, Jyz) to J w."""
    x, y, z = w.T
    o = np.zeros_like(x)
    return np.stack(
        [np.stack(row, -1) for row in ([x, o, o, y, z, o], [o, y, o, x, o, z], [o, o, z, o, x, y])], axis=1
    )


def _physical(J: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """The nearest J whose second moments are positive.

    S = tr(J)/2 I - J with its eigenvalues floored.
    """
    values, vectors = np.linalg.eigh(np.trace(J) / 2 * np.eye(3) - J)
    values = np.maximum(values, SMALLEST_SECOND_MOMENT * max(values[-1], np.finfo(float).tiny))
    S = (vectors * (values / values.sum())) @ vectors.T
    return np.eye(3) - S
