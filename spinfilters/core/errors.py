"""Exceptions for errors of a caller or a file.

Their text names the value and the cure.
Numerical trouble inside an estimator is not an exception: it is an `EstimatorStatus`.
"""

import re
from typing import TypeVar

NUMERICAL_ERRORS = (ArithmeticError, ValueError, IndexError, RuntimeError)
"""What NumPy, SciPy, CasADi and Matplotlib raise for numbers that they cannot go on with (`LinAlgError` is a ValueError).

Where one estimator's numbers are computed, evaluated or drawn these become its status, unless `numerical` finds them a defect;
everywhere else they are one."""
OF_PROGRAMS = re.compile(
    r"(Index|Axis|NotImplemented|Recursion)Error: |ValueError: .*(broadcast|not aligned|core dimension|reshape|unpack|zip\(\)|"
    r"einstein sum|with a sequence|same shape|dimensions must match|concatenation axis)"
)
"""What NumPy and Python say of arrays and sequences that do not fit together, whatever numbers are in them."""
AnyError = TypeVar("AnyError", bound=Exception)


def numerical(error: AnyError) -> AnyError:
    """Return the error where numbers may have caused it, or raise it again where it is a defect of the program.

    Defects are shapes that do not fit, wrong indices and endless recursion.
    """
    if OF_PROGRAMS.match(f"{type(error).__name__}: {error}"):
        raise error
    return error


class SpinfiltersError(Exception):
    """Base of everything that spinfilters raises on purpose; the command line prints its text and exits with code 2."""


class InputError(SpinfiltersError):
    """A file, value or option that cannot be used; the text names it, says what is wrong and how to correct it."""


class RowError(InputError):
    """A measurement that cannot be used. Readers of files catch it and name the file and the line of that row.

    Attributes
    ----------
    name : str
        Of the measurements.
    row : int
        Of the measurement, from 0.
    text : str
        What is wrong, and the cure.
    """

    def __init__(self, name: str, row: int, text: str) -> None:
        super().__init__(name, row, text)
        self.name, self.row, self.text = name, row, text

    def __str__(self) -> str:
        return f"{self.name} row {self.row}: {self.text}"


class ShapeError(InputError):
    """An array whose shape is not the documented one."""
