"""Gate and robust weights of the values of an update.

All innovations rho_i (d) are whitened by their noise, so that their covariance is S_i = I + Y_i Y_i', Y_i the deviations that
the predicted state causes. Each value is judged by its squared distance d2_i = rho_i' S_i^-1 rho_i, chi-square with d degrees of
freedom where all is well. The gate leaves a value out; a loss weighs it by w(r) = l'(r) / r of its loss l at r = sqrt(d2 / d),
whose root mean square is 1 whatever d is. Weight w stands for noise of covariance 1/w: rows times sqrt(w).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.data.stated_values import NumberRange
from spinfilters.errors import InputError

Deviations = Callable[[Bool[np.ndarray, " k"]], Float[np.ndarray, "s d r"]]
"""Y_i of the chosen values: whitened deviations that unit deviations of the predicted state cause."""


@dataclass(frozen=True)
class RobustOptions:
    """Options of outlier rejection.

    Attributes
    ----------
    gate_probability: of a true value to pass the gate, in (0, 1]; 1 for no gate.
    loss: "none" (least squares), "huber" (w = min(1, width / r)) or "barron" (Barron 2019, c = width, scaled to w(0) = 1).
    width: where the loss begins to bend, in standard deviations.
    shape: Barron's alpha, at most 2: 2 least squares, 1 pseudo-Huber, 0 Cauchy, -2 Geman-McClure.
    """

    gate_probability: Annotated[float, NumberRange(1e-15, 1)] = 0.9999
    loss: str = "none"
    width: Annotated[float, NumberRange(1e-6, 1e9)] = 2.5
    shape: Annotated[float, NumberRange(-1e9, 2)] = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.gate_probability <= 1:
            raise InputError(
                f"gate_probability is {self.gate_probability}; give a probability above 0, or 1 for no gate"
            )
        if self.loss not in _LOSSES:
            raise InputError(f"loss {self.loss!r} is unknown; choose from {', '.join(_LOSSES)}")
        if not (np.isfinite(self.width) and self.width > 0):
            raise InputError(f"width is {self.width}; give a positive number of standard deviations")
        if not (np.isfinite(self.shape) and self.shape <= 2):
            raise InputError(f"shape is {self.shape}; give a finite number of at most 2 (2 is least squares)")


def weights(
    innovation: Float[np.ndarray, "k d"], covariance: Float[np.ndarray, "k d d"], options: RobustOptions
) -> Float[np.ndarray, " k"]:
    """Weight of each value in [0, 1].

    0 outside the gate, where something is not finite, and where S is not positive definite.

    Parameters
    ----------
    innovation: whitened.   covariance: S of the innovation in the same units, that of the predicted state included.
    """
    return distance_weights(squared_distances(innovation, covariance), innovation.shape[1], options)


def sparing_weights(
    innovation: Float[np.ndarray, "k d"], deviations: Deviations, options: RobustOptions
) -> Float[np.ndarray, " k"] | None:
    """Weights with S = I + Y Y', None when all are 1.

    S >= I, so a value with |rho|^2 inside the gate passes whatever the state's covariance: without a loss
    hardly any S is formed.
    """
    if options.loss != "none":
        every = np.ones(len(innovation), dtype=bool)
        return weights(innovation, innovation_covariance(deviations(every)), options)
    limit = gate(options.gate_probability, innovation.shape[1])
    squared = (innovation * innovation) @ np.ones(innovation.shape[1])
    if squared[squared.argmax()] <= limit:
        return None
    suspects = squared > limit
    result = np.ones(len(innovation))
    result[suspects] = weights(innovation[suspects], innovation_covariance(deviations(suspects)), options)
    return None if result.all() else result


def innovation_covariance(deviations: Float[np.ndarray, "k d r"]) -> Float[np.ndarray, "k d d"]:
    """S = I + Y Y' of every value."""
    return deviations @ np.swapaxes(deviations, 1, 2) + np.eye(deviations.shape[1])


def squared_distances(
    innovation: Float[np.ndarray, "k d"], covariance: Float[np.ndarray, "k d d"]
) -> Float[np.ndarray, " k"]:
    """Squared distances d2 = rho' S^-1 rho of all values by elimination.

    Infinite where S is not positive definite or NaN.
    """
    k, d = innovation.shape
    array = np.empty((d, d + 1, k))
    array[:, :d] = covariance.transpose(1, 2, 0)
    array[:, d] = innovation.T
    squared, good = np.zeros(k), np.ones(k, dtype=bool)
    with np.errstate(all="ignore"):
        for j in range(d):
            row, pivot = array[j, j + 1 :], array[j, j]
            good &= pivot > 0
            scaled = row / pivot
            squared += scaled[-1] * row[-1]
            if j + 1 < d:
                array[j + 1 :, j + 1 :] -= row[:-1, np.newaxis] * scaled
    good &= np.isfinite(squared)
    squared[~good] = np.inf
    return squared


@cache
def gate(probability: float, dof: int) -> float:
    """Squared distance below which a true value lies with this probability."""
    from scipy.special import chdtri  # here alone: settings need none of it

    return float(chdtri(dof, 1 - probability))


def distance_weights(
    squared: Float[np.ndarray, " k"], dim: int, options: RobustOptions
) -> Float[np.ndarray, " k"]:
    """Weights of squared distances of values of this dimension; 0 outside the gate."""
    inside = (squared <= gate(options.gate_probability, dim)) & (squared < np.inf)
    return np.where(inside, _LOSSES[options.loss](squared / dim, options), 0.0)


def _least_squares(squared: Float[np.ndarray, " k"], options: RobustOptions) -> Float[np.ndarray, " k"]:
    return np.ones(len(squared))


def _huber(squared: Float[np.ndarray, " k"], options: RobustOptions) -> Float[np.ndarray, " k"]:
    return options.width / np.sqrt(np.maximum(squared, options.width**2))


def _barron(squared: Float[np.ndarray, " k"], options: RobustOptions) -> Float[np.ndarray, " k"]:
    if options.shape == 2:
        return np.ones(len(squared))
    return (squared / (options.width**2 * (2 - options.shape)) + 1) ** (options.shape / 2 - 1)


_LOSSES = {"none": _least_squares, "huber": _huber, "barron": _barron}
