"""Robust losses of whitened residuals, their weights in least squares, and a robust deviation.

A loss is a class here. One that a class has already, as Geman-McClure's is Barron's of shape -2, is an entry alone. An entry in
`ROBUST_LOSSES` makes a loss a setting, which filters (``robust.loss``) and the smoother
(``smoother.loss``) both read.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError

LARGEST = 1e300
"""Largest squared length in a ratio of two, in place of infinity."""

Squares = Float[np.ndarray, " N"]


class RobustLoss(ABC):
    """Robust loss rho(s) and its derivative rho'(s), elementwise.

    s is infinite where a sensor's model does not apply, and the weight is then 0.
    """

    @abstractmethod
    def cost(self, square: Squares) -> Squares:
        """rho(s) of squared distances s."""
        ...

    @abstractmethod
    def weight(self, square: Squares) -> Squares:
        """Derivative rho'(s), the weight of a least-squares iteration."""
        ...

    def at_stage(self, stage: int) -> "RobustLoss":
        """The loss of an iteration: the same in all, unless it is graduated."""
        return self

    @property
    def stages(self) -> int:
        """Number of iterations until graduation reaches the final loss."""
        return 0


@dataclass(frozen=True)
class LeastSquares(RobustLoss):
    """Plain least squares, rho = s, for measurements without outliers."""

    def cost(self, square: Squares) -> Squares:
        """rho(s) = s."""
        return square

    def weight(self, square: Squares) -> Squares:
        """1, and 0 where s is infinite."""
        return np.isfinite(square).astype(float)


@dataclass(frozen=True)
class Huber(RobustLoss):
    """Squares up to ``threshold`` standard deviations, a straight line beyond (Huber 1964)."""

    threshold: float = 2.0

    def __post_init__(self) -> None:
        _positive("huber threshold", self.threshold)

    def cost(self, square: Squares) -> Squares:
        """s within the threshold, linear in its root beyond."""
        size = np.sqrt(square)
        return np.where(size <= self.threshold, square, self.threshold * (2 * size - self.threshold))

    def weight(self, square: Squares) -> Squares:
        """1 within the threshold b, b / sqrt(s) beyond."""
        return self.threshold / np.maximum(np.sqrt(square), self.threshold)


@dataclass(frozen=True)
class PseudoHuber(RobustLoss):
    """Smooth loss rho = 2 b^2 (sqrt(1 + s / b^2) - 1), b the threshold.

    Sources: Tweddle 2013, sec. 4.7.4; Hartley and Zisserman 2003, appendix A6.8.
    """

    threshold: float = 2.0

    def __post_init__(self) -> None:
        _positive("pseudo-huber threshold", self.threshold)

    def cost(self, square: Squares) -> Squares:
        """2 b^2 (sqrt(1 + s / b^2) - 1)."""
        b2 = self.threshold**2
        return 2 * b2 * (np.sqrt(1 + square / b2) - 1)

    def weight(self, square: Squares) -> Squares:
        """1 / sqrt(1 + s / b^2)."""
        return 1 / np.sqrt(1 + square / self.threshold**2)


@dataclass(frozen=True)
class Barron(RobustLoss):
    """Barron's (2019) family, scaled so that rho'(0) = 1.

    Attributes
    ----------
    shape : float
        alpha: 2 is least squares, 1 pseudo-Huber, 0 Cauchy, -2 Geman-McClure.
    scale : float
        c, standard deviations.
    """

    shape: float = 0.0
    scale: float = 2.0

    def __post_init__(self) -> None:
        _positive("barron scale", self.scale)
        if not (np.isfinite(self.shape) and self.shape <= 2):
            raise InputError(f"barron shape is {self.shape}; give a number of at most 2")

    def cost(self, square: Squares) -> Squares:
        """Barron's general loss of shape alpha and scale c."""
        z, c2 = square / self.scale**2, self.scale**2
        if self.shape == 2:
            return z * c2
        if self.shape == 0:
            return 2 * c2 * np.log1p(z / 2)
        width = abs(self.shape - 2)
        return 2 * c2 * width / self.shape * np.expm1(self.shape / 2 * np.log1p(z / width))

    def weight(self, square: Squares) -> Squares:
        """Derivative of Barron's general loss by s."""
        if self.shape == 2:
            return np.isfinite(square).astype(float)
        z = square / self.scale**2
        return (1 + z / abs(self.shape - 2)) ** (self.shape / 2 - 1)


@dataclass(frozen=True)
class Gate(RobustLoss):
    """Hard-gated loss: quadratic, then linear, then constant.

    Squares up to ``inner`` standard deviations, a straight line up to ``outer``; beyond, an observation has no weight.

    Attributes
    ----------
    among : ndarray or None
        (N,) residuals that count at all, or None for all.
    """

    inner: float
    outer: float
    among: np.ndarray | None = None

    def cost(self, square: Squares) -> Squares:
        """Huber's loss, constant beyond the gate."""
        if self.inner == self.outer:  # no straight line between
            costs = np.minimum(square, self.outer**2)
            return costs if self.among is None else costs * self.among
        size = np.minimum(np.sqrt(square), self.outer)
        costs = np.where(size <= self.inner, size**2, self.inner * (2 * size - self.inner))
        return costs if self.among is None else costs * self.among

    def weight(self, square: Squares) -> Squares:
        """Huber's weight, zero beyond the gate."""
        inside = square < self.outer**2
        if self.inner == self.outer:  # no slope but that of the square
            weight = inside.astype(float)
        else:
            weight = np.where(inside, self.inner / np.maximum(np.sqrt(square), self.inner), 0.0)
        return weight if self.among is None else weight * self.among


