"""Loops of the smoother in C, those of `SOURCES`, or none without a compiler. NumPy does the same then."""

import ctypes
from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.resources import files

import numpy as np

from spinfilters.core.c_library import (
    KERNEL_FLAGS,
    LANES,
    Signature,
    has_fused_products,
    load_text,
    with_signatures,
)

SOURCES = (
    *("kernels.h", "landmarks.c", "velocities.c", "roots.c"),
    *("epoch_rows.c", "chain.c", "linearise.c", "solve.c"),
)
_SIGNATURES = {
    "eliminate_landmarks": Signature("iii" + "pppp" + "d" + "pppppppp", ctypes.c_int),
    "follow_poses": Signature("i" + "pppppppp", None),
    "step_rows": Signature("iiiii" + "pp" + "d" + "ppppp", ctypes.c_int),
    "add_information_blocks": Signature("iiiiii" + "ppppp", None),
    "eliminate_velocities": Signature("iiiiii" + "d" + "pppp", ctypes.c_longlong),
    "reduce_velocities": Signature("iiiiii" + "ppp", None),
    "solve_velocities": Signature("iiiiii" + "pppppp", None),
    "chained_covariances": Signature("iii" + "ppppp", ctypes.c_int),
    "root_of_rows": Signature("ii" + "p", ctypes.c_longlong),
    "weigh_rows": Signature("ipii" + "pppppp", None),
    "row_products": Signature("ipi" + "pp", None),
    "row_variances": Signature("ipi" + "ppp", None),
    "chain_forward": Signature("iii" + "ppp", None),
    "chain_backward": Signature("iii" + "ppp", None),
    "linearise_steps": Signature("ppi" + "ppp" + "ip" + "iipp" + "d" + "ppppp", ctypes.c_double),
    "linearise_observations": Signature("pi" + "pppppp" + "iii" + "d" + "ppp", None),
    "rows_at_first": Signature("pppp" + "iip", ctypes.c_int),
    "linearise_first": Signature("pppppp", ctypes.c_double),
    "linearise_prior": Signature("ppp" + "ppp", ctypes.c_double),
    "solve_window": Signature("iiii" + "pipp" + "ipp" + "ddp" + "ppppp" + "pppp", ctypes.c_longlong),
}
"""Arguments of each loop (integers, numbers, addresses of contiguous arrays) and what it returns."""


@cache
def kernels() -> ctypes.PyDLL | None:
    """The library, or None."""
    folder = files("spinfilters.smoother")
    text = f"enum {{ LANES = {LANES} }};\n" + "".join(folder.joinpath(name).read_text() for name in SOURCES)
    return with_signatures(load_text("smoother_kernels", text, KERNEL_FLAGS), _SIGNATURES)


@cache
def potrf_address() -> int | None:
    """SciPy's own LAPACK dpotrf for machines on which `root_of_rows` is slower; None on others."""
    return None if has_fused_products() else scipy_address("scipy.linalg.cython_lapack", "dpotrf")


def take_products(rows: np.ndarray, matrix: np.ndarray) -> None:
    """Subtract rows' rows from the lower triangle of a matrix (BLAS dsyrk).

    Both may be parts of larger arrays, row by row in memory.
    """
    width, pitch = rows.strides[0] // rows.itemsize, matrix.strides[0] // matrix.itemsize
    count, order = ctypes.c_int(len(rows)), ctypes.c_int(rows.shape[1])
    sizes = [ctypes.byref(number) for number in (order, count, ctypes.c_int(width), ctypes.c_int(pitch))]
    _dsyrk()(b"U", b"N", *sizes[:2], _MINUS, rows.ctypes.data, sizes[2], _ONE, matrix.ctypes.data, sizes[3])


_MINUS, _ONE = (ctypes.byref(ctypes.c_double(number)) for number in (-1.0, 1.0))


@cache
def _dsyrk() -> Callable[..., None]:
    """SciPy's own BLAS, which takes parts of matrices as they lie."""
    signature = ctypes.PYFUNCTYPE(None, *[ctypes.c_char_p] * 2, *[ctypes.c_void_p] * 8)
    return signature(scipy_address("scipy.linalg.cython_blas", "dsyrk"))


def scipy_address(module: str, function: str) -> int:
    """Address of a function that SciPy gives to other compiled code."""
    capsule = import_module(module).__pyx_capi__[function]
    name, place = ctypes.pythonapi.PyCapsule_GetName, ctypes.pythonapi.PyCapsule_GetPointer
    name.restype, name.argtypes = ctypes.c_char_p, [ctypes.py_object]
    place.restype, place.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return place(capsule, name(capsule))
