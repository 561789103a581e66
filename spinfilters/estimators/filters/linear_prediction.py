"""First-order prediction of measurements, for the EKF and the initialisation smoother."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.estimators.estimator import Measurement
from spinfilters.estimators.filters.square_root_update import MeasurementPrediction, compressed


@dataclass(frozen=True)
class LinearisedRows:
    """Whitened linearised innovations of a measurement's usable values. innovation = jacobian @ error[columns] + unit noise.

    Attributes
    ----------
    measurement: the values that are used.
    innovation: (k, d).   jacobian: (k, d, c) with respect to the error's ``columns``.
    log_noise: (k,) log determinant of the factor by which each was whitened.
    root_weights: (k,) square roots of the weights that are in all this, None for 1.
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
        """Predicted innovations of a state of uncertain error.

        The error has a covariance factor and a mean, None for zero.
        """
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
    """Increasing columns, as a slice where they are contiguous.

    A slice indexes in a third of the time.
    """
    first, last = columns[0], columns[-1]
    return slice(first, last + 1) if last - first + 1 == len(columns) else columns
