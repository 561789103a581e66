"""Noise of a sensor as parameters of its measurements: one standard deviation, or a Cholesky factor of every row."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float

from spinfilters.core.attitude_expressions import Expression


def factor_of(parameters: Expression, dim: int) -> ca.SX:
    """The lower factor (dim, dim) from its dim (dim + 1) / 2 entries."""
    factor = ca.SX.zeros(dim, dim)
    for index, (row, col) in enumerate(_lower(dim)):
        factor[row, col] = parameters[index]
    return factor


def parameters_of(covariance: Float[np.ndarray, "count d d"]) -> Float[np.ndarray, "count e"]:
    """The entries from covariances.

    Raises
    ------
    numpy.linalg.LinAlgError
        When a covariance is not positive definite.
    """
    factor = np.linalg.cholesky(covariance)
    rows, cols = zip(*_lower(covariance.shape[1]), strict=True)
    return factor[:, rows, cols]


def _lower(dim: int) -> list[tuple[int, int]]:
    return [(row, col) for row in range(dim) for col in range(row + 1)]


NoiseLevel = float | Float[np.ndarray, "k d d"]
"""A standard deviation of every component of every measurement, or the measurements' covariances."""


@dataclass(frozen=True)
class SensorNoiseModel(ABC):
    """White noise of ``dim`` components, written with parameters of a measurement."""

    dim: int

    @property
    @abstractmethod
    def parameter_dim(self) -> int:
        """Number of parameters of the noise."""

    @abstractmethod
    def factor(self, parameters: Expression, added: Expression | None = None) -> Expression:
        """Lower factor (dim, dim) of the covariance, with a variance ``added`` to every component."""

    @abstractmethod
    def difference_std(self, parameters: Expression, one: int, other: int) -> Expression:
        """Standard deviation of the difference of two components."""


@dataclass(frozen=True)
class IsotropicNoise(SensorNoiseModel):
    """One standard deviation, the only parameter, for independent components."""

    @property
    def parameter_dim(self) -> int:
        """One: the standard deviation."""
        return 1

    def factor(self, parameters: Expression, added: Expression | None = None) -> Expression:
        """sqrt(std^2 + added) I."""
        std = parameters[0] if added is None else ca.sqrt(parameters[0] ** 2 + added)
        return std * ca.DM.eye(self.dim)

    def difference_std(self, parameters: Expression, one: int, other: int) -> Expression:
        """sqrt(2) std."""
        return ca.sqrt(2) * parameters[0]


@dataclass(frozen=True)
class CorrelatedNoise(SensorNoiseModel):
    """A covariance: parameters are the entries, row by row, of its lower Cholesky factor."""

    @property
    def parameter_dim(self) -> int:
        """Number of entries of the Cholesky factor."""
        return self.dim * (self.dim + 1) // 2

    def factor(self, parameters: Expression, added: Expression | None = None) -> Expression:
        """Cholesky factor of L L' + added I."""
        root = factor_of(parameters, self.dim)
        if added is None:
            return root
        return ca.chol(root @ root.T + added * ca.SX.eye(self.dim)).T

    def difference_std(self, parameters: Expression, one: int, other: int) -> Expression:
        """Length of the difference of two rows of the factor."""
        root = factor_of(parameters, self.dim)
        return ca.norm_2(root[one, :] - root[other, :])


def noise_model(level: NoiseLevel, dim: int) -> SensorNoiseModel:
    """Noise model of measurements with this noise."""
    return CorrelatedNoise(dim) if np.ndim(level) else IsotropicNoise(dim)


def noise_parameters(level: NoiseLevel, count: int) -> Float[np.ndarray, "count e"]:
    """Parameters of ``count`` measurements.

    Raises
    ------
    numpy.linalg.LinAlgError
        When a covariance is not positive definite.
    """
    return parameters_of(np.asarray(level)) if np.ndim(level) else np.full((count, 1), level)


def noise_of_rows(
    level: NoiseLevel, rows: slice | Bool[np.ndarray, " k"]
) -> float | Float[np.ndarray, "chosen d d"]:
    """Noise of some of the measurements."""
    return np.asarray(level)[rows] if np.ndim(level) else level
