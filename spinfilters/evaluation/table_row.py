"""Row of the table of estimators, and the source of columns."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.span import ObservationUse, SpanErrors

DEGREE: Final = float(np.deg2rad(1.0))


@dataclass(frozen=True)
class Column:
    """Source of the cells of one column.

    Attributes
    ----------
    use, errors: over the epochs that all estimators have.   every: errors over all of this estimator's own, where these are more.
    """

    evaluation: Evaluation
    use: ObservationUse | None
    errors: SpanErrors | None
    every: SpanErrors | None


Cell = Callable[[Column], str | None]


@dataclass(frozen=True)
class TableRow:
    """A named row of the table, with cells of estimators and bound.

    None where there is nothing to show.
    """

    name: str
    cell: Cell
    bound: Cell = lambda _: None
