"""Sigma points of the unscented filters."""

from dataclasses import dataclass
from functools import cache
from typing import Annotated

import numpy as np
from jaxtyping import Float

from spinfilters.data.stated_values import NumberRange
from spinfilters.errors import InputError


@dataclass(frozen=True)
class SigmaPointOptions:
    """Options of Van der Merwe's scaled sigma points.

    No covariance weight may be negative: with beta = 2 that asks for alpha >= 0.518.
    """

    alpha: Annotated[float, NumberRange(1e-3, 1e3)] = 0.6
    beta: Annotated[float, NumberRange(0, 1e6)] = 2.0
    kappa: Annotated[float, NumberRange(-10, 1e6)] = 0.0

    def points(self, n: int) -> "SigmaPoints":
        """The set over n coordinates: the mean, then the two ends of each axis.

        The numbers are filterpy's; its import would bring all of `scipy.stats` along.

        Raises
        ------
        InputError: when a covariance weight is negative, with which a covariance could become indefinite.
        """
        scaling = self.alpha**2 * (n + self.kappa) - n  # lambda
        square = n + scaling  # of the distance of a point
        mean_weights = np.full(2 * n + 1, 0.5 / square)
        weights = mean_weights.copy()
        mean_weights[0] = scaling / square
        weights[0] = mean_weights[0] + (1 - self.alpha**2 + self.beta)
        if np.min(weights) < 0:
            raise InputError(
                f"sigma points with alpha={self.alpha}, beta={self.beta} have a covariance weight of {np.min(weights):.3g}"
                "; choose alpha >= 0.518 with beta = 2 so that covariances stay positive"
            )
        axes = np.sqrt(square) * np.eye(n)
        offsets = np.concatenate([np.zeros((1, n)), axes, 0.0 - axes])
        return SigmaPoints(offsets, mean_weights, np.sqrt(weights))


@dataclass(frozen=True)
class SigmaPoints:
    """A sigma-point set over n coordinates y.

    Attributes
    ----------
    offsets: (p, n).   mean_weights: (p,).   root_weights: (p,) square roots of the covariance weights.
    """

    offsets: Float[np.ndarray, "p n"]
    mean_weights: Float[np.ndarray, " p"]
    root_weights: Float[np.ndarray, " p"]

    def regressed(
        self, deviations: Float[np.ndarray, "*batch r p"]
    ) -> tuple[Float[np.ndarray, "*batch r n"], Float[np.ndarray, "*batch r p"]]:
        """Statistical regression of weighted deviations on y.

        (A, B) with covariance A A' + B B': A is the regression, B the residual.
        """
        weighted = (deviations * self.root_weights).reshape(
            -1, len(self.root_weights)
        )  # one product is faster than many
        scaled = self.offsets * self.root_weights[:, None]
        slope = weighted @ scaled
        left, batch = weighted - slope @ scaled.T, deviations.shape[:-1]
        return slope.reshape(*batch, slope.shape[1]), left.reshape(*batch, left.shape[1])


@cache
def sigma_points(n: int, options: SigmaPointOptions) -> SigmaPoints:
    """The set over n coordinates. InputError as `SigmaPointOptions.points`."""
    return options.points(n)
