"""Quantities that an error of the models moves, in stated standard deviations.

Once an error is removed, the states of all epochs move by a shift that its score test gives (`ScoreTest.shift`). The quantities
that are published follow from states moved so, and their movement over their own deviations is the error that the models have put
into them.
"""

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.errors import NUMERICAL_ERRORS, InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.model_errors.score_test import ScoreTest
from spinfilters.state.quantities import ALL, NOTHING
from spinfilters.verdict.holding import history_at
from spinfilters.verdict.quantity_differences import quantity_differences

LARGEST_MOVE: Final = 1.0
"""Of a quantity that still holds, in its deviations. An error that is normal about a mean of one deviation is beyond four with a
probability of 0.13 %; the size of the error is not known better than its own deviation, which `SIZE_STD` allows for."""
SIZE_STD: Final = 2.0
"""Deviations of an error's size by which it may be larger than it seems."""
LINEAR: Final = 30.0
"""Deviations by which any component of the state moves, beyond which the linearised motion does not tell what an error does."""


def unmoved_quantities(history: EstimateHistory, test: ScoreTest) -> frozenset[str]:
    """Quantities of an estimate that removing an error moves by less than `LARGEST_MOVE`.

    None where the shift is too large for a linearisation, or not known at all epochs: models are tested in the first ones of a
    long recording, and what an error moves little there it may move far behind them.
    """
    shift = test.shift
    if shift is None or not np.isfinite(shift).all() or len(shift) != len(history.time):
        return NOTHING
    size = float(np.linalg.norm(test.size))
    std = float(np.sqrt(test.std**2 @ test.size**2)) / max(size, np.finfo(float).tiny)
    larger = 1.0 + SIZE_STD * std / max(size, np.finfo(float).tiny)
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
