"""Result of an initialisation: the smoothed first epochs, with a map where landmarks were unknown."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.estimators.landmarks.belief import LandmarkBelief
from spinfilters.estimators.landmarks.landmark_options import LandmarkOptions
from spinfilters.estimators.smoothing.joint_belief import joint_belief
from spinfilters.estimators.smoothing.linear.marginals import Marginals
from spinfilters.estimators.smoothing.problem.least_squares import InitialGuess
from spinfilters.estimators.smoothing.state_prior import FirstStatePrior
from spinfilters.models.gauge import GAUGE_DIM
from spinfilters.models.measurement import MeasurementModel
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import StateLayout
from spinfilters.state.status import EstimatorStatus, Verdict


@dataclass(frozen=True)
class InitialEstimate:
    """The most probable motion of the first k epochs and the L landmarks that are unknowns.

    Attributes
    ----------
    prior: of the first epoch's state.
    mean: (k, m).   factor: (k, n, n) of each epoch's covariance given all of them; not finite where there is none.
    cost: sum of squared whitened residuals about the mean, prior and dynamics included.
    dof: scalar observations that count, less three per landmark: what the least cost is expected to be.
    accepted, rejected: observations that count, and that do not.   used: per epoch, which of its landmark observations count.
    refused: (r,) of each sensor without landmarks, in the order of time, which of its measurements do not count.
    ids: (L,) landmarks that at least two inliers observe; empty where a map is known or there is none.
    points: (L, 3) m, frame g.   counts: (L,) inliers of each.
    marginals: covariances of everything, or None where some direction is not determined.
    momentum_residual: how far the initial guess's angular momentum was from constant (relative rms).
    noise_ratio: standard deviation of the observations over the stated, from the initial guess; None where it does not tell.
    departure: of a filter from the smoother of the same measurements, in standard deviations; zero where none was tried.
    status: whether it can be trusted, with reasons.
    guess: that it was smoothed from, whose landmarks are all that the first epochs show; None where it is not known.
    is_annealed_too: whether an annealed smoothing would have taken the same steps.
    rivals: other optima of the same epochs, less likely at this noise; () where there are none or none was looked for.
    """

    layout: StateLayout
    prior: FirstStatePrior
    mean: Float[np.ndarray, "k m"]
    factor: Float[np.ndarray, "k n n"]
    cost: float
    dof: int
    accepted: int
    rejected: int
    iterations: int
    converged: bool
    used: tuple[Bool[np.ndarray, " _"], ...] = ()
    refused: Mapping[MeasurementModel, Bool[np.ndarray, " _"]] = field(default_factory=dict)
    ids: Int[np.ndarray, " L"] = field(default_factory=lambda: np.zeros(0, dtype=int))
    points: Float[np.ndarray, "L 3"] = field(default_factory=lambda: np.zeros((0, 3)))
    counts: Int[np.ndarray, " L"] = field(default_factory=lambda: np.zeros(0, dtype=int))
    marginals: Marginals | None = None
    momentum_residual: float = np.nan
    noise_ratio: float | None = None
    departure: float = 0.0
    status: EstimatorStatus = field(default_factory=EstimatorStatus)
    guess: InitialGuess | None = None
    is_annealed_too: bool = False
    rivals: tuple["InitialEstimate", ...] = ()

    @classmethod
    def failed(cls, layout: StateLayout, epochs: int, reason: str) -> "InitialEstimate":
        """Failed estimate, of which no number is finite."""
        mean = np.full((epochs, layout.mean_dim), np.nan)
        prior = FirstStatePrior(mean[0], np.full(layout.error_dim, np.nan))
        factor = np.full((epochs, layout.error_dim, layout.error_dim), np.nan)
        status = EstimatorStatus().failed(
            f"the first epochs could not be smoothed ({reason})", "not-initialised"
        )
        return cls(layout, prior, mean, factor, np.nan, 0, 0, 0, 0, converged=False, status=status)

    @property
    def has_landmarks(self) -> bool:
        """Whether landmarks are unknowns."""
        return len(self.used) > 0

    @property
    def has_failed(self) -> bool:
        """Whether nothing of it is finite."""
        return self.status.verdict is Verdict.FAILED

    @property
    def fit(self) -> float:
        """Root mean square of the whitened residuals: 1 when noise and model are right."""
        return float(np.sqrt(self.cost / max(self.dof, 1)))

    @property
    def belief(self) -> Gaussian:
        """Belief of the state at the last epoch."""
        return Gaussian(self.layout, self.mean[-1], self.factor[-1])

    def hits(self, ids: Int[np.ndarray, " q"]) -> Int[np.ndarray, " q"]:
        """Number of inlier observations of each landmark; 0 for one that is no unknown."""
        where = np.clip(np.searchsorted(self.ids, ids), 0, max(len(self.ids) - 1, 0))
        return np.where(self.ids[where] == ids, self.counts[where], 0)

    def joint_belief(self, options: LandmarkOptions) -> Gaussian | LandmarkBelief:
        """Joint belief of the last state and all landmarks; not finite where unavailable."""
        if not self.has_landmarks:
            return self.belief
        if self.marginals is not None:
            return joint_belief(self.marginals, self.mean[-1], self.ids, self.points, options)
        n, roots = self.layout.error_dim, np.full((len(self.ids), 3, 3), np.nan)
        factor, move = np.full((n + 1, n + 1), np.nan), np.zeros(GAUGE_DIM)
        shared = roots[:, :, :1]
        return LandmarkBelief(self.layout, self.mean[-1], self.ids, self.points, shared, roots, factor, move)
