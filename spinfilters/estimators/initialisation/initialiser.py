"""Initialisation by smoothing the first epochs, for any sensors.

What sensors contribute (`MotionSamples`) says where to begin and is then forgotten; what is kept comes from the observations
themselves, each once, so the covariance holds what epochs share (a map that is a little wrong is wrong in every epoch). Where
landmarks are unknowns, frame g is defined by the pose at the first epoch.
"""

from dataclasses import dataclass, replace
from itertools import product
from typing import Protocol

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import ProcessModel
from spinfilters.estimators.initialisation.initial_estimate import InitialEstimate
from spinfilters.estimators.initialisation.initial_guess import (
    MASS_SHARES,
    defining_g,
    guessed_trajectory,
    initial_state,
    wide_prior,
)
from spinfilters.estimators.initialisation.initial_motion import initial_motion
from spinfilters.estimators.initialisation.options import InitialisationOptions
from spinfilters.estimators.robust.losses import LeastSquares
from spinfilters.estimators.smoothing.factors.landmark_observations import NOTHING_TWICE, OBSERVATIONS_NEEDED
from spinfilters.estimators.smoothing.linear.marginals import Marginals
from spinfilters.estimators.smoothing.problem.least_squares import (
    InitialGuess,
    Problem,
    problem_of,
    with_common_constants,
)
from spinfilters.estimators.smoothing.solver.annealing import GATE, AnnealedSchedule
from spinfilters.estimators.smoothing.solver.batch_smoother import NO_LANDMARKS, NO_POINTS
from spinfilters.estimators.smoothing.solver.iterations import Solved, SolverOptions, solve
from spinfilters.estimators.smoothing.state_prior import FirstStatePrior
from spinfilters.estimators.timeline import Timeline
from spinfilters.sensors.sensor import MotionSamples
from spinfilters.state.blocks.rigid_body import MASS_DISTRIBUTION

SETTLED_FIT = 1.5
"""Rms of the whitened residuals below which a converged fit is believed without trying others."""
CLEAR_MASS_STD = 0.3
"""Of the mass distribution (log second moments) below which a fit is believed without trying others: on simulated poses all fits
with a second optimum were beyond 0.7, and all optima that were alone below 0.5."""


class InitialisableProcess(ProcessModel, Protocol):
    """Process model that refuses motions too fast to integrate."""

    def require_steps(self, time: Float[np.ndarray, " k"], rates: Float[np.ndarray, "k 3"]) -> None:
        """Require few enough substeps of these rates (rad/s). InputError: too many."""
        ...


@dataclass(frozen=True)
class SmoothingOptions:
    """Options of the smoothing of the first epochs.

    Attributes
    ----------
    iterations: at most; 0 linearises at the guess and takes no step.
    gate: whitened length of an innovation of three components beyond which an observation counts as wrong.
    annealed: iterations in which the process noise may be inflated and the gate wide, at most.
    """

    iterations: int = 40
    gate: float = GATE
    annealed: int = 40

    def __post_init__(self) -> None:
        if self.iterations < 0 or not self.gate > 0:
            raise InputError(
                f"iterations is {self.iterations}, gate {self.gate}; give at least 0 and more than 0"
            )


def initialise(
    process: InitialisableProcess, timeline: Timeline, samples: MotionSamples, options: InitialisationOptions
) -> InitialEstimate:
    """Smooth the first epochs of a timeline, for any estimator over ``process.layout`` to continue from.

    Parameters
    ----------
    samples: motion at (at least some of) those epochs, and the first guess of a map where landmarks are unknowns.

    Raises
    ------
    InputError: fewer than 4 samples, a body that does not rotate, landmarks of which none is observed twice.
    """
    epochs = timeline[: options.count(timeline)]
    evidence = initial_motion(samples, len(epochs))
    process.require_steps(evidence.time, evidence.rates)
    first, momentum_residual = initial_state(process.layout, evidence)
    trajectory = guessed_trajectory(process.layout, epochs, first, evidence)
    prior = wide_prior(process.layout, first, options, evidence)
    guess = InitialGuess(trajectory, NO_LANDMARKS, NO_POINTS)
    if samples.landmarks is not None:
        prior = defining_g(process.layout, prior, trajectory[0])
        guess = InitialGuess(trajectory, samples.landmarks.ids, samples.landmarks.points)
    found = _likeliest(process, epochs, guess, prior, SmoothingOptions(options.iterations))
    status = found.status
    if not found.converged:
        status = status.degraded(f"the start did not settle in {found.iterations} iterations")
    return replace(
        found,
        momentum_residual=momentum_residual,
        noise_ratio=samples.noise_ratio,
        status=status,
        guess=guess,
    )


def initialised_again(
    process: ProcessModel, timeline: Timeline, before: InitialEstimate, options: InitialisationOptions
) -> InitialEstimate | None:
    """Smooth the first epochs again at other noise levels, from their earlier estimate.

    Motion, map and associations are those of the estimate. None where it has fewer epochs, or the fit is not clear, as where there
    may be several optima: then the measurements are to be asked anew.
    """
    count = options.count(timeline)
    if before.guess is None or count > len(before.mean) or not np.isfinite(before.mean).all():
        return None
    ids, points = before.guess.ids, before.guess.points.copy()
    order = np.argsort(ids)
    points[order[np.searchsorted(ids, before.ids, sorter=order)]] = before.points
    guess = InitialGuess(before.mean[:count], ids, points)
    found = smooth_first_epochs(
        process, timeline[:count], guess, before.prior, SmoothingOptions(options.iterations)
    )
    if not _is_clear(found):
        return None
    return replace(
        found,
        momentum_residual=before.momentum_residual,
        noise_ratio=before.noise_ratio,
        guess=before.guess,
    )


