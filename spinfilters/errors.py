"""Exceptions for errors of a caller or a file.

Their text names the value and the cure.
Numerical trouble inside an estimator is not an exception: it is an `EstimatorStatus`.
"""

NUMERICAL_ERRORS = (ArithmeticError, ValueError, IndexError, RuntimeError)
"""What NumPy, SciPy, CasADi and Matplotlib raise for numbers that they cannot go on with (`LinAlgError` is a ValueError).

Where one estimator's numbers are computed, evaluated or drawn these become its status; everywhere else they are a defect."""


class SpinfiltersError(Exception):
    """Base of everything that spinfilters raises on purpose.

    The command line prints its text and exits with code 2.
    """


class InputError(SpinfiltersError):
    """A file, value or option that cannot be used.

    The text names it, says what is wrong, and what to do.
    """


class ShapeError(InputError):
    """An array whose shape is not the documented one."""
