"""A start from data: where the first frames say the body is, how it turns, and what its inertia is.

Attitudes and rates of the first frames give J up to scale in closed form (`momentum_start`); Gauss-Newton over the first state
then fits those frames' own measurements through the process model. No guess of the mass distribution enters but a wide prior.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.dynamics.mass_distribution import from_inertia
from spinfilters.errors import InputError
from spinfilters.estimators.estimator import ProcessModel
from spinfilters.estimators.first_state import FirstState, FirstStatePrior, fit_first_state
from spinfilters.estimators.momentum_start import fit_momentum
from spinfilters.estimators.motion_evidence import MotionEvidence
from spinfilters.estimators.timeline import Timeline
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import StateLayout

MASS_SHARES = (1.0, 0.3, 0.0)
"""Shares of the closed form's departure from a sphere from which the fit is tried, in this order."""
SETTLED_FIT = 1.5
"""Rms of the whitened residuals below which a converged fit is believed without trying others."""
GAUGE_STD = 1e-9
"""Of an attitude or position that defines a frame rather than being measured, rad and m."""


@dataclass(frozen=True)
class StartOptions:
    """How a start is made.

    Attributes
    ----------
    frames: how many frames it looks at, at most.
    duration: how many seconds it looks at, at most.
    iterations: Gauss-Newton steps, at most.
    inflation: factor on the standard deviations handed to the filter. The first frames are used twice, to find where to
        linearise and then as measurements; with 5 the second use counts them at most 4 % too much.
    mass_std: of the prior of the mass distribution about the sphere (log lengths: 1 admits plates of 1 : 20 at two sigma).
    centre_std: of the prior of the centre of mass about the origin of g, m.   speed_std: of its velocity, m/s.
    drag_std: of the prior of the drag coefficient, 1/rad.
    """

    frames: int = 60
    duration: float = 30.0
    iterations: int = 30
    inflation: float = 5.0
    mass_std: float = 1.0
    centre_std: float = 1.0
    speed_std: float = 1.0
    drag_std: float = 0.05

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"start.{name} is {value}; it must be positive")


@dataclass(frozen=True)
class StartReport:
    """The belief at the first frame, and how it was reached.

    ``fit`` is the rms of the whitened residuals of the frames looked at: 1 when noise and model are right.
    """

    belief: Gaussian
    converged: bool
    iterations: int
    fit: float
    momentum_residual: float


def start_from_data(
    process: ProcessModel, timeline: Timeline, evidence: MotionEvidence, options: StartOptions
) -> StartReport:
    """Belief at the first frame of a timeline, for any estimator over ``process.layout``.

    Raises
    ------
    InputError: when the evidence has fewer than 4 frames or the body does not rotate.
    """
    layout = process.layout
    first, momentum_residual = closed_form(layout, evidence)
    prior = _prior(layout, first, options, evidence)
    found = _best_fit(process, _first_frames(timeline, options), first, prior, options)
    fit = float(np.sqrt(found.cost / max(found.dof, 1)))
    widened = found.information / (options.inflation * max(fit, 1.0)) ** 2 + np.diag(prior.std**-2)
    belief = _belief(layout, found.mean, widened)
    return StartReport(belief, found.converged, found.iterations, fit, momentum_residual)


def closed_form(layout: StateLayout, evidence: MotionEvidence) -> tuple[Float[np.ndarray, " m"], float]:
    """First state from conserved momentum (and a straight path of the centre of mass), and how constant momentum was."""
    fit = fit_momentum(evidence.rotations, evidence.rates, evidence.time, "d" in layout.blocks)
    x = layout.origin()
    x[layout.mean_slice("a")] = evidence.attitude[0]
    x[layout.mean_slice("w")] = evidence.rates[0]
    x[layout.mean_slice("s")] = from_inertia(fit.inertia)
    if "d" in layout.blocks:
        x[layout.mean_slice("d")] = fit.drag
    if evidence.positions is not None and "t" in layout.blocks:
        c, v = _straight_centre(evidence)
        x[layout.mean_slice("t")] = evidence.positions[0]
        x[layout.mean_slice("c")], x[layout.mean_slice("v")] = c, v
    return x, fit.residual


def _straight_centre(evidence: MotionEvidence) -> tuple[np.ndarray, np.ndarray]:
    """(c, v) by linear least squares of t_k + R_k c = r_0 + v (t_k - t_0)."""
    assert evidence.positions is not None
    elapsed = evidence.time - evidence.time[0]
    rotations = evidence.rotations
    eye = np.broadcast_to(np.eye(3), rotations.shape)
    A = np.concatenate([rotations, -eye, -eye * elapsed[:, None, None]], axis=2).reshape(-1, 9)
    solution = np.linalg.lstsq(A, -evidence.positions.reshape(-1), rcond=1e-9)[0]
    return solution[:3], solution[6:]


def _prior(layout: StateLayout, first: np.ndarray, options: StartOptions, evidence: MotionEvidence) -> FirstStatePrior:
    """Wide prior: spheres, at the pose and rate that were seen; tight only where the first frame defines a frame."""
    mean, std = first.copy(), np.zeros(layout.error_dim)
    speed = float(np.linalg.norm(evidence.rates, axis=1).max())
    widths = {
        "t": 1.0,
        "a": 1.0 if "t" in layout.blocks else GAUGE_STD,
        "v": options.speed_std,
        "w": max(speed, 1e-3),
        "c": options.centre_std,
        "s": options.mass_std,
        "d": options.drag_std,
    }
    for block in layout.blocks:
        std[layout.slice(block)] = widths[block]
        if block in {"v", "c", "s", "d"}:
            mean[layout.mean_slice(block)] = 0.0
    return FirstStatePrior(mean, std)


def _best_fit(
    process: ProcessModel, frames: Timeline, first: np.ndarray, prior: FirstStatePrior, options: StartOptions
) -> FirstState:
    """The fit from the closed form; where that does not settle, also from bodies nearer to a sphere, and the likeliest is kept."""
    tries: list[FirstState] = []
    for share in MASS_SHARES:
        x = first.copy()
        x[process.layout.mean_slice("s")] *= share
        tries.append(fit_first_state(process, frames, x, prior, options.iterations))
        if tries[-1].converged and tries[-1].cost < SETTLED_FIT**2 * tries[-1].dof:
            break
    return min(tries, key=lambda found: found.total)


def _first_frames(timeline: Timeline, options: StartOptions) -> Timeline:
    end = timeline[0].time + options.duration
    return tuple(frame for frame in timeline[: options.frames] if frame.time <= end)


def _belief(layout: StateLayout, x: np.ndarray, information: np.ndarray) -> Gaussian:
    scale = np.sqrt(np.diag(information))
    root = np.linalg.cholesky(information / np.outer(scale, scale))
    factor = np.linalg.inv(root).T / scale[:, None]
    return Gaussian(layout, x, factor)
