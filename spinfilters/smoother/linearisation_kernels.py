"""A window's steps and its marginalization prior linearised in one call each of `linearise.c`; none without compiled code.

A call takes addresses of compiled functions, so that no Python runs between them. What it cannot take, such as steps of very
different turns, is left to the callers' NumPy.
"""

import ctypes
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np

from spinfilters.core.compiled import address, addresses
from spinfilters.filters.estimator import ProcessModel
from spinfilters.models.batched_linearisation import StepsScan
from spinfilters.models.state_layout import StateLayout

LAYOUTS: Final = 64
"""Layouts and processes whose compiled functions are kept at hand."""


def _fields(kind: type, *names: str) -> tuple[tuple[str, type], ...]:
    return tuple((name, kind) for name in names)


class _ChartsStructure(ctypes.Structure):
    """`Charts` of `linearise.c`."""

    _fields_ = (
        *_fields(ctypes.c_void_p, "local", "reset"),
        *_fields(ctypes.c_longlong, "m", "n", "blocks"),
        *_fields(ctypes.c_void_p, "start", "dimension", "constant"),
    )


class _StepsStructure(ctypes.Structure):
    """`Steps` of `linearise.c`."""

    _fields_ = (
        *_fields(ctypes.c_void_p, "scan"),
        *_fields(ctypes.c_longlong, "errors", "q", "levels", "fewest", "rate"),
        *_fields(ctypes.c_void_p, "limits", "numbers", "densities"),
        *_fields(ctypes.c_double, "tolerance", "alike", "smallest_turn"),
    )


class PriorStructure(ctypes.Structure):
    """`Prior` of `linearise.c`."""

    _fields_ = (
        *_fields(ctypes.c_longlong, "epochs", "poses", "constants", "chains"),
        *_fields(ctypes.c_void_p, "pose", "constant", "chain", "begin", "apart"),
        *_fields(ctypes.c_void_p, "first", "root", "right", "gram", "gauge"),
        *_fields(ctypes.c_double, "least"),
    )


@dataclass(frozen=True)
class KeptStructure:
    """A structure as C reads it, and the arrays that it points to.

    Attributes
    ----------
    address : int
        Of the structure.
    """

    address: int
    _kept: tuple[Any, ...]

    @classmethod
    def of(cls, structure: ctypes.Structure, *arrays: Any) -> "KeptStructure":
        """The structure, kept together with what it points to."""
        return cls(ctypes.addressof(structure), (structure, *arrays))


@lru_cache(maxsize=LAYOUTS)
def charts_of(layout: StateLayout) -> KeptStructure | None:
    """Charts of a layout; None where one is not compiled."""
    loops = (layout.differences.loop, layout.resetting.loop)
    if None in loops:
        return None
    blocks = [
        (layout.slice(block.name).start, block.dimension, int(block.constant)) for block in layout.curved
    ]
    start, dimension, constant = (
        np.ascontiguousarray(each) for each in np.array(blocks, dtype=np.int64).reshape(-1, 3).T
    )
    arrays = (start, dimension, constant)
    sizes = (layout.mean_dim, layout.error_dim, len(blocks))
    return KeptStructure.of(_ChartsStructure(*loops, *sizes, *addresses(*arrays)), *arrays)


class ManySteps(NamedTuple):
    """Steps of a process as C reads them.

    Attributes
    ----------
    noise_dim : int
        Columns of a step's noise factor.
    """

    charts: KeptStructure
    steps: KeptStructure
    noise_dim: int


def many_steps(process: ProcessModel) -> ManySteps | None:
    """Steps of a process; None where something of them is not compiled."""
    found = process.steps_scan()
    return None if found is None else _many_steps(process.layout, found)


@lru_cache(maxsize=LAYOUTS)
def _many_steps(layout: StateLayout, found: StepsScan) -> ManySteps | None:
    charts = charts_of(layout)
    if charts is None:
        return None
    numbers = (ctypes.c_void_p * len(found.numbers))(*addresses(*found.numbers))
    structure = _StepsStructure(
        found.scan,
        *(found.error_dim, found.noise_dim, len(found.limits), found.fewest, found.rate),
        *(address(found.limits), ctypes.addressof(numbers), address(found.densities)),
        *(found.tolerance, found.alike, found.smallest_turn),
    )
    return ManySteps(charts, KeptStructure.of(structure, found, numbers), found.noise_dim)
