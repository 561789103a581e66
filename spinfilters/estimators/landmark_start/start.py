"""A start from tracks alone: motion, body and landmarks of the first frames, smoothed together.

Poses that were fitted frame by frame say where to begin and are then forgotten; what is kept comes from the sightings themselves,
so the covariance holds what poses share (a map that is a little wrong is wrong in every frame). Frame g is fixed by the pose of
the first frame.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.estimator import ProcessModel
from spinfilters.estimators.first_frames import FirstStatePrior, SmoothedFrames
from spinfilters.estimators.landmark_start.result import LandmarkSmoothing
from spinfilters.estimators.landmark_start.smoother import SmoothingOptions, smooth_with_landmarks
from spinfilters.estimators.motion_evidence import MotionEvidence
from spinfilters.estimators.smoothing.problem import Trial
from spinfilters.estimators.start import (
    MASS_SHARES,
    SETTLED_FIT,
    StartOptions,
    StartReport,
    closed_form,
    trial_trajectory,
    wide_prior,
)
from spinfilters.estimators.timeline import Timeline
from spinfilters.logs.track_files import KnownMap
from spinfilters.models.gauge import GAUGE_STD
from spinfilters.state.layout import POSE_BLOCKS


@dataclass(frozen=True)
class LandmarkStartReport(StartReport):
    """A start whose fit holds landmarks too: `landmarks` knows their joint belief with the last frame's state."""

    landmarks: LandmarkSmoothing


def start_with_landmarks(
    process: ProcessModel,
    timeline: Timeline,
    evidence: MotionEvidence,
    known: KnownMap,
    options: StartOptions,
) -> LandmarkStartReport:
    """Smooth the first frames of a timeline whose sightings carry ids.

    Parameters
    ----------
    evidence: poses and rates of (at least some of) those frames.   known: first guess of the map, frame g of those poses.

    Raises
    ------
    InputError: when the evidence has fewer than 4 frames, the body does not rotate, or no landmark is seen twice.
    """
    first, momentum_residual = closed_form(process.layout, evidence)
    frames = timeline[: options.count(timeline)]
    trajectory = trial_trajectory(process.layout, frames, first, evidence)
    prior = wide_prior(process.layout, first, options, evidence)
    prior = _fixing_g(process, trajectory[0], prior)
    found = _best_fit(process, frames, Trial(trajectory, known.ids, known.points), prior, options)
    smoothed = SmoothedFrames(
        found.mean, found.factor, found.cost, found.dof, found.iterations, found.converged
    )
    fit = float(np.sqrt(found.cost / max(found.dof, 1)))
    return LandmarkStartReport(process.layout, smoothed, fit, momentum_residual, prior, found)


def _fixing_g(
    process: ProcessModel, first: Float[np.ndarray, " m"], prior: FirstStatePrior
) -> FirstStatePrior:
    """The prior with the first pose held where the trial has it."""
    layout, mean, std = process.layout, prior.mean.copy(), prior.std.copy()
    for block in POSE_BLOCKS:
        mean[layout.mean_slice(block)] = first[layout.mean_slice(block)]
        std[layout.slice(block)] = GAUGE_STD
    return FirstStatePrior(mean, std)


def _best_fit(
    process: ProcessModel, frames: Timeline, trial: Trial, prior: FirstStatePrior, options: StartOptions
) -> LandmarkSmoothing:
    """The fit from the closed form; where that does not settle, also from bodies nearer to a sphere, and the likeliest is kept."""
    tries: list[LandmarkSmoothing] = []
    smoothing = SmoothingOptions(options.iterations)
    for share in MASS_SHARES:
        trajectory = trial.trajectory.copy()
        trajectory[:, process.layout.mean_slice("s")] *= share
        start = Trial(trajectory, trial.ids, trial.points)
        tries.append(smooth_with_landmarks(process, frames, start, prior, smoothing))
        if tries[-1].converged and tries[-1].cost < SETTLED_FIT**2 * tries[-1].dof:
            break
    return min(tries, key=lambda found: _with_rejected(found, smoothing.gate))


def _with_rejected(found: LandmarkSmoothing, gate: float) -> float:
    """Cost in which a rejected sighting counts as one at the gate, so that a fit gains nothing by rejecting."""
    cost = found.cost + found.rejected * gate**2
    return cost if np.isfinite(cost) else np.inf
