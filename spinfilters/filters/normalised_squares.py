"""Normalised squares of many errors and of parts of them in compiled C, `normalised_squares.c`."""

import ctypes
from collections.abc import Sequence
from functools import cache
from importlib.resources import files

import numpy as np
from jaxtyping import Float

from spinfilters.core.c_library import KERNEL_FLAGS, LANES, Signature, load_text, with_signatures
from spinfilters.core.compiled import address
from spinfilters.core.linear_algebra import normalised_squares_of


def normalised_squares(
    error: Float[np.ndarray, "n k"], factor: Float[np.ndarray, "n k e"], parts: Sequence[slice]
) -> Float[np.ndarray, "n parts"]:
    """`normalised_square` of parts of errors, to rounding.

    Parameters
    ----------
    error : ndarray of float, shape (n, k)
        Errors.
    factor : ndarray of float, shape (n, k, e)
        Factors of their covariances.
    parts : Sequence[slice]
        Components of each part: no more than a factor has columns.

    Returns
    -------
    ndarray of float, shape (n, parts)
        e' P^-1 e of each part, infinite where its P is singular.
    """
    library, (items, n, columns) = _library(), factor.shape
    if library is not None and max(part.stop - part.start for part in parts) <= columns:
        errors, factors = (np.ascontiguousarray(array, dtype=float) for array in (error, factor))
        begin, end = (
            np.array(edge, dtype=np.int64) for edge in zip(*[(p.start, p.stop) for p in parts], strict=True)
        )
        found = np.empty((items, len(parts)))
        given = (address(errors), address(factors), len(parts), *map(address, (begin, end, found)))
        if library.normalised_squares(items, n, columns, *given):
            return found
    return normalised_squares_of(error, factor, parts)


@cache
def _library() -> ctypes.PyDLL | None:
    text = (
        f"enum {{ LANES = {LANES} }};\n"
        + files("spinfilters.filters").joinpath("normalised_squares.c").read_text()
    )
    flags = (*KERNEL_FLAGS, "-fno-strict-aliasing", "-Wno-psabi")
    return with_signatures(
        load_text("normalised_squares", text, flags),
        {"normalised_squares": Signature("iiippippp", ctypes.c_int)},
    )
