"""The Cramer-Rao bound of a recording with a truth: the smoother's linear problem where the body really was.

It takes the noise as the estimators are told it, and the measurements that are what they claim to be. Where the landmarks are
not known, their true points are not either: one step at the true poses settles them.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.errors import NUMERICAL_ERRORS, InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.smoothing.batch import NO_LANDMARKS
from spinfilters.estimators.smoothing.marginals import Marginals
from spinfilters.estimators.smoothing.problem import Point, Problem, Stage, problem_of
from spinfilters.estimators.smoothing.revival import revived
from spinfilters.estimators.smoothing.robust_kernels import Gate
from spinfilters.estimators.smoothing.sightings import (
    SIGHTINGS_NEEDED,
    collect_sightings,
    seen_ids,
)
from spinfilters.estimators.smoothing.state_prior import FirstStatePrior
from spinfilters.evaluation.bound import error_bound
from spinfilters.evaluation.consistency import finite_frames, true_states
from spinfilters.evaluation.errors import Alignment, common_stamps
from spinfilters.evaluation.evaluation import Evaluation
from spinfilters.evaluation.truth_frames import truth_in_first_frame, truth_in_inertial_frame
from spinfilters.logs.truth import Truth
from spinfilters.state.layout import POSE_BLOCKS
from spinfilters.workflow.preparation import Prepared

GATE: Final = 5.0
"""Standard deviations from what the truth foretells: a measurement beyond is no measurement of it."""
ROUGH_GATE: Final = 4 * GATE
"""The same before the landmarks are settled."""
BELIEVED: Final = 0.5
"""Share of the measurements below which their noise is not what the estimators are told, and the bound says nothing."""
MOST_TIED, MOST_CHAINED = 200, 4000
"""Frames beyond which the bound is left out, with unknown landmarks and without: it would take longer than it is worth."""

Bounding = Callable[[Sequence[Evaluation], Prepared], list[Evaluation]]
"""Puts the bound beside the errors of evaluations, as `with_bounds` does."""


def with_bounds(evaluations: Sequence[Evaluation], prepared: Prepared) -> list[Evaluation]:
    """Evaluations with the bound beside their errors, where there is one.

    There is none without a truth at all frames, where the truth is told in frames that nothing relates to those of the estimate,
    where it does not tell the whole state, where it or the estimate does not go on to the end, and for long recordings.
    """
    truth, frames = prepared.dataset.truth, len(prepared.timeline)
    whole = [each for each in evaluations if each.errors is not None and _is_whole(each.history, frames)]
    limits = None if truth is None or not whole else cramer_rao_bound(prepared, truth, whole[0])
    if limits is None:
        return list(evaluations)
    return [
        each.with_fields(bound=error_bound(limits, each.errors, each.alignment is Alignment.BODY_FRAME))
        if each.errors is not None and _is_whole(each.history, frames)
        else each
        for each in evaluations
    ]


def without_bounds(evaluations: Sequence[Evaluation], prepared: Prepared) -> list[Evaluation]:
    """Evaluations as they are."""
    return list(evaluations)


def _is_whole(history: EstimateHistory, frames: int) -> bool:
    return len(history.time) == frames and bool(finite_frames(history).all())


def cramer_rao_bound(prepared: Prepared, truth: Truth, evaluation: Evaluation) -> EstimateHistory | None:
    """The true states with the least covariance that all measurements leave, or None; see `with_bounds`.

    Parameters
    ----------
    evaluation: of all frames, whose frames i and g are those of the bound.
    """
    if len(prepared.timeline) > (MOST_TIED if _is_tied(prepared) else MOST_CHAINED):
        return None
    try:
        states = _states(prepared, truth, evaluation)
        if states is None:
            return None
        factors = _factors(prepared, states)
    except (InputError, *NUMERICAL_ERRORS):  # the truth, or the problem at it, is not one to be bounded
        return None
    if factors is None or not np.isfinite(factors).all():
        return None
    return replace(evaluation.history, name="bound", mean=states, factor=factors)


def _states(prepared: Prepared, truth: Truth, evaluation: Evaluation) -> Float[np.ndarray, "k m"] | None:
    """The truth at every frame in the frames of the estimate; None where it does not tell all of them."""
    history = evaluation.history
    if evaluation.alignment is Alignment.BODY_FRAME and history.layout.translates:
        return None
    if evaluation.alignment is Alignment.FIRST_FRAME:
        truth = truth_in_first_frame(history, truth)
    if evaluation.alignment is Alignment.INERTIAL_FRAME:
        truth = truth_in_inertial_frame(history, truth)
    rows, true_rows = common_stamps(history.time, truth.time)
    return true_states(truth, history.layout)[true_rows] if len(rows) == len(prepared.timeline) else None


def _factors(prepared: Prepared, states: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "k n n"] | None:
    """Of every frame's covariance given all; None where something is undetermined or the noise is not as it is told."""
    ids, points = _landmarks(prepared, states)
    problem = _problem(prepared, states, ids)
    here = problem.at(states, points)
    rough = problem.normal(here, Stage(Gate(GATE, ROUGH_GATE))).eliminated if len(ids) else None
    if rough is not None:
        here = problem.at(states, points + rough.points_step(np.zeros((len(states), 6))))
    normal = problem.normal(here, Stage(Gate(GATE, GATE)))
    if isinstance(normal.solution, int) or _believed(problem, here, normal.used) < BELIEVED:
        return None
    return Marginals(normal.solution, normal.eliminated).factors