def smooth_first_epochs(
    process: ProcessModel,
    epochs: Timeline,
    guess: InitialGuess,
    prior: FirstStatePrior,
    options: SmoothingOptions,
) -> InitialEstimate:
    """Iterate from a guess to the most probable motion and map, robust to wrong observations.

    Parameters
    ----------
    epochs: observations of landmarks that the guess does not hold are left out.
    prior: of the first state; with unknown landmarks its pose must be tight, for it defines g.

    Raises
    ------
    InputError: when the guess has landmarks and none is observed twice, or the layout has no place for them.
    """
    order = np.argsort(guess.ids)
    ids, points = guess.ids[order], guess.points[order]
    problem = problem_of(process, epochs, ids, prior, OBSERVATIONS_NEEDED)
    if len(ids) and problem.observations is None:
        raise InputError(NOTHING_TWICE)
    here = problem.at(with_common_constants(process.layout, guess.trajectory), points)
    schedule = AnnealedSchedule(problem, min(options.annealed, options.iterations), options.gate)
    solved = solve(problem, here, SolverOptions(options.iterations), schedule)
    found = _with_map(_estimate(problem, solved, prior), problem, solved, options.gate)
    return replace(found, ids=ids[found.ids])


def _likeliest(
    process: ProcessModel,
    epochs: Timeline,
    guess: InitialGuess,
    prior: FirstStatePrior,
    options: SmoothingOptions,
) -> InitialEstimate:
    """The likeliest of the fits from the guess and from bodies nearer to a sphere.

    A first fit that settles and determines the body is believed; where the body is hardly determined there may be several optima.
    """
    mass = process.layout.mean_slice(MASS_DISTRIBUTION.name)
    tries: list[InitialEstimate] = []
    strict = () if len(guess.ids) else (replace(options, annealed=0),)  # it would lose landmarks
    for share, own in product(MASS_SHARES, (*strict, options)):
        trajectory = guess.trajectory.copy()
        trajectory[:, mass] *= share
        tries.append(smooth_first_epochs(process, epochs, replace(guess, trajectory=trajectory), prior, own))
        if _is_clear(tries[-1]):
            break
    return min(tries, key=lambda found: _with_rejected(found, options.gate))


def _is_clear(found: InitialEstimate) -> bool:
    """Whether a fit has settled, explains its observations and tells the mass distribution."""
    mass_std = np.linalg.norm(found.factor[-1, found.layout.slice(MASS_DISTRIBUTION.name)], axis=1)
    settled = found.converged and found.fit < SETTLED_FIT and found.rejected <= found.accepted
    return bool(settled and mass_std.max() <= CLEAR_MASS_STD)


def _with_rejected(found: InitialEstimate, gate: float) -> float:
    """Cost in which a rejected observation counts as at the gate.

    A fit then gains nothing by rejecting.
    """
    cost = found.cost + found.rejected * gate**2
    return cost if np.isfinite(cost) else np.inf


def _estimate(problem: Problem, solved: Solved, prior: FirstStatePrior) -> InitialEstimate:
    """The motion that was found, and how its pose-only observations fit."""
    here, solution, n = solved.point, solved.normal.solution, problem.layout.error_dim
    marginals = None if solution is None else Marginals(solution, solved.normal.eliminated)
    nothing = np.full((len(here.trajectory), n, n), np.nan)
    cost, dof, accepted, rejected = here.sensors.cost + here.dynamics.cost, 0, 0, 0
    for k, sensor in enumerate(problem.motion.sensors):
        _, costs, square, _ = here.sensor_rows(problem.motion, k)
        inliers = (here.pose_only_loss or LeastSquares()).weight(square) > 0
        cost += float(square[inliers].sum() - costs.sum())
        accepted += int(np.count_nonzero(inliers))
        dof += int(np.count_nonzero(inliers)) * sensor.model.dim
        rejected += int(np.count_nonzero(~inliers))
    return InitialEstimate(
        layout=problem.layout,
        prior=prior,
        mean=here.trajectory,
        factor=nothing if marginals is None else marginals.factors,
        cost=cost,
        dof=dof,
        accepted=accepted,
        rejected=rejected,
        iterations=solved.iterations,
        converged=solved.converged,
        marginals=marginals,
    )


def _with_map(found: InitialEstimate, problem: Problem, solved: Solved, gate: float) -> InitialEstimate:
    """Estimate with the landmarks that were found, and the fit of their observations."""
    here, fit, observations = solved.point, solved.normal.eliminated, problem.observations
    if fit is None or observations is None or here.linear is None:
        return found
    inliers = int(np.count_nonzero(fit.used))
    return replace(
        found,
        cost=found.cost + float(here.linear.square[fit.used].sum()),
        dof=found.dof + here.linear.rows.shape[1] * inliers - 3 * int(np.count_nonzero(fit.is_constrained)),
        accepted=found.accepted + inliers,
        rejected=found.rejected + int(np.count_nonzero(here.linear.size >= gate)),
        used=observations.by_epoch(fit.used),
        ids=np.flatnonzero(fit.is_constrained),
        points=here.points[fit.is_constrained],
        counts=np.bincount(observations.landmark[fit.used], minlength=observations.landmarks)[
            fit.is_constrained
        ],
    )
