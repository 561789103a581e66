"""Initialisation by smoothing the first epochs, for any sensors: guesses, their priors, and the choice among optima."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Protocol

import numpy as np
from jaxtyping import Float

from spinfilters.filters.estimator import ProcessModel
from spinfilters.filters.timeline import Timeline, times_of
from spinfilters.inference.initial_estimate import InitialEstimate, SmoothingOptions, smooth_first_epochs
from spinfilters.models.gauge import GAUGE_STD
from spinfilters.models.sensor import MotionSamples
from spinfilters.models.state_blocks import ATTITUDE, MASS_DISTRIBUTION, RATE
from spinfilters.models.state_layout import POSE_BLOCKS, StateLayout
from spinfilters.settings.run_settings import InitialisationOptions
from spinfilters.smoother.batch_smoother import GATE, NO_LANDMARKS, NO_POINTS
from spinfilters.smoother.closed_form import MASS_SHARES, InitialMotion, initial_motion, initial_state
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.smoother.problem import InitialGuess

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
    """Wide prior of the first state at the measured pose and rate, tight only where the first epoch defines a frame."""
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


SETTLED_FIT = 1.5
"""Rms of the whitened residuals below which a converged fit is believed without trying others."""
CLEAR_MASS_STD = 0.3
"""Of the mass distribution (log second moments) below which a fit is believed without trying others: on simulated poses all fits
with a second optimum were beyond 0.7, and all optima that were alone below 0.5."""
SAME_COST, SAME_MASS = 0.1, 0.3
"""Of two fits (cost; log second moments), within which they are one optimum."""
MOST_RIVALS = 2
"""Optima that are kept in addition to the likeliest: of simulated motions no third one ever became the likeliest at other noise."""


class InitialisableProcess(ProcessModel, Protocol):
    """Process model that refuses motions too fast to integrate."""

    def require_steps(self, time: Float[np.ndarray, " k"], rates: Float[np.ndarray, "k 3"]) -> None:
        """Require few enough substeps of these rates (rad/s). InputError: too many."""
        ...


def initialise(
    process: InitialisableProcess,
    timeline: Timeline,
    samples: MotionSamples,
    options: InitialisationOptions,
    likely: InitialEstimate | None = None,
) -> InitialEstimate:
    """Smooth the first epochs of a timeline, for any estimator over ``process.layout`` to continue from.

    Parameters
    ----------
    samples : MotionSamples
        Motion at (at least some of) those epochs, and the first guess of a map where landmarks are unknowns.
    likely : InitialEstimate or None
        Of the same motion, whose mass distribution is tried alone where a fit from it settles.

    Raises
    ------
    InputError
        Fewer than 4 samples, a body that does not rotate, landmarks of which none is observed twice.
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
    problem = _FirstProblem(process, epochs, guess, prior, SmoothingOptions(options.iterations))
    found = problem.likeliest() if likely is None else problem.nearest(likely)
    status = found.status
    if not found.converged:
        status = status.degraded(
            f"the initialisation did not converge in {found.iterations} iterations",
            "initialisation-unsettled",
        )
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

    Map and associations are those of the estimate; its rivals are smoothed too where the fit is not clear. None where it has fewer
    epochs, or no optimum settles: then the measurements are to be asked anew.
    """
    count = options.count(timeline)
    if before.guess is None or count > len(before.mean) or not np.isfinite(before.mean).all():
        return None
    tries: list[InitialEstimate] = []
    for optimum in (before, *before.rivals):
        guess = _guess_from(optimum, before.guess, count)
        smoothing = SmoothingOptions(options.iterations)
        tries.append(smooth_first_epochs(process, timeline[:count], guess, before.prior, smoothing))
        if _is_clear(tries[-1]):
            break
    found = _likeliest_of(tries, GATE)
    if not _has_settled(found):
        return None
    return replace(
        found,
        momentum_residual=before.momentum_residual,
        noise_ratio=before.noise_ratio,
        guess=before.guess,
    )


def _guess_from(optimum: InitialEstimate, guess: InitialGuess, count: int) -> InitialGuess:
    """Motion and landmarks of an optimum, other landmarks as first guessed."""
    points, order = guess.points.copy(), np.argsort(guess.ids)
    points[order[np.searchsorted(guess.ids, optimum.ids, sorter=order)]] = optimum.points
    return InitialGuess(optimum.mean[:count], guess.ids, points)


@dataclass(frozen=True)
class _FirstProblem:
    """First epochs, and where smoothing may begin."""

    process: ProcessModel
    epochs: Timeline
    guess: InitialGuess
    prior: FirstStatePrior
    options: SmoothingOptions

    def likeliest(self) -> InitialEstimate:
        """The likeliest of the fits from the guess and from bodies nearer to a sphere.

        A first fit that settles and determines the body is believed; else there may be several optima.
        """
        own = self.guess.trajectory[0, self._mass]
        return self._first([share * own for share in MASS_SHARES], _is_clear)

    def nearest(self, likely: InitialEstimate) -> InitialEstimate:
        """The fit from the mass distribution of another estimate of the motion."""
        body = likely.mean[-1, likely.layout.mean_slice(MASS_DISTRIBUTION.name)]
        found = self._first([body], _has_settled) if np.isfinite(body).all() else None
        return found if found is not None and _has_settled(found) else self.likeliest()

    def _first(
        self, masses: Sequence[Float[np.ndarray, " 5"]], believed: Callable[[InitialEstimate], bool]
    ) -> InitialEstimate:
        """The first fit that is believed, else the likeliest."""
        tries: list[InitialEstimate] = []
        strict = replace(self.options, annealed=0)
        every = (
            (self.options,) if len(self.guess.ids) else (strict, self.options)
        )  # strict would lose landmarks
        for mass, own in product(masses, every):
            if own is not every[0] and tries[-1].is_annealed_too:
                continue
            trajectory = self.guess.trajectory.copy()
            trajectory[:, self._mass] = mass
            guess = replace(self.guess, trajectory=trajectory)
            tries.append(smooth_first_epochs(self.process, self.epochs, guess, self.prior, own))
            if believed(tries[-1]):
                break
        return _likeliest_of(tries, self.options.gate)

    @property
    def _mass(self) -> slice:
        return self.process.layout.mean_slice(MASS_DISTRIBUTION.name)


def _likeliest_of(tries: Sequence[InitialEstimate], gate: float) -> InitialEstimate:
    """The likeliest fit, with the other optima among them as its rivals."""
    best, *others = sorted(tries, key=lambda found: _with_rejected(found, gate))
    rivals: list[InitialEstimate] = []
    for each in others:
        finite = np.isfinite(each.mean).all() and np.isfinite(each.cost)
        if finite and not any(_is_same(each, optimum) for optimum in (best, *rivals)):
            rivals.append(replace(each, marginals=None))
    return replace(best, rivals=tuple(rivals[:MOST_RIVALS]))


def _is_same(one: InitialEstimate, other: InitialEstimate) -> bool:
    """Whether two fits are one optimum."""
    mass = one.layout.mean_slice(MASS_DISTRIBUTION.name)
    away = np.abs(one.mean[-1, mass] - other.mean[-1, mass]).max()
    return bool(abs(one.cost - other.cost) < SAME_COST and away < SAME_MASS)


def _is_clear(found: InitialEstimate) -> bool:
    """Whether a fit has converged and determines the mass distribution."""
    mass_std = np.linalg.norm(found.factor[-1, found.layout.slice(MASS_DISTRIBUTION.name)], axis=1)
    return bool(_has_settled(found) and mass_std.max() <= CLEAR_MASS_STD)


def _has_settled(found: InitialEstimate) -> bool:
    """Whether a fit has converged and explains its observations."""
    return bool(found.converged and found.fit < SETTLED_FIT and found.rejected <= found.accepted)


def _with_rejected(found: InitialEstimate, gate: float) -> float:
    """Cost that counts a rejected observation as one at the gate, so that a fit gains nothing by rejecting."""
    cost = found.cost + found.rejected * gate**2
    return cost if np.isfinite(cost) else np.inf