def _problem(prepared: Prepared, states: Float[np.ndarray, "k m"], ids: Int[np.ndarray, " L"]) -> Problem:
    """With the estimators' own prior, whose pose is the true one."""
    layout, prior = prepared.process.layout, prepared.start.prior
    mean = prior.mean.copy()
    for block in set(layout.blocks).intersection(POSE_BLOCKS):
        mean[layout.mean_slice(block)] = states[0, layout.mean_slice(block)]
    kernel, own = Gate(GATE, GATE), FirstStatePrior(mean, prior.std)
    return problem_of(prepared.process, prepared.timeline, ids, own, SIGHTINGS_NEEDED, kernel)


def _landmarks(
    prepared: Prepared, states: Float[np.ndarray, "k m"]
) -> tuple[Int[np.ndarray, " L"], Float[np.ndarray, "L 3"]]:
    """Ids and first guesses in g: of the start, or where most of a landmark's sightings agree from the true poses."""
    if not prepared.start.has_landmarks:
        return NO_LANDMARKS, np.zeros((0, 3))
    started = prepared.start
    ids = np.unique(seen_ids(prepared.timeline))
    points = np.full((len(ids), 3), np.nan)
    points[np.searchsorted(ids, started.ids)] = started.points
    new = ids[np.isnan(points[:, 0])]
    sightings = collect_sightings(prepared.timeline, new, SIGHTINGS_NEEDED)
    nothing = np.zeros(len(sightings), dtype=bool)
    found = revived(sightings, states, np.full((len(new), 3), np.nan), nothing, GATE)
    if found is not None:
        points[np.searchsorted(ids, new)] = found
    placed = np.isfinite(points).all(axis=1)
    return ids[placed], points[placed]


def _believed(problem: Problem, here: Point, used: Bool[np.ndarray, " N"] | None) -> float:
    """Share of the measurements that count; 0 where there are none."""
    flags = [problem.motion.believed(sensor, here.trajectory) for sensor in problem.motion.sensors]
    flags += [] if used is None else [used]
    counts = np.concatenate([np.zeros(0, dtype=bool), *flags])
    return float(counts.mean()) if len(counts) else 0.0


def _is_tied(prepared: Prepared) -> bool:
    return prepared.start.has_landmarks
