"""What goes wrong because of the caller or of a file, as exceptions whose text names the value and the cure.

Numerical trouble inside an estimator is not an exception: it is an `EstimatorStatus`.
"""


class SpinfiltersError(Exception):
    """Base of everything that spinfilters raises on purpose. The command line prints its text and exits with code 2."""


class InputError(SpinfiltersError):
    """A file, value or option that cannot be used: the text names it, says what is wrong, and what to do."""


class ShapeError(InputError):
    """An array whose shape is not the documented one."""
