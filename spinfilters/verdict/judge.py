"""The verdict on one estimate, a loop over the checks, and what still holds of it: each quantity ok, doubtful or undetermined."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.attitude_conversions import rotation_between
from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.evaluation.estimated_motion import trajectory_of
from spinfilters.filters.history import EstimateHistory, history_at
from spinfilters.models.body import UNDETERMINED_STD, BodyEstimate, body_estimate, turn_of_axes
from spinfilters.models.status import (
    ALL,
    ATTITUDE,
    AXES,
    CENTRE,
    MOMENTS,
    NOTHING,
    POSITION,
    QUANTITIES,
    RATE,
    VELOCITY,
    EstimatorStatus,
    Finding,
    Holds,
    Verdict,
)
from spinfilters.verdict.checks import BY_NAME, CHECKS, LARGEST_MOMENT_STD, Evidence, base_name, check_of
from spinfilters.verdict.model_errors.score_tests import ScoreTest

LARGEST_ANGLE_STD: Final = 0.5
"""Of an attitude or a principal axis, rad: beyond it its direction is not known; of nothing known it is `UNDETERMINED_STD`."""
LARGEST_SHARE: Final = 0.5
"""Of a deviation to the size of what it is about (the rate; the path, its length and its distance; the centre's prior)."""

MOST_EPOCHS: Final = 200
"""Of an estimate that are looked at."""

assert LARGEST_ANGLE_STD < UNDETERMINED_STD


def holding(evidence: Evidence, status: EstimatorStatus) -> dict[str, Holds]:
    """Whether each quantity holds, given the findings; nothing of a failed estimate does."""
    if status.verdict is Verdict.FAILED:
        return dict.fromkeys(QUANTITIES, Holds.NOT_DETERMINED)
    determined = determined_quantities(evidence)
    holds = {name: Holds.OK if name in determined else Holds.NOT_DETERMINED for name in QUANTITIES}
    for found in status.findings:
        check = check_of(found)
        for name in check.about if found.about is None else found.about:
            # what a finding is about beyond its check follows from what is not determined, and is doubtful
            state = check.leaves if name in check.about or not check.about else Holds.DOUBTFUL
            if state is Holds.NOT_DETERMINED or holds[name] is Holds.OK:
                holds[name] = state
    return holds


def determined_quantities(evidence: Evidence) -> frozenset[str]:
    """Quantities whose stated deviation, the largest of its components, is small enough to mean something.

    Of what moves the median over the estimator's own epochs counts, of what is constant the last epoch.
    """
    evaluation = evidence.evaluation
    body, motion = evaluation.body, trajectory_of(some_epochs(evaluation.history))
    duration = float(motion.time[-1] - motion.time[0]) if len(motion.time) > 1 else 0.0
    rate = float(np.median(np.linalg.norm(motion.rate_i, axis=1)))
    reached = float(np.max(np.linalg.norm(motion.position, axis=1)))
    rate_std, velocity_std = _typical(motion.std_rate), _typical(motion.std_velocity)
    found = {
        ATTITUDE: _typical(motion.std_attitude) < LARGEST_ANGLE_STD,
        # a body at rest is known to be so where it cannot have turned meanwhile
        RATE: rate_std < LARGEST_SHARE * rate or rate_std * duration < LARGEST_ANGLE_STD,
        MOMENTS: float(np.max(body.principal_moments_std)) <= LARGEST_MOMENT_STD,
        AXES: float(np.max(body.principal_axes_std)) < LARGEST_ANGLE_STD,
    }
    if motion.sees_position:
        found[POSITION] = _typical(motion.std_position) < LARGEST_SHARE * reached
        length = float(np.median(np.linalg.norm(motion.velocity, axis=1))) * duration
        found[VELOCITY] = velocity_std * duration < LARGEST_SHARE * max(reached, length)
    if body.center_of_mass_std is not None:
        found[CENTRE] = float(np.max(body.center_of_mass_std)) < LARGEST_SHARE * evidence.centre_prior_std
    return frozenset(name for name, known in found.items() if known) & ALL


def some_epochs(history: EstimateHistory) -> EstimateHistory:
    """A history of at most `MOST_EPOCHS` of the estimator's own epochs, evenly spread, the last among them."""
    return history_at(history, own_rows(history))


def own_rows(history: EstimateHistory) -> Int[np.ndarray, " k"]:
    """Indices of these epochs."""
    last = len(history.time) - 1
    return np.unique(np.linspace(min(history.initialisation, last), last, MOST_EPOCHS).round().astype(int))


def _typical(std: Float[np.ndarray, "n 3"]) -> float:
    """Median over the epochs of the largest component; infinite where it is not finite."""
    value = float(np.median(std.max(axis=1)))
    return value if np.isfinite(value) else float("inf")


def judge(evidence: Evidence) -> EstimatorStatus:
    """Status of an estimate: certain causes, its own findings, then those of every check, and what still holds.

    An estimate is ``failed`` where it says so, or where its moments are not finite; any other finding makes it ``degraded``.
    """
    evaluation = evidence.evaluation
    status = evaluation.history.status
    if not np.isfinite(evaluation.body.principal_moments_std).all() and status.verdict is not Verdict.FAILED:
        status = status.failed("the moments of inertia at the end are not finite")
    status = replace(status, findings=tuple(_with_cure(each) for each in status.findings))
    for each in findings_of(evidence):
        status = status.doubted(each)
    status = replace(status, findings=_causes_first(status.findings))
    return replace(status, holds=holding(evidence, status))


def _causes_first(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Findings with certain causes at the front, and without the cures of what may follow from these.

    Such a cure ("raise process.torque_psd") would hide the cause. A cause reaches the findings that are about its quantities alone.
    """
    causes = [each for each in findings if check_of(each).is_cause]
    reached = frozenset[str]().union(*map(_quantities_of, causes))
    others = [each for each in findings if each not in causes]
    follows = [check_of(each).may_follow and _quantities_of(each) <= reached for each in others]
    without = [replace(each, cure="") if gone else each for each, gone in zip(others, follows, strict=True)]
    return (*causes, *(without if causes else others))


def _quantities_of(found: Finding) -> frozenset[str]:
    return check_of(found).about if found.about is None else found.about


def findings_of(evidence: Evidence) -> Iterator[Finding]:
    """Findings of all checks, in their order; those of names that are not in the list at the end."""
    for check in CHECKS:
        yield from (_with_cure(each) for each in evidence.found if base_name(each.check) == check.name)
        if check.test is not None and check.needs in evidence.present:
            yield from (check.finding(each.numbers, each.about) for each in check.test(evidence))
    yield from (each for each in evidence.found if base_name(each.check) not in BY_NAME)


def _with_cure(found: Finding) -> Finding:
    """A finding whose words were written where it arose, with the cure of its check."""
    return found if found.cure or found.numbers else replace(found, cure=check_of(found).cure)


@dataclass(frozen=True)
class QuantityDifference:
    """Another estimate minus one, in a quantity's own units.

    Attributes
    ----------
    away : (n, c) float array
        Difference at n epochs; at the last epoch alone of what is constant.
    std, other_std : (n, c) float arrays
        Standard deviations of the one and of the other.
    """

    away: Float[np.ndarray, "n c"]
    std: Float[np.ndarray, "n c"]
    other_std: Float[np.ndarray, "n c"]

    @property
    def largest(self) -> float:
        """Largest difference in deviations of the one; infinite where a difference or a deviation is not a number."""
        value = float(np.max(np.abs(self.away) / np.where(self.std == 0, np.inf, self.std)))
        return value if np.isfinite(value) else float("inf")

    @property
    def expected_squares(self) -> Float[np.ndarray, "n c"]:
        """Squared errors that the one is expected to have in its deviations, with the other as the truth."""
        squares = (self.away**2 + self.other_std**2) / np.where(self.std > 0, self.std, np.nan) ** 2
        return np.where(np.isfinite(squares), squares, np.inf)


def quantity_differences(one: EstimateHistory, other: EstimateHistory) -> dict[str, QuantityDifference]:
    """Differences of two histories of the same epochs and layout, by quantity."""
    a, b = trajectory_of(one), trajectory_of(other)
    turn = rotation_between(a.q_ig, b.q_ig)
    found = {
        ATTITUDE: QuantityDifference(turn, a.std_attitude, b.std_attitude),
        RATE: QuantityDifference(b.rate_i - a.rate_i, a.std_rate, b.std_rate),
    }
    if a.sees_position:
        found[POSITION] = QuantityDifference(b.position - a.position, a.std_position, b.std_position)
        found[VELOCITY] = QuantityDifference(b.velocity - a.velocity, a.std_velocity, b.std_velocity)
    return found | _of_body(body_estimate(one.belief(-1)), body_estimate(other.belief(-1)))


def _of_body(one: BodyEstimate, other: BodyEstimate) -> dict[str, QuantityDifference]:
    turn = turn_of_axes(one.principal_axes_g, other.principal_axes_g)
    found = {
        MOMENTS: _constant(other.shape - one.shape, one.shape_std, other.shape_std),
        AXES: _constant(turn, one.principal_axes_std, other.principal_axes_std),
    }
    centres = one.center_of_mass_g, one.center_of_mass_std, other.center_of_mass_g, other.center_of_mass_std
    here, here_std, there, there_std = centres
    if here is not None and here_std is not None and there is not None and there_std is not None:
        found[CENTRE] = _constant(there - here, here_std, there_std)
    return found


def _constant(
    away: Float[np.ndarray, " c"], std: Float[np.ndarray, " c"], other_std: Float[np.ndarray, " c"]
) -> QuantityDifference:
    return QuantityDifference(away[np.newaxis], std[np.newaxis], other_std[np.newaxis])


LARGEST_MOVE: Final = 1.0
"""Of a quantity that still holds, in its deviations. An error that is normal about a mean of one deviation is beyond four with a
probability of 0.13 %; the size of the error is not known better than its own deviation, which `SIZE_STD` allows for."""
SIZE_STD: Final = 2.0
"""Deviations of an error's size by which it may be larger than it seems."""
LINEAR: Final = 30.0
"""Deviations by which any component of the state moves, beyond which the linearised motion does not describe what an error does."""


def unmoved_quantities(history: EstimateHistory, test: ScoreTest) -> frozenset[str]:
    """Quantities of an estimate that removing an error moves by less than `LARGEST_MOVE`.

    None where the shift is too large for a linearisation, or not known at all epochs: models are tested in the first ones of a
    long recording, and what an error moves little there it may move far behind them.
    """
    shift = test.shift
    if shift is None or not np.isfinite(shift).all() or len(shift) != len(history.time):
        return NOTHING
    larger = 1.0 + SIZE_STD * test.magnitude_std / max(test.magnitude, np.finfo(float).tiny)
    try:
        moved = moved_quantities(history, shift)
    except (InputError, *NUMERICAL_ERRORS):  # a shift that leads to no state
        return NOTHING
    if not max(moved.values()) <= LINEAR:
        return NOTHING
    return frozenset(name for name in ALL if larger * moved.get(name, 0.0) <= LARGEST_MOVE)


def moved_quantities(history: EstimateHistory, shift: Float[np.ndarray, "k n"]) -> dict[str, float]:
    """Largest movement of every quantity over components and the first k epochs, in its deviations.

    Of what is constant that of the last of these epochs.
    """
    here = history_at(history, np.arange(len(shift)))
    with np.errstate(all="ignore"):
        there = replace(here, mean=here.layout.retract(here.mean, shift))
        return {name: each.largest for name, each in quantity_differences(here, there).items()}
