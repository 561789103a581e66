"""The Cramer-Rao bound of a recording with a truth.

The smoother's linear problem where the body really was.
It takes stated noise as the estimators assume it, and the measurements that are what they claim to be. Of disturbances that
are unspecified it takes no more than the truth shows: what an estimator identifies of a few epochs may be far more, and would be
no bound. Where the measurements lie much nearer to the truth than they state, as registered scans without noise do, or farther,
their noise is not the stated, and there is no bound. Where the landmarks are not known, their true points are not either: one
step at the true poses settles them.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.core.robust_losses import Gate
from spinfilters.evaluation.consistency import finite_epochs, true_states
from spinfilters.evaluation.estimator_evaluation import Evaluation, error_bound
from spinfilters.evaluation.trajectory_errors import Alignment, common_stamps, truth_in_estimate_frames
from spinfilters.filters.history import EstimateHistory
from spinfilters.filters.timeline import times_of
from spinfilters.inference.setup import Setup
from spinfilters.io.disturbances import DENSITIES
from spinfilters.io.input_file import reason
from spinfilters.io.truth import Truth
from spinfilters.models.process import ProcessNoise
from spinfilters.models.state_layout import POSE_BLOCKS
from spinfilters.smoother.batch_smoother import NO_LANDMARKS
from spinfilters.smoother.landmark_factors import (
    OBSERVATIONS_NEEDED,
    collect_observations,
    reinitialised,
    seen_ids,
)
from spinfilters.smoother.linear_system import Marginals
from spinfilters.smoother.motion_factors import STRETCH
from spinfilters.smoother.problem import LinearizationPoint, Problem, Stage, problem_of

GATE: Final = 5.0
"""Standard deviations from what the truth predicts: a measurement beyond is no measurement of it."""
ROUGH_GATE: Final = 4 * GATE
"""The same before the landmarks are settled."""
INLIERS_NEEDED: Final = 0.5
"""Share of the measurements below which their noise is not what the estimators assume, and the bound says nothing."""
LEAST_RESIDUAL: Final = 0.1
"""Mean squared residual at the truth, in stated variances, below which the same holds: half the components of a scan's pose may
be undetermined and have none."""
LEAST_DISTURBANCE: Final = 1e-4
"""Share of the assumed density that is kept where the truth shows none: beyond, steps and measurements share no digits."""
MOST_WITH_LANDMARKS, MOST_WITHOUT = 200, 100_000
"""Epochs beyond which the bound is left out, with unknown landmarks and without. Landmarks join all poses in one system, of which
time grows with the cube of the epochs; without them it grows with their number, 0.3 s for a thousand, as does memory."""

Bounding = Callable[[Sequence[Evaluation], Setup], list[Evaluation]]
"""Adds the bound to the errors of evaluations, as `with_bounds` does."""


def with_bounds(evaluations: Sequence[Evaluation], setup: Setup) -> list[Evaluation]:
    """Evaluations with the bound on their errors, where there is one.

    There is none without a truth at all epochs, where the truth is given at epochs that nothing relates to those of the estimate,
    where it does not give the whole state, where it or the estimate does not go on to the end, and for long recordings.
    """
    truth, epochs = setup.dataset.truth, len(setup.timeline)
    whole = [each for each in evaluations if each.errors is not None and _is_whole(each.history, epochs)]
    if truth is None:
        return list(evaluations)
    limits, missing = None, "no estimate of all epochs has errors"
    if whole:
        limits, missing = bound_or_reason(setup, truth, whole[0])
    if limits is None:
        return [each.with_fields(bound_missing=missing) for each in evaluations]
    return [
        each.with_fields(bound=error_bound(limits, each.errors, each.alignment is Alignment.BODY_FRAME))
        if each.errors is not None and _is_whole(each.history, epochs)
        else each
        for each in evaluations
    ]


def without_bounds(evaluations: Sequence[Evaluation], setup: Setup) -> list[Evaluation]:
    """Evaluations as they are."""
    return list(evaluations)


def _is_whole(history: EstimateHistory, epochs: int) -> bool:
    return len(history.time) == epochs and bool(finite_epochs(history).all())


def cramer_rao_bound(setup: Setup, truth: Truth, evaluation: Evaluation) -> EstimateHistory | None:
    """True states with their Cramer-Rao bound, or None; see `bound_or_reason`."""
    return bound_or_reason(setup, truth, evaluation)[0]


def bound_or_reason(setup: Setup, truth: Truth, evaluation: Evaluation) -> tuple[EstimateHistory | None, str]:
    """True states with their Cramer-Rao bound, or None and why, in words; see `with_bounds`.

    Parameters
    ----------
    evaluation : Evaluation
        Of all epochs, whose frames i and g are those of the bound.
    """
    epochs, most = len(setup.timeline), MOST_WITH_LANDMARKS if _is_separator(setup) else MOST_WITHOUT
    if epochs > most:
        seen = "with unknown landmarks " if _is_separator(setup) else ""
        return None, f"{seen}it is computed of at most {most} epochs, these are {epochs}"
    try:
        states = _states(setup, truth, evaluation)
        if states is None:
            return None, "the truth does not contain the whole state at every epoch in known frames"
        factors, missing = _factors(setup, states)
    except (
        InputError,
        *NUMERICAL_ERRORS,
    ) as error:  # the truth, or the problem at it, is not one to be bounded
        return None, f"it cannot be computed at the truth ({reason(error)})"
    if factors is None:
        return None, missing
    if not np.isfinite(factors).all():
        return None, "the measurements leave something undetermined"
    return replace(evaluation.history, name="bound", mean=states, factor=factors), ""


def _states(setup: Setup, truth: Truth, evaluation: Evaluation) -> Float[np.ndarray, "k m"] | None:
    """The truth at every epoch in the frames of the estimate; None where it is not known at all of them."""
    history = evaluation.history
    if evaluation.alignment is Alignment.BODY_FRAME and history.layout.translates:
        return None
    truth = truth_in_estimate_frames(history, truth, evaluation.alignment)
    rows, true_rows = common_stamps(history.time, truth.time)
    return true_states(truth, history.layout)[true_rows] if len(rows) == len(setup.timeline) else None


def _factors(setup: Setup, states: Float[np.ndarray, "k m"]) -> tuple[Float[np.ndarray, "k n n"] | None, str]:
    """Covariance factors of every epoch given all measurements, or None and why."""
    ids, points = landmarks_at(setup, states)
    problem = _problem(setup, states, ids)
    here = problem.at(states, points)
    rough = problem.normal(here, Stage(Gate(GATE, ROUGH_GATE))).eliminated if len(ids) else None
    if rough is not None:
        here = problem.at(states, points + rough.points_step(np.zeros((len(states), 6))))
    normal = problem.normal(here, Stage(Gate(GATE, GATE)))
    if normal.solution is None:
        return None, "the measurements leave something undetermined"
    residuals = list(_residuals_of_sensors(problem, here))
    if _inliers(residuals, normal.used) < INLIERS_NEEDED:
        return None, "most measurements lie farther from the truth than their stated noise allows"
    ratio = _squared_residual(residuals)
    if ratio is not None and ratio < LEAST_RESIDUAL:
        return (
            None,
            f"the measurements lie nearer to the truth than they state ({np.sqrt(ratio):.1g} of their standard deviations)",
        )
    return Marginals(normal.solution, normal.eliminated).factors, ""


def _problem(setup: Setup, states: Float[np.ndarray, "k m"], ids: Int[np.ndarray, " L"]) -> Problem:
    """Problem with the estimators' own prior, whose pose is the true one."""
    layout, prior = setup.process.layout, setup.initial.prior
    mean = prior.mean.copy()
    for block in set(layout.blocks).intersection(POSE_BLOCKS):
        mean[layout.mean_slice(block)] = states[0, layout.mean_slice(block)]
    loss, own = Gate(GATE, GATE), replace(prior, mean=mean)
    process = setup.process.with_noise(true_disturbances(setup, states))
    return problem_of(process, setup.timeline, ids, own, OBSERVATIONS_NEEDED, loss)


