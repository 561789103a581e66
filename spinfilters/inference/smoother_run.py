"""The smoother on a prepared data set, with noise that is not stated identified on its own epochs."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.core.posterior_sampling import LARGEST_SHAPE
from spinfilters.core.working_time import working_seconds
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.history import EstimateHistory
from spinfilters.filters.timeline import OnEpoch, Timeline, rehearse, run, times_of
from spinfilters.inference.first_epochs import initial_samples
from spinfilters.inference.identification import Identified, identify
from spinfilters.inference.identified_noise import noise_model
from spinfilters.inference.initial_estimate import guessed_trajectory
from spinfilters.inference.setup import Setup, camera_view
from spinfilters.io.sensor_format import sensor_format
from spinfilters.models.body import MassSamples
from spinfilters.models.state_layout import StateLayout
from spinfilters.models.status import BODY, EstimatorStatus, Finding, Verdict
from spinfilters.settings.run_settings import Settings
from spinfilters.smoother.batch_smoother import NO_LANDMARKS, BatchSmoothing, smooth_problem, smooth_recording
from spinfilters.smoother.closed_form import InitialMotion, initial_motion
from spinfilters.smoother.mass_posterior import SampledMass, sampled_mass
from spinfilters.smoother.motion_factors import STRETCH
from spinfilters.smoother.problem import InitialGuess, Problem, problem_of
from spinfilters.smoother.recursive_smoother import RecursiveSmoother
from spinfilters.smoother.sliding_smoother import MarginalizedState, UpdateResult
from spinfilters.smoother.window import WindowPolicy

if TYPE_CHECKING:
    from spinfilters.smoother.posterior import Posterior


def measured_motion(setup: Setup) -> InitialMotion:
    """Attitudes, rates and positions measured directly over a recording, without an estimator.

    Raises
    ------
    InputError
        When it does not say them: too few poses, or too large turns between them.
    """
    dataset = setup.dataset
    known = dataset.known_map is not None
    streams = [s for s in dataset.log.streams if known or not sensor_format(s.sensor).has_landmarks]
    samples = initial_samples(streams, setup.noise, camera_view(dataset))
    return initial_motion(samples, len(setup.timeline))


def identified_levels(
    problem: Problem,
    trajectory: Float[np.ndarray, "k m"],
    points: Float[np.ndarray, "L 3"],
    setup: Setup,
) -> Identified | None:
    """Noise levels of a problem, begun at those of the initialisation; None where all are stated or none settle."""
    model = noise_model(problem, setup.noise, setup.sought)
    if model is None or not np.isfinite(trajectory).all():
        return None
    try:
        found = identify(model, trajectory, points, model.stated)
    except NUMERICAL_ERRORS:
        return None
    return found if found is not None and found.converged else None


def at_levels(problem: Problem, found: Identified, setup: Setup) -> Problem:
    """The problem with levels identified from it, or from a part of it."""
    model = noise_model(problem, setup.noise, setup.sought)
    return problem if model is None else model.scaled(found.expected)


def settled_at_levels(
    smoother: RecursiveSmoother, setup: Setup
) -> tuple[list[MarginalizedState], Identified | None]:
    """Every epoch so far at the levels that the window identifies, and these."""
    sliding = smoother.sliding
    window = sliding.window
    found = identified_levels(sliding.problem(), window.trajectory, window.points, setup)
    if found is None:
        return smoother.smoothed(), None
    sliding.at_levels = lambda problem: at_levels(problem, found, setup)
    rows = smoother.smoothed()
    before, own = rows[: -len(window.epochs)], rows[-len(window.epochs) :]
    factors = found.widened(np.array([row.factor for row in own]))
    return [*before, *(replace(row, factor=f) for row, f in zip(own, factors, strict=True))], found


def smoothed_at_levels(
    problem: Problem, part: Problem, smoothed: BatchSmoothing, setup: Setup
) -> tuple[BatchSmoothing, Identified | None]:
    """A recording smoothed once more at the levels that it identifies, and these.

    Parameters
    ----------
    part : Problem
        Of the problem's first epochs, whose rows are in memory together; the problem itself where it is short.
    """
    trajectory = smoothed.mean[: part.ordering.epochs]
    found = identified_levels(part, trajectory, np.zeros((0, 3)), setup)
    if found is None:
        return smoothed, None
    again = smooth_problem(at_levels(problem, found, setup), smoothed.mean)
    if part.ordering.epochs == problem.ordering.epochs:
        again = replace(again, factor=found.widened(again.factor))
    return again, found


NAME = "smoother"
NOT_GAUSSIAN = "posterior-not-gaussian"
"""Name of the check in the verdict."""
LARGEST_SAMPLED_NEES = 2.0
"""Mean NEES per degree of freedom of the posterior's samples in its Gaussian: above, this misses a part of the posterior."""
NO_FILTER = (
    "the filter for the initial guess of the smoother failed: it started directly from the measurements"
)
SOME_DIRECTIONS = "some directions are not determined at all, so that the estimate has no covariance"
ANNEALED_ITERATIONS = 30
"""At most, from a trajectory that no filter has made."""


