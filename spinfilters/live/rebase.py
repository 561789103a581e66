"""A filter put on a smoothed past: state and landmarks with their joint covariance."""

from dataclasses import dataclass

import numpy as np

from spinfilters.estimators.landmarks.belief import Belief
from spinfilters.state.gaussian import Gaussian


@dataclass(frozen=True)
class HandOver:
    """Smoothed belief of an epoch, handed over to the filter.

    Attributes
    ----------
    time: s.   belief: of the state, with landmarks where it holds some.   verdict: of the smoother's status.
    """

    time: float
    belief: Belief
    verdict: str = "ok"

    @property
    def state(self) -> Gaussian:
        """State of the epoch, frame g."""
        return self.belief.state

    @property
    def is_finite(self) -> bool:
        """Whether means and covariances can be used."""
        arrays = [self.belief.mean, self.belief.factor]
        joint = self.belief.joint
        if joint is not None:
            arrays += [joint.points, joint.modes, joint.roots]
        return all(np.isfinite(array).all() for array in arrays) and bool((self.state.std > 0).all())


def distance(one: Gaussian, other: Gaussian) -> float:
    """Squared Mahalanobis distance per component with both covariances added."""
    d = one.layout.local(one.mean, other.mean)
    scale = np.sqrt(one.std**2 + other.std**2)
    P = (one.covariance + other.covariance) / np.outer(scale, scale)
    return float((d / scale) @ np.linalg.solve(P, d / scale)) / len(d)