def true_disturbances(setup: Setup, states: Float[np.ndarray, "k m"]) -> ProcessNoise:
    """Densities of the disturbances: stated ones as they are, others no larger than true states show.

    The most likely density of a disturbance is the mean square of what the steps leave unexplained over their durations.

    Parameters
    ----------
    states : (k, m) float array
        True ones at every epoch.
    """
    process, noise = setup.process, setup.process.noise
    layout, time = process.layout, times_of(setup.timeline)
    sought = {
        name: layout.slice(each.block).start + np.array(each.axes)
        for name, each in DENSITIES.items()
        if name in setup.unstated and each.block in layout.blocks
    }
    if not sought:
        return noise
    dt = np.diff(time)
    left = layout.local(process.steps(states[:-1], dt), states[1:]) / np.sqrt(dt)[:, None]
    shown = {name: float(np.mean(left[:, rows] ** 2)) for name, rows in sought.items()}
    assumed = {name: getattr(noise, name) for name in sought}
    return replace(
        noise, **{name: max(min(shown[name], own), LEAST_DISTURBANCE * own) for name, own in assumed.items()}
    )


def landmarks_at(
    setup: Setup, states: Float[np.ndarray, "k m"]
) -> tuple[Int[np.ndarray, " L"], Float[np.ndarray, "L 3"]]:
    """Ids and first guesses of landmarks in g, at the poses of these states.

    They are those of the start, or where most of a landmark's observations agree from the poses.
    """
    if not setup.maps_landmarks:
        return NO_LANDMARKS, np.zeros((0, 3))
    started = setup.initial
    ids = np.unique(seen_ids(setup.timeline))
    points = np.full((len(ids), 3), np.nan)
    points[np.searchsorted(ids, started.ids)] = started.points
    new = ids[np.isnan(points[:, 0])]
    observations = collect_observations(setup.timeline, new, OBSERVATIONS_NEEDED)
    nothing = np.zeros(len(observations), dtype=bool)
    found = reinitialised(observations, states, np.full((len(new), 3), np.nan), nothing, GATE)
    if found is not None:
        points[np.searchsorted(ids, new)] = found
    placed = np.isfinite(points).all(axis=1)
    return ids[placed], points[placed]