def sliding_smoother(
    setup: Setup, settings: Settings, policy: WindowPolicy | None = None
) -> RecursiveSmoother:
    """The smoother of tracks without a map; for sensors that tie nothing together see `smooth_at_once`.

    Parameters
    ----------
    policy : WindowPolicy or None
        Of what leaves its window, in place of that of the settings.
    """
    timeline = setup.timeline
    every = (measurement.model for epoch in timeline for measurement in epoch.measurements)
    options = settings.smoother.options(len(timeline))
    options = options if policy is None else replace(options, policy=policy)
    return RecursiveSmoother(setup.process, options, tuple(dict.fromkeys(every)))


def begin_after_initialisation(smoother: RecursiveSmoother, setup: Setup) -> list[UpdateResult]:
    """Add the epochs of the initialisation with its estimates."""
    start = setup.initial
    first = InitialGuess(start.mean, start.ids, start.points)
    return smoother.begin(start.prior, setup.timeline[: len(first.trajectory)], first)


def smoothed_history(smoother: RecursiveSmoother, passed: EstimateHistory, setup: Setup) -> EstimateHistory:
    """Every epoch given all measurements; ``passed`` are those after the initialisation, as they came."""
    first, status = len(setup.initial.mean), passed.status
    rows, found = settled_at_levels(smoother, setup)
    rows = rows[: first + len(passed.time)]
    for doubt in smoother.sliding.unobservable():
        status = status.doubted(doubt)
    factor = np.array([row.factor for row in rows])
    if not np.isfinite(factor).all():
        status = status.failed(SOME_DIRECTIONS, "unobservable")
    accepted, rejected = _counts(smoother, passed)
    nothing = np.zeros(len(rows))
    return EstimateHistory(
        name=NAME,
        layout=setup.process.layout,
        time=np.array([epoch.time for epoch in setup.timeline[: len(rows)]]),
        mean=np.array([row.mean for row in rows]),
        factor=factor,
        nis=nothing,
        dof=nothing.astype(int),
        log_likelihood=nothing,
        accepted=accepted,
        rejected=rejected,
        runtime=np.concatenate([setup.initial_runtime, passed.runtime])[: len(rows)],
        status=status,
        noise=() if found is None else found.components,
    )