@dataclass(frozen=True)
class UngatedRows(RobustLoss):
    """Least squares of some residuals, another loss of the rest.

    Attributes
    ----------
    loss : RobustLoss
        Loss of the rest.
    rows : ndarray of bool, shape (N,)
        Residuals that are squared.
    """

    loss: RobustLoss
    rows: np.ndarray

    def cost(self, square: Squares) -> Squares:
        """s of the chosen residuals, the loss of the rest."""
        return np.where(self.rows & np.isfinite(square), square, self.loss.cost(square))

    def weight(self, square: Squares) -> Squares:
        """1 of the chosen residuals where s is finite, the weight of the rest."""
        return np.where(self.rows & np.isfinite(square), 1.0, self.loss.weight(square))


@dataclass(frozen=True)
class Graduated(RobustLoss):
    """Geman-McClure's loss by graduated non-convexity, reached from least squares (Yang et al. 2020).

    It holds with half of all observations wrong. The loss is
    rho = m b^2 s / (m b^2 + s) with m falling from ``first`` to 1 by ``rate`` per iteration: at first all residuals pull, at last
    those of many times b hardly do.

    Attributes
    ----------
    threshold : float
        b, standard deviations.
    first, rate : float
        First value of m, and the divisor of m per iteration; both greater than 1.
    stage : int
        Iterations so far.
    """

    threshold: float = 3.0
    first: float = 1e4
    rate: float = 4.0
    stage: int = 0

    def __post_init__(self) -> None:
        _positive("graduated threshold", self.threshold)
        for name in ("first", "rate"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 1):
                raise InputError(f"graduated {name} is {getattr(self, name)}; give a number above 1")

    @property
    def stages(self) -> int:
        """Iterations until m is 1."""
        return int(np.ceil(np.log(self.first) / np.log(self.rate)))

    def at_stage(self, stage: int) -> "Graduated":
        """The loss of an iteration."""
        return Graduated(self.threshold, self.first, self.rate, stage)

    def cost(self, square: Squares) -> Squares:
        """Geman and McClure's loss mu s / (mu + s)."""
        finite = np.minimum(square, LARGEST)
        return self._width * finite / (self._width + finite)

    def weight(self, square: Squares) -> Squares:
        """(mu / (mu + s))^2."""
        return (self._width / (self._width + square)) ** 2

    @property
    def _width(self) -> float:
        return self.threshold**2 * max(self.first / self.rate**self.stage, 1.0)


@dataclass(frozen=True)
class LossEntry:
    """A loss that settings choose by its name.

    Attributes
    ----------
    name : str
        Value of the setting ``loss``.
    build : callable
        The loss of a ``width`` (standard deviations from which it is no longer quadratic) and a ``shape`` (Barron's alpha).
    """

    name: str
    build: Callable[[float, float], RobustLoss]


ROBUST_LOSSES: Final[tuple[LossEntry, ...]] = (
    LossEntry("none", lambda width, shape: LeastSquares()),
    LossEntry("gate", lambda width, shape: Gate(width, width)),
    LossEntry("huber", lambda width, shape: Huber(width)),
    LossEntry("pseudo-huber", lambda width, shape: PseudoHuber(width)),
    LossEntry("barron", lambda width, shape: Barron(shape, width)),
)
"""All losses that settings can choose, for filters and smoother alike."""
LOSS_NAMES: Final = tuple(entry.name for entry in ROBUST_LOSSES)


def build_loss(name: str, width: float, shape: float) -> RobustLoss:
    """The loss of that name.

    Parameters
    ----------
    name : str
        One of `LOSS_NAMES`.
    width : float
        Residual from which the loss is no longer quadratic, standard deviations.
    shape : float
        Barron's alpha, which other losses do not read.

    Returns
    -------
    RobustLoss
        From the entry of `ROBUST_LOSSES`.

    Raises
    ------
    InputError
        A name that no entry has, or a width or shape that the loss does not take.
    """
    for entry in ROBUST_LOSSES:
        if entry.name == name:
            return entry.build(width, shape)
    raise InputError(f"loss {name!r} is unknown; choose from {', '.join(LOSS_NAMES)}")


def median_deviation(residuals: Float[np.ndarray, "*n"]) -> float:
    """Standard deviation of Gaussian residuals from the median of their absolute values, which half of them may spoil."""
    return 1.4826 * float(np.median(np.abs(residuals)))


def _positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise InputError(f"{name} is {value}; give a positive number of standard deviations")
