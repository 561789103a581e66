"""Errors and used observations over a common span of epochs.

Estimators are compared over the same ones, and a filter over its own; those that hold landmarks may hold a part of them only.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Int

from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.trajectory_errors import RmsErrors

ALWAYS: Final = -np.inf
"""Begin of a span that leaves nothing out, s."""
IDENTICAL = "Estimators on identical measurements"
NOT_IDENTICAL = "Estimators on the same recording, each on the observations that it used"


@dataclass(frozen=True)
class SpanErrors:
    """Errors of a span of epochs.

    Attributes
    ----------
    epochs: how many have a truth.   rms: of the errors.   bound: in their place, None where there is none.
    nees, nees_blocks: mean NEES per degree of freedom, of the whole state and by block; None and empty without any.
    """

    epochs: int
    rms: RmsErrors
    bound: RmsErrors | None
    nees: float | None
    nees_blocks: Mapping[str, float]


def span_errors(evaluation: Evaluation, begin: float, end: float = np.inf) -> SpanErrors | None:
    """Errors from begin to end (s), both within; None without a truth there."""
    errors = None if evaluation.errors is None else evaluation.errors.within(begin, end)
    if errors is None:
        return None
    nees = None if evaluation.nees is None else evaluation.nees.within(begin, end)
    return SpanErrors(
        len(errors.time),
        errors.rms,
        None if evaluation.bound is None else evaluation.bound.over(errors.rows),
        None if nees is None else nees.mean,
        {} if nees is None else nees.block_means,
    )


def shared_begin(evaluations: Sequence[Evaluation]) -> float:
    """Time of the first own epoch common to all estimators that have any, s.

    It is `ALWAYS` where none has.
    """
    begins = [evaluation.own_begin for evaluation in evaluations]
    return max((begin for begin in begins if begin is not None), default=ALWAYS)


def initialisation_end(evaluations: Sequence[Evaluation]) -> float | None:
    """Time of the last epoch of the filters' initialisation, s; None where no estimator has one."""
    ends = [evaluation.history.initialisation_end for evaluation in evaluations]
    return max((end for end in ends if end is not None), default=None)


def middle(evaluation: Evaluation) -> float:
    """Middle of the recording, s: behind it nothing of the beginning shows."""
    time = evaluation.history.time
    return float(time[0] + time[-1]) / 2


@dataclass(frozen=True)
class ObservationUse:
    """Numbers of used and unused observations of some epochs.

    Attributes
    ----------
    accepted, rejected: (n,) that were used, and that were refused.   available: (n,) all of them, None where not told.
    """

    accepted: Int[np.ndarray, " n"]
    rejected: Int[np.ndarray, " n"]
    available: Int[np.ndarray, " n"] | None

    @property
    def used_per_epoch(self) -> float:
        """Mean number of used observations per epoch."""
        return float(self.accepted.mean())

    @property
    def available_per_epoch(self) -> float | None:
        """Mean number of available observations per epoch; None if unknown."""
        return None if self.available is None else float(self.available.mean())

    @property
    def share(self) -> float | None:
        """Used share of the available observations, 0 to 1; None if unknown."""
        return None if self.available is None else float(self.accepted.sum() / max(self.available.sum(), 1))

    @property
    def uses_all(self) -> bool:
        """Whether every observation is known to have been used."""
        return self.available is not None and np.array_equal(self.accepted, self.available)


def observation_use(history: EstimateHistory, begin: float) -> ObservationUse | None:
    """Use of observations in the estimator's epochs from begin (s); None without any."""
    rows = np.flatnonzero(history.time >= begin)
    rows = rows[rows >= history.initialisation]
    if not rows.size:
        return None
    available = None if history.observations is None else history.observations[rows]
    return ObservationUse(history.accepted[rows], history.rejected[rows], available)


def on_identical_measurements(evaluations: Sequence[Evaluation]) -> bool:
    """Whether every estimator used every observation of the epochs that all of them have."""
    begin = shared_begin(evaluations)
    uses = [observation_use(evaluation.history, begin) for evaluation in evaluations]
    epochs = {len(use.accepted) for use in uses if use is not None}
    return len(epochs) == 1 and all(use is not None and use.uses_all for use in uses)


def title_sentences(evaluations: Sequence[Evaluation]) -> list[str]:
    """Title sentences of a comparison; empty for a single estimator."""
    if len(evaluations) == 1:
        return []
    return [IDENTICAL if on_identical_measurements(evaluations) else NOT_IDENTICAL]
