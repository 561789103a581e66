"""Errors over a common span of epochs.

Estimators are compared over the same ones, and a filter over its own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.trajectory_errors import RmsErrors

ALWAYS: Final = -np.inf
"""Begin of a span that leaves nothing out, s."""


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
