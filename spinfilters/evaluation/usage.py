"""Numbers of observations that each estimator uses.

Those that hold landmarks may hold a part of them only.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.span import shared_begin

IDENTICAL = "Estimators on identical measurements"
NOT_IDENTICAL = "Estimators on the same recording, each on the observations that it used"


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
