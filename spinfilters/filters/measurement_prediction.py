"""Prediction of measurements and of beliefs: to first order, or over sigma points.

The EKF predicts a measurement by its Jacobian, the UKF by statistical linear regression over sigma points.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.core.errors import InputError
from spinfilters.filters.estimator import Measurement, ProcessModel
from spinfilters.filters.filterpy_points import merwe_points
from spinfilters.filters.square_root import MeasurementPrediction, compressed, triangular_factor
from spinfilters.io.stated_values import NumberRange
from spinfilters.models.state_layout import Gaussian, StateLayout


@dataclass(frozen=True)
class LinearisedRows:
    """Whitened linearised innovations of a measurement's usable values. innovation = jacobian @ error[columns] + unit noise.

    Attributes
    ----------
    measurement : Measurement
        The values that are used.
    innovation : ndarray of float, shape (k, d)
        Whitened innovations.
    jacobian : ndarray of float, shape (k, d, c)
        With respect to the error's ``columns``.
    log_noise : ndarray of float, shape (k,)
        Log determinant of the factor by which each was whitened.
    root_weights : ndarray of float, shape (k,) or None
        Square roots of the weights that are in all this, None for 1.
    """

    measurement: Measurement
    innovation: Float[np.ndarray, "k d"]
    jacobian: Float[np.ndarray, "k d c"]
    columns: list[int] | slice
    log_noise: Float[np.ndarray, " k"]
    root_weights: Float[np.ndarray, " k"] | None = None

    @property
    def dof(self) -> int:
        """Number of scalar measurements."""
        return self.innovation.size

    def deviations(
        self, factor: Float[np.ndarray, "n r"], chosen: Bool[np.ndarray, " k"]
    ) -> Float[np.ndarray, "s d r"]:
        """Change of the chosen values per unit of y, where error = factor @ y."""
        return self.jacobian[chosen] @ factor[self.columns]

    def only(self, keep: slice | Bool[np.ndarray, " k"]) -> "LinearisedRows":
        """The chosen rows."""
        m = self.measurement
        return LinearisedRows(
            Measurement(m.model, m.values[keep], m.parameters[keep]),
            self.innovation[keep],
            self.jacobian[keep],
            self.columns,
            self.log_noise[keep],
            None if self.root_weights is None else self.root_weights[keep],
        )

    def weighted(self, weights: Float[np.ndarray, " k"]) -> "LinearisedRows":
        """Rows with their noise covariance divided by the weights. Those of weight 0 are left out."""
        used = weights > 0
        rows = self if used.all() else self.only(used)
        root = np.sqrt(weights[used])
        return rows if (root == 1).all() else rows._times(root)

    def _times(self, root: Float[np.ndarray, " k"]) -> "LinearisedRows":
        return replace(
            self,
            innovation=self.innovation * root[:, np.newaxis],
            jacobian=self.jacobian * root[:, np.newaxis, np.newaxis],
            log_noise=self.log_noise - self.innovation.shape[1] * np.log(root),
            root_weights=root if self.root_weights is None else root * self.root_weights,
        )

    def predicted(
        self, factor: Float[np.ndarray, "n r"], error: Float[np.ndarray, " n"] | None = None
    ) -> MeasurementPrediction:
        """Predicted innovations of a state whose error has a covariance factor and a mean, None for zero."""
        rho, jacobian = self.innovation.reshape(-1), self.jacobian.reshape(-1, self.jacobian.shape[2])
        if error is not None:
            rho = rho - jacobian @ error[self.columns]
        rho, H, residual = compressed(rho, jacobian)
        return MeasurementPrediction(
            rho, H @ factor[self.columns], factor, residual, self.dof, float(self.log_noise.sum())
        )


def linear_rows(measurement: Measurement, x: Float[np.ndarray, " m"]) -> LinearisedRows:
    """A measurement linearised at ``x``, its valid and finite values only."""
    model = measurement.model
    innovation, jacobian, valid, log_noise = model.linearise(x, measurement.parameters, measurement.values)
    rows = LinearisedRows(measurement, innovation, jacobian, _sliced(model.columns), log_noise)
    keep = usable(innovation, valid)
    return rows if np.count_nonzero(keep) == len(keep) else rows.only(keep)


def usable(values: Float[np.ndarray, "k r"], valid: Bool[np.ndarray, " k"]) -> Bool[np.ndarray, " k"]:
    """Mask of valid and finite innovations."""
    if np.count_nonzero(np.isfinite(values)) == values.size:  # the usual case, in a third of the time
        return valid
    return valid & np.isfinite(values).all(axis=-1)


def _sliced(columns: list[int]) -> list[int] | slice:
    """Increasing column numbers, as a slice where contiguous: indexing by a slice takes a third of the time."""
    first, last = columns[0], columns[-1]
    return slice(first, last + 1) if last - first + 1 == len(columns) else columns


@dataclass(frozen=True)
class SigmaPointOptions:
    """Options of Van der Merwe's scaled sigma points.

    No covariance weight may be negative: with beta = 2 that asks for alpha >= 0.518.

    Attributes
    ----------
    alpha : float
        Spread of the points about the mean.
    beta : float
        Weight of the mean in the covariance; 2 is best for a Gaussian.
    kappa : float
        Additional spread, in coordinates of the state.
    """

    alpha: Annotated[float, NumberRange(1e-3, 1e3)] = 0.6
    beta: Annotated[float, NumberRange(0, 1e6)] = 2.0
    kappa: Annotated[float, NumberRange(-10, 1e6)] = 0.0


@dataclass(frozen=True)
class SigmaPoints:
    """A sigma-point set over n coordinates y.

    Attributes
    ----------
    offsets : ndarray of float, shape (p, n)
        Sigma points about the mean, in units of the covariance factor's columns.
    mean_weights : ndarray of float, shape (p,)
        Weights of the mean.
    root_weights : ndarray of float, shape (p,)
        Square roots of the covariance weights.
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
    """filterpy's scaled set of Van der Merwe over n coordinates.

    Raises
    ------
    InputError
        When a covariance weight is negative, with which a covariance could become indefinite.
    """
    merwe = merwe_points(n, options.alpha, options.beta, options.kappa)
    if np.min(merwe.Wc) < 0:
        raise InputError(
            f"sigma points with alpha={options.alpha}, beta={options.beta} have a covariance weight of {np.min(merwe.Wc):.3g}"
            "; choose alpha >= 0.518 with beta = 2 so that covariances stay positive"
        )
    return SigmaPoints(merwe.sigma_points(np.zeros(n), np.eye(n)), merwe.Wm, np.sqrt(merwe.Wc))


@dataclass(frozen=True)
class Prediction:
    """Beliefs at times ahead.

    Attributes
    ----------
    times : ndarray of float, shape (k,)
        Seconds ahead of the belief that was predicted.
    mean : ndarray of float, shape (k, m)
        Predicted means.
    factor : ndarray of float, shape (k, n, n)
        Their covariance factors, P = factor factor'.
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
    dt : ndarray of float, shape (k,)
        Seconds ahead of the belief, positive and increasing; every one is a step from the one before, the first from the
        belief.

    Raises
    ------
    InputError
        Times that are none, not finite, not ahead or not increasing.
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