def _counts(
    smoother: RecursiveSmoother, passed: EstimateHistory
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Final inliers and outliers of every epoch; marginalized epochs keep the numbers they had."""
    first = np.array([(taken.accepted, taken.rejected) for taken in smoother.begun]).reshape(-1, 2)
    came = np.concatenate([first, np.stack([passed.accepted, passed.rejected], axis=1)])
    counts = smoother.sliding.counts()
    accepted, rejected = (came if counts is None else counts[: len(came)]).T
    return accepted.astype(int), rejected.astype(int)


def smooth_at_once(setup: Setup, settings: Settings, on_epoch: OnEpoch) -> EstimateHistory:
    """Batch smoothing of all epochs, from the trajectory of the EKF."""
    return _smoothed_at_once(setup, settings, on_epoch).history


def smooth_and_sample(setup: Setup, settings: Settings, on_epoch: OnEpoch) -> EstimateHistory:
    """`smooth_at_once`, with samples of the mass distribution where one direction of it is hardly determined.

    Moments and axes are then those of the marginal posterior. Where that is not Gaussian, deviations of the motion cover it, too.
    """
    smoothed = _smoothed_at_once(setup, settings, on_epoch)
    history, begin = smoothed.history, working_seconds()
    found = None
    with suppress(*NUMERICAL_ERRORS):
        found = sampled_mass(smoothed.problem, smoothed.found)
    seconds = working_seconds() - begin
    if found is None:
        return history
    return _with_samples(replace(history, runtime=history.runtime + seconds / len(history.time)), found)


def _with_samples(history: EstimateHistory, found: SampledMass) -> EstimateHistory:
    """The history with samples of the mass distribution.

    Where their weights cannot be relied upon it stays as it is, and its status says so if a Gaussian does not describe them either.
    """
    mass = found.mass
    is_gaussian = mass.gaussian_shape < LARGEST_SHAPE and mass.gaussian_nees <= LARGEST_SAMPLED_NEES
    if not mass.shape < LARGEST_SHAPE:
        return history if is_gaussian else replace(history, status=history.status.doubted(_not_sampled(mass)))
    if is_gaussian:
        return replace(history, mass=mass)
    return replace(history, mass=mass, factor=history.factor * found.widening[..., np.newaxis])


POSTERIOR = "posterior"
"""Name of the estimator that samples the posterior."""


def sample_at_once(setup: Setup, settings: Settings, on_epoch: OnEpoch) -> EstimateHistory:
    """Posterior of all epochs, sampled about the smoother's solution at its levels of noise (`sample_posterior`)."""
    from spinfilters.smoother.posterior import sample_posterior

    smoothed = _smoothed_at_once(setup, settings, on_epoch)
    return _sampled(smoothed.history, lambda: sample_posterior(smoothed.problem, smoothed.found.mean))


def sampled_history(smoother: RecursiveSmoother, passed: EstimateHistory, setup: Setup) -> EstimateHistory:
    """`sample_at_once` of tracks without a map, whose landmarks are integrated out; no epoch may have left the window."""
    from spinfilters.smoother.posterior import sample_posterior

    history, sliding = smoothed_history(smoother, passed, setup), smoother.sliding

    def sample() -> "Posterior | None":
        """About the window's solution."""
        window, used = sliding.window, sliding.solution.normal.used
        return sample_posterior(sliding.problem(), window.trajectory, points=window.points, used=used)

    return _sampled(history, sample)


def _sampled(history: EstimateHistory, sample: Callable[[], "Posterior | None"]) -> EstimateHistory:
    """A smoother's history as the estimator `posterior` has it."""
    history, begin, found = replace(history, name=POSTERIOR), working_seconds(), None
    with suppress(*NUMERICAL_ERRORS):
        found = sample()
    if found is None:
        return replace(history, status=history.status.failed("the posterior could not be sampled"))
    runtime = history.runtime + (working_seconds() - begin) / len(history.time)
    return replace(
        history,
        mean=found.mean,
        factor=found.factor,
        mass=found.mass,
        posterior=found.last,
        runtime=runtime,
    )


def smoothed_problem(setup: Setup, settings: Settings) -> tuple[Problem, BatchSmoothing]:
    """The least-squares problem of a recording without landmarks at its noise levels, and its solution."""
    smoothed = _smoothed_at_once(setup, settings, lambda done, every: None)
    return smoothed.problem, smoothed.found


def _not_sampled(mass: MassSamples) -> Finding:
    """The finding that neither a Gaussian nor samples describe the posterior of the mass distribution."""
    return Finding(
        NOT_GAUSSIAN,
        f"the posterior of the moments is not Gaussian (Pareto shape {mass.gaussian_shape:.2g}, limit {LARGEST_SHAPE:g}; NEES of "
        f"its samples {mass.gaussian_nees:.2g}, limit {LARGEST_SAMPLED_NEES:g}), and samples along its ridge do not represent it "
        f"(Pareto shape {mass.shape:.2g})",
        "record a motion that wobbles",
        {"shape": mass.gaussian_shape, "nees": mass.gaussian_nees, "samples": mass.shape},
        BODY,
    )


class _Smoothed(NamedTuple):
    """A recording's history, with the problem at its noise levels and the solution."""

    history: EstimateHistory
    problem: Problem
    found: BatchSmoothing


def _smoothed_at_once(setup: Setup, settings: Settings, on_epoch: OnEpoch) -> _Smoothed:
    start, timeline = setup.initial, setup.timeline
    first = len(start.mean)
    _rehearse_at_once(setup, settings)
    begin = working_seconds()
    ekf = _initialised_ekf(setup, settings)
    passed = run(
        ekf, setup.end_of_initialisation, timeline[first:], lambda k: on_epoch(k + 1, len(timeline) - first)
    )
    trajectory, status = np.concatenate([start.mean, passed.mean]), passed.status
    del passed  # its covariances are as large as those to come
    annealed = 0
    if status.verdict is Verdict.FAILED:
        with suppress(InputError, *NUMERICAL_ERRORS):
            trajectory = _measured_trajectory(setup)
            annealed, status = ANNEALED_ITERATIONS, EstimatorStatus().degraded(NO_FILTER, "filter-failed")
    epochs = timeline[: len(trajectory)]
    whole, found, levels = _smooth_epochs(epochs, trajectory, annealed, setup, settings)
    if not found.solved.converged and not annealed:
        # the filter may have lost the motion without a sign, as from a first belief far from the truth
        with suppress(InputError, *NUMERICAL_ERRORS):
            measured = _measured_trajectory(setup)[: len(epochs)]
            again = _smooth_epochs(epochs, measured, ANNEALED_ITERATIONS, setup, settings)
            whole, found, levels = again if again[1].solved.converged else (whole, found, levels)
    if not found.solved.converged:
        status = status.degraded(
            f"the smoother did not converge in {found.solved.iterations} iterations", "smoother-unsettled"
        )
    share = (working_seconds() - begin) / len(epochs)
    runtime = np.full(len(epochs), share)
    runtime[:first] += setup.initial_runtime[: len(epochs)]
    history = _batch_history(found, setup.process.layout, status, times_of(epochs), runtime)
    if levels is None:
        return _Smoothed(history, whole, found)
    return _Smoothed(replace(history, noise=levels.components), at_levels(whole, levels, setup), found)


def _smooth_epochs(
    epochs: Timeline, trajectory: Float[np.ndarray, "k m"], annealed: int, setup: Setup, settings: Settings
) -> tuple[Problem, BatchSmoothing, Identified | None]:
    """The problem of some epochs, smoothed from a trajectory at the levels of noise that they identify, and these."""

    def problem(count: int) -> Problem:
        """The least-squares problem of the recording."""
        loss = settings.smoother.robust_loss
        return problem_of(setup.process, epochs[:count], NO_LANDMARKS, setup.initial.prior, 2, loss)

    whole = problem(len(epochs))
    part = problem(STRETCH) if whole.is_long else whole
    return whole, *smoothed_at_levels(whole, part, smooth_problem(whole, trajectory, annealed), setup)


def _measured_trajectory(setup: Setup) -> Float[np.ndarray, "k m"]:
    """States that the measurements say directly, for a recording that no filter comes through."""
    layout, epochs = setup.process.layout, setup.timeline
    return guessed_trajectory(layout, epochs, setup.initial.mean[-1], measured_motion(setup))


def _rehearse_at_once(setup: Setup, settings: Settings) -> None:
    """Build what the smoothing of the first epochs needs, before the clock runs."""
    start, timeline = setup.initial, setup.timeline
    trajectory = start.mean
    rehearse(_initialised_ekf(setup, settings), setup.end_of_initialisation, timeline[len(trajectory) :])
    with suppress(np.linalg.LinAlgError):
        loss = settings.smoother.robust_loss
        smooth_recording(setup.process, timeline[: len(trajectory)], trajectory, start.prior, loss)


def _initialised_ekf(setup: Setup, settings: Settings) -> MultiplicativeEkf:
    ekf = MultiplicativeEkf(setup.process, settings.robust)
    ekf.start(setup.initial.belief)
    setup.take_in_first_epoch(ekf)
    return ekf


def _batch_history(
    found: BatchSmoothing,
    layout: StateLayout,
    status: EstimatorStatus,
    time: Float[np.ndarray, " k"],
    runtime: Float[np.ndarray, " k"],
) -> EstimateHistory:
    """History of the smoothed epochs.

    A filter that did not come through says so, in its status, for the smoother too.
    """
    count = len(time)
    for doubt in found.unobservable:
        status = status.doubted(doubt)
    if not np.isfinite(found.factor).all():
        status = status.failed(SOME_DIRECTIONS, "unobservable")
    nothing = np.zeros(count)
    return EstimateHistory(
        name=NAME,
        layout=layout,
        time=time,
        mean=found.mean,
        factor=found.factor,
        nis=nothing,
        dof=nothing.astype(int),
        log_likelihood=nothing,
        accepted=found.accepted,
        rejected=found.rejected,
        runtime=runtime,
        status=status,
    )
