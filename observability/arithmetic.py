"""Number types of power series.

Floats here, residues of a prime in `prime_field`.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from jaxtyping import Num


class Arithmetic(ABC):
    """Arrays of one kind of number. All operations are elementwise on any shape, and broadcast."""

    dtype: np.dtype

    @abstractmethod
    def numbers(self, values: Sequence[Fraction]) -> Num[np.ndarray, " n"]:
        """These fractions as numbers."""

    @abstractmethod
    def reduced(self, a: np.ndarray) -> np.ndarray:
        """The canonical form of a sum of at most some thousand canonical numbers."""

    @abstractmethod
    def negative(self, a: np.ndarray) -> np.ndarray:
        """-a in canonical form."""

    @abstractmethod
    def product(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """a b in canonical form."""

    @abstractmethod
    def inverse(self, a: np.ndarray) -> np.ndarray:
        """1 / a; NotRegularError where a is 0."""

    @abstractmethod
    def exponential(self, a: np.ndarray, exact: Sequence[Fraction]) -> np.ndarray:
        """exp(a), with a also given as fractions, in the order of a's elements."""

    @abstractmethod
    def root(self, a: np.ndarray) -> np.ndarray:
        """The positive square root.

        NotRegularError where there is no derivative or no number for it.
        """

    @abstractmethod
    def logarithm(self, a: np.ndarray) -> np.ndarray:
        """log(a); NotRegularError where there is no number for it."""


class NotRegularError(ArithmeticError):
    """An expression that has no power series in this arithmetic at this point."""


class Reals(Arithmetic):
    """float64."""

    dtype = np.dtype(np.float64)

    def numbers(self, values: Sequence[Fraction]) -> Num[np.ndarray, " n"]:
        """Nearest floats."""
        return np.array([float(value) for value in values], dtype=np.float64)

    def reduced(self, a: np.ndarray) -> np.ndarray:
        """The same."""
        return a

    def negative(self, a: np.ndarray) -> np.ndarray:
        """-a."""
        return -a

    def product(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """a b."""
        return a * b

    def inverse(self, a: np.ndarray) -> np.ndarray:
        """1 / a; NotRegularError where a is 0."""
        if not np.all(a != 0):
            raise NotRegularError("division by 0")
        return 1 / a

    def exponential(self, a: np.ndarray, exact: Sequence[Fraction]) -> np.ndarray:
        """exp(a)."""
        return np.exp(a)

    def root(self, a: np.ndarray) -> np.ndarray:
        """The positive root; NotRegularError where a is not positive."""
        if not np.all(a > 0):
            raise NotRegularError("square root of a number that is not positive")
        return np.sqrt(a)

    def logarithm(self, a: np.ndarray) -> np.ndarray:
        """log(a); NotRegularError where a is not positive."""
        if not np.all(a > 0):
            raise NotRegularError("logarithm of a number that is not positive")
        return np.log(a)
