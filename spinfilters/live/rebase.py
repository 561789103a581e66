"""A filter put on a smoothed state, with the map that it had."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from spinfilters.attitude.conversions import mrp_from_quaternion
from spinfilters.embedded.estimator import EmbeddedFilter
from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Estimator
from spinfilters.estimators.filters.multiplicative_filter import MultiplicativeFilter
from spinfilters.estimators.filters.square_root_update import triangular_factor
from spinfilters.estimators.landmarks.belief import LandmarkBelief, state_in_g
from spinfilters.geometry.absolute_orientation import absolute_orientation
from spinfilters.models.gauge import GAUGE_DIM
from spinfilters.state.gaussian import Gaussian

FEWEST_COMMON = 6
"""Landmarks that filter and smoother must share for their frames to be compared."""


@dataclass(frozen=True)
class HandOver:
    """What the smoother says of an epoch.

    Attributes
    ----------
    time: s.   state: in the smoother's frame g.   ids: (k,).   points: (k, 3) m, frame g.   verdict: of the smoother's status.
    """

    time: float
    state: Gaussian
    ids: Int[np.ndarray, " k"]
    points: Float[np.ndarray, "k 3"]
    verdict: str = "ok"

    @property
    def is_finite(self) -> bool:
        """Whether mean and covariance can be used."""
        state = self.state
        return bool(
            np.isfinite(state.mean).all() and np.isfinite(state.factor).all() and (state.std > 0).all()
        )


def rebase(estimator: Estimator, given: HandOver) -> None:
    """Begin a filter anew from a hand-over of its present time.

    The landmarks that it holds stay; the state is told in their frame. Its own errors and theirs are independent from then on, as
    those of a light filter without shared modes always are.

    Raises
    ------
    InputError: too few common landmarks to tell the one frame in the other.
    """
    held = landmarks_of(estimator)
    if held is None or not isinstance(estimator, EmbeddedFilter | MultiplicativeFilter):
        estimator.start(given.state)
        return
    n, layout = held.layout.error_dim, held.layout
    mean, _ = state_in_g(layout, given.state.mean, np.zeros((n + GAUGE_DIM, 1)), _move(given, held))
    factor = np.zeros_like(held.factor)
    factor[:n, :n] = given.state.factor
    factor[n:, n:] = triangular_factor(held.factor[n:].T)
    estimator.start(replace(held, mean=mean, factor=factor))


def landmarks_of(estimator: Estimator) -> LandmarkBelief | None:
    """State and landmarks of a filter that holds some, None otherwise."""
    if not isinstance(estimator, EmbeddedFilter | MultiplicativeFilter):
        return None
    if isinstance(estimator, MultiplicativeFilter) and not len(estimator.held):
        return None
    belief = estimator.landmark_belief
    return belief if len(belief.ids) else None


def distance(one: Gaussian, other: Gaussian) -> float:
    """Squared Mahalanobis distance per component, the two covariances added: small for estimates from shared measurements."""
    d = one.layout.local(one.mean, other.mean)
    scale = np.sqrt(one.std**2 + other.std**2)
    P = (one.covariance + other.covariance) / np.outer(scale, scale)
    return float((d / scale) @ np.linalg.solve(P, d / scale)) / len(d)


def _move(given: HandOver, held: LandmarkBelief) -> Float[np.ndarray, " 6"]:
    """From the smoother's frame g to the frame of the filter's map."""
    _, ours, theirs = np.intersect1d(held.ids, given.ids, return_indices=True)
    if len(ours) < FEWEST_COMMON:
        raise InputError(f"filter and smoother share {len(ours)} landmarks, {FEWEST_COMMON} are needed")
    weights = 1 / np.einsum("kij,kij->k", held.roots[ours], held.roots[ours])
    q, t = absolute_orientation(held.points[ours], given.points[theirs], weights / weights.max())
    return np.concatenate([np.asarray(mrp_from_quaternion(q)).reshape(3), t])
