"""Prediction of a belief beyond the last measurement.

The covariance grows by the motion and its disturbances.
Step by step, with the transition F of the multiplicative error and the noise Q = G G' of `ProcessModel.linearise`,

    P+ = F P F' + Q,   P = L L',   L+ = triangular factor of [F L, G],

so that no covariance can become indefinite. A step starts at the point that the step before ended at, whose error is its own.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import ProcessModel
from spinfilters.estimators.filters.square_root_update import triangular_factor
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import StateLayout


@dataclass(frozen=True)
class Prediction:
    """Beliefs at times ahead.

    Attributes
    ----------
    times: (k,) s ahead of the belief that was carried on.   mean: (k, m).   factor: (k, n, n), P = factor factor'.
    """

    layout: StateLayout
    times: Float[np.ndarray, " k"]
    mean: Float[np.ndarray, "k m"]
    factor: Float[np.ndarray, "k n n"]

    def belief(self, index: int) -> Gaussian:
        """The predicted belief at the time of this index."""
        return Gaussian(self.layout, self.mean[index], self.factor[index])


def predict_ahead(process: ProcessModel, belief: Gaussian, dt: Float[np.ndarray, " k"]) -> Prediction:
    """Carry a belief on.

    Parameters
    ----------
    dt: seconds ahead of the belief, positive and increasing; every one is a step from the one before, the first from the belief.

    Raises
    ------
    InputError: times that are none, not finite, not ahead or not increasing.
    """
    gaps = np.diff(dt, prepend=0.0)
    if not (len(dt) and np.isfinite(dt).all() and (gaps > 0).all()):
        raise InputError(f"times ahead are {dt.tolist()} s; give positive and increasing ones")
    mean, factor = zip(*_steps(process, belief, gaps), strict=True)
    return Prediction(belief.layout, dt, np.array(mean), np.array(factor))


def _steps(
    process: ProcessModel, belief: Gaussian, gaps: Float[np.ndarray, " k"]
) -> Iterator[tuple[Float[np.ndarray, " m"], Float[np.ndarray, "n n"]]]:
    mean, factor = belief.mean, belief.factor
    for gap in gaps:
        mean, transition, noise = process.linearise(mean, float(gap))
        factor = triangular_factor(np.concatenate([(transition @ factor).T, noise.T]))
        yield mean, factor
