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
    """Squared Mahalanobis distance per component, the two covariances added.

    Small for estimates from shared measurements. Errors of both are told about the one.
    """
    d = one.layout.local(one.mean, other.mean)
    factor = np.hstack([one.factor, np.linalg.solve(one.layout.reset_jacobian(d), other.factor)])
    scale = np.linalg.norm(factor, axis=1)
    factor /= scale[:, np.newaxis]
    return float((d / scale) @ np.linalg.solve(factor @ factor.T, d / scale)) / len(d)
