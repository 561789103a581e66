"""A filter put on a smoothed past: state and landmarks with their joint covariance."""

from dataclasses import dataclass, replace

import numpy as np

from spinfilters.embedded.embedded_estimator import EmbeddedFilter
from spinfilters.estimators.estimator import Estimator
from spinfilters.estimators.filters.multiplicative_filter import MultiplicativeFilter
from spinfilters.estimators.landmarks.belief import LandmarkBelief
from spinfilters.state.gaussian import Gaussian


@dataclass(frozen=True)
class HandOver:
    """What the smoother says of an epoch.

    Attributes
    ----------
    time: s.   belief: of the state, with landmarks where it holds some.   verdict: of the smoother's status.
    """

    time: float
    belief: Gaussian | LandmarkBelief
    verdict: str = "ok"

    @property
    def state(self) -> Gaussian:
        """Of the epoch, frame g."""
        return self.belief if isinstance(self.belief, Gaussian) else self.belief.state

    @property
    def is_finite(self) -> bool:
        """Whether means and covariances can be used."""
        arrays = [self.belief.mean, self.belief.factor]
        if isinstance(self.belief, LandmarkBelief):
            arrays += [self.belief.points, self.belief.modes, self.belief.roots]
        return all(np.isfinite(array).all() for array in arrays) and bool((self.state.std > 0).all())


def rebase(estimator: Estimator, given: HandOver) -> None:
    """Begin a filter anew from a hand-over of its present time.

    As it begins from an initialisation.
    Landmarks that only the filter holds go: what told them has told the smoother's state too, and nobody knows how their errors
    depend on one another.
    """
    if isinstance(estimator, MultiplicativeFilter):
        belief = given.belief
        if isinstance(belief, LandmarkBelief):
            belief = with_modes(belief, estimator.mode_count)
        estimator.take_belief(belief)
    elif isinstance(estimator, EmbeddedFilter):
        estimator.start(given.belief)
    else:
        estimator.start(given.state)


def with_modes(belief: LandmarkBelief, rank: int) -> LandmarkBelief:
    """The belief padded to at least so many modes."""
    n, r = belief.layout.error_dim, belief.modes.shape[2]
    more = max(rank - r, 0)
    modes = np.pad(belief.modes, [(0, 0), (0, 0), (0, more)])
    place = np.r_[0 : n + r, n + r + more : len(belief.factor) + more]
    factor = np.eye(len(belief.factor) + more)
    factor[np.ix_(place, place)] = belief.factor
    return replace(belief, modes=modes, factor=factor)


def distance(one: Gaussian, other: Gaussian) -> float:
    """Squared Mahalanobis distance per component, the two covariances added: small for estimates from shared measurements."""
    d = one.layout.local(one.mean, other.mean)
    scale = np.sqrt(one.std**2 + other.std**2)
    P = (one.covariance + other.covariance) / np.outer(scale, scale)
    return float((d / scale) @ np.linalg.solve(P, d / scale)) / len(d)