class _Residuals(NamedTuple):
    """Some measurements' squared residuals of so many components in stated variances, and which of them count."""

    squares: Float[np.ndarray, " r"]
    counted: Bool[np.ndarray, " r"]
    dim: int


def _residuals_of_sensors(problem: Problem, here: LinearizationPoint) -> Iterator[_Residuals]:
    """Of every sensor without landmarks; of long recordings one stretch after the other."""
    motion = problem.motion
    for number, sensor in enumerate(motion.sensors):
        if not problem.is_long:
            found = here.sensor_rows(motion, number)
            yield _Residuals(found.squares, found.counted, sensor.model.dim)
            continue
        for first in range(0, len(sensor.epoch), STRETCH):
            found = motion.sensor_rows(sensor.part(slice(first, first + STRETCH)), here.trajectory)
            yield _Residuals(found.squares, found.counted, sensor.model.dim)


def _inliers(residuals: Sequence[_Residuals], used: Bool[np.ndarray, " N"] | None) -> float:
    """Share of the measurements that count; 0 where there are none."""
    flags = [each.counted for each in residuals]
    flags += [] if used is None else [used]
    counts = np.concatenate([np.zeros(0, dtype=bool), *flags])
    return float(counts.mean()) if len(counts) else 0.0


def _squared_residual(residuals: Sequence[_Residuals]) -> float | None:
    """Mean squared residual of a component, of sensors without landmarks; None without any."""
    squares = sum(float(each.squares[each.counted].sum()) for each in residuals)
    components = sum(int(np.count_nonzero(each.counted)) * each.dim for each in residuals)
    return squares / components if components else None


def _is_separator(setup: Setup) -> bool:
    return setup.maps_landmarks
