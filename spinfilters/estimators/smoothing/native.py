"""The loops of `kernels.c`, compiled once, or nothing where there is no compiler: the callers then do the same in NumPy."""

import ctypes
from functools import cache
from importlib.resources import files

import numpy as np

from spinfilters.symbolic.c_library import FLAGS, NATIVE, load_text
from spinfilters.symbolic.compiled import address

KERNEL_FLAGS = (*(flag for flag in FLAGS if "contract" not in flag), "-O3", NATIVE, "-fno-math-errno")


@cache
def kernels() -> ctypes.PyDLL | None:
    """The library, or None."""
    text = files("spinfilters.estimators.smoothing").joinpath("kernels.c").read_text()
    library = load_text("smoother_kernels", text, KERNEL_FLAGS)
    if library is not None:
        library.eliminate_chain.restype = ctypes.c_longlong
        for name in ("spread_blocks", "follow_poses", "solve_chain", "step_rows", "add_grams"):
            getattr(library, name).restype = None
    return library


def pointer(array: np.ndarray) -> ctypes.c_void_p:
    """Where a contiguous array begins."""
    return ctypes.c_void_p(address(array))


def integer(value: int) -> ctypes.c_longlong:
    """As the kernels take it."""
    return ctypes.c_longlong(value)
