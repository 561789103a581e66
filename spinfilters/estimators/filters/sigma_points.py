"""Sigma points of the unscented filters."""

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Annotated

import numpy as np
from jaxtyping import Float

from spinfilters.data.stated_values import NumberRange
from spinfilters.errors import InputError

if TYPE_CHECKING:
    from filterpy.kalman import MerweScaledSigmaPoints


@dataclass(frozen=True)
class SigmaPointOptions:
    """Options of Van der Merwe's scaled sigma points.

    No covariance weight may be negative: with beta = 2 that asks for alpha >= 0.518.
    """

    alpha: Annotated[float, NumberRange(1e-3, 1e3)] = 0.6
    beta: Annotated[float, NumberRange(0, 1e6)] = 2.0
    kappa: Annotated[float, NumberRange(-10, 1e6)] = 0.0

    def points(self, n: int) -> "MerweScaledSigmaPoints":
        """filterpy's set over n coordinates.

        Raises
        ------
        InputError: when a covariance weight is negative, with which a covariance could become indefinite.
        """
        # slow to import, and settings alone need none of it
        from filterpy.kalman import MerweScaledSigmaPoints

        points = MerweScaledSigmaPoints(n, self.alpha, self.beta, self.kappa)
        if np.min(points.Wc) < 0:
            raise InputError(
                f"sigma points with alpha={self.alpha}, beta={self.beta} have a covariance weight of {np.min(points.Wc):.3g}"
                "; choose alpha >= 0.518 with beta = 2 so that covariances stay positive"
            )
        return points


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
    merwe = options.points(n)
    return SigmaPoints(merwe.sigma_points(np.zeros(n), np.eye(n)), merwe.Wm, np.sqrt(merwe.Wc))
