"""An iterated smoother over the first frames: the start-up transient is where a filter's single linearisation fails.

About a trial trajectory x_0 .. x_K the errors obey a linear model, e_k+1 = Phi e_k + b_k + noise with the defect b_k by which the
trajectory misses its own dynamics. A square-root filter forwards and a Rauch-Tung-Striebel pass backwards solve it exactly, the
trajectory moves by the result, and so on until it stops (Bell 1994: this is Gauss-Newton on the most probable trajectory). It
starts from attitudes and rates that were seen at every frame, not from one propagated guess.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular

from spinfilters.estimators.estimator import ProcessModel
from spinfilters.estimators.gain import apply_gain, triangular_factor
from spinfilters.estimators.linear_prediction import linear_prediction
from spinfilters.estimators.timeline import Timeline
from spinfilters.state.layout import StateLayout

SETTLED = 0.05
"""Largest step, in standard deviations of its own component, of a trajectory that has settled."""
SMALLEST_SHARE = 0.1
"""Of a step that is taken when steps do not get shorter."""
LARGEST_MASS_STEP = 1.0
"""Of the mass distribution in one iteration (log second moments): beyond it the linear model says nothing."""


@dataclass(frozen=True)
class FirstStatePrior:
    """Mean (point of the layout) and standard deviations of the independent prior of the first state."""

    mean: Float[np.ndarray, " m"]
    std: Float[np.ndarray, " n"]

    @property
    def factor(self) -> Float[np.ndarray, "n n"]:
        """Square root of the covariance."""
        return np.diag(self.std)


@dataclass(frozen=True)
class SmoothedFrames:
    """The most probable trajectory of the first k frames, each with its covariance given all of them.

    Attributes
    ----------
    mean: (k, m).   factor: (k, n, n), covariance factor factor'.
    cost: sum of normalised innovations squared about it.   dof: number of scalar measurements.
    """

    mean: Float[np.ndarray, "k m"]
    factor: Float[np.ndarray, "k n n"]
    cost: float
    dof: int
    iterations: int
    converged: bool


@dataclass(frozen=True)
class _Forward:
    """One frame of the forward pass: filtered error and factor, and the step that leads on from it."""

    error: np.ndarray
    factor: np.ndarray
    transition: np.ndarray
    noise: np.ndarray
    predicted_error: np.ndarray
    predicted_factor: np.ndarray


def smooth_first_frames(
    process: ProcessModel,
    frames: Timeline,
    trajectory: Float[np.ndarray, "k m"],
    prior: FirstStatePrior,
    iterations: int,
) -> SmoothedFrames:
    """Iterate from a trial trajectory (one point per frame) to the most probable one.

    A step that is not clearly shorter than the one before it is halved: the linear models of successive trials disagree.
    """
    layout, used, length, share = process.layout, 0, np.inf, 1.0
    errors, factors, cost, dof = _smooth(process, frames, trajectory, prior)
    while used < iterations and np.isfinite(errors).all():
        used += 1
        std = np.sqrt(np.einsum("kij,kij->ki", factors, factors))
        before, length = length, float((np.abs(errors) / std).max())
        share = max(share / 2, SMALLEST_SHARE) if length > 0.7 * before else min(1.0, 2 * share)
        trajectory = layout.retract(trajectory, _limited(layout, share * errors))
        if length <= SETTLED:
            break
        errors, factors, cost, dof = _smooth(process, frames, trajectory, prior)
    return SmoothedFrames(trajectory, factors, cost, dof, used, length <= SETTLED)


def _limited(layout: StateLayout, errors: Float[np.ndarray, "k n"]) -> Float[np.ndarray, "k n"]:
    if "s" in layout.blocks:
        mass = layout.slice("s")
        errors[:, mass] = np.clip(errors[:, mass], -LARGEST_MASS_STEP, LARGEST_MASS_STEP)
    return errors


def _smooth(
    process: ProcessModel, frames: Timeline, trajectory: np.ndarray, prior: FirstStatePrior
) -> tuple[np.ndarray, np.ndarray, float, int]:
    """Errors and covariance factors about the trajectory given all frames, cost and number of scalar measurements."""
    layout = process.layout
    error, factor = layout.local(trajectory[0], prior.mean), np.diag(prior.std)
    passed: list[_Forward] = []
    cost, dof = 0.0, 0
    for k, frame in enumerate(frames):
        for measurement in frame.measurements:
            prediction, _ = linear_prediction(measurement, trajectory[k], factor, error)
            correction = apply_gain(prediction)
            error, factor = error + correction.error, correction.factor
            cost, dof = cost + correction.nis, dof + prediction.dof
        if k + 1 < len(frames):
            passed.append(
                _predict(process, trajectory[k : k + 2], frames[k + 1].time - frame.time, error, factor)
            )
            error, factor = passed[-1].predicted_error, passed[-1].predicted_factor
    return *_backward(passed, error, factor), cost, dof


def _predict(
    process: ProcessModel, pair: np.ndarray, dt: float, error: np.ndarray, factor: np.ndarray
) -> _Forward:
    layout = process.layout
    moved, transition, noise = process.linearise(pair[0], dt)
    defect = layout.local(pair[1], moved)
    turn = np.linalg.inv(layout.reset_jacobian(defect))
    transition, noise = turn @ transition, turn @ noise
    ahead = triangular_factor(np.concatenate([(transition @ factor).T, noise.T]))
    return _Forward(error, factor, transition, noise, transition @ error + defect, ahead)


def _backward(passed: list[_Forward], error: np.ndarray, factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rauch-Tung-Striebel pass, its covariance in a form that cannot become indefinite."""
    errors, factors = [error], [factor]
    for step in reversed(passed):
        cross = step.transition @ step.factor @ step.factor.T
        root = step.predicted_factor
        half = solve_triangular(root, cross, lower=True, check_finite=False)
        gain = solve_triangular(root, half, lower=True, trans=1, check_finite=False).T
        error = step.error + gain @ (error - step.predicted_error)
        rest = step.factor - gain @ (step.transition @ step.factor)
        factor = triangular_factor(np.concatenate([rest.T, (gain @ step.noise).T, (gain @ factor).T]))
        errors.append(error)
        factors.append(factor)
    return np.array(errors[::-1]), np.array(factors[::-1])
