"""Vectorised (SIMD) evaluation of CasADi functions of scalars.

CasADi's own C handles one item after the other. Here the instruction tape of the same expression is written out as the body of a
loop that a compiler turns into vector instructions: no formula is typed twice, and every operation rounds as in CasADi's virtual
machine.
"""

import ctypes
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Int

from spinfilters.errors import ShapeError
from spinfilters.symbolic.c_library import FLAGS, NATIVE, load_text
from spinfilters.symbolic.compiled import Compiled, address
from spinfilters.symbolic.simd_code import scan_text, simd_text
from spinfilters.symbolic.working_time import built_property

SIMD_FLAGS = (*FLAGS, "-O3", NATIVE, "-fopenmp-simd", "-fno-math-errno", "-fno-trapping-math")


class Vectorised:
    """One function whose inputs and outputs are columns of numbers, for items in rows.

    Parameters
    ----------
    function: an SX function; an input of n numbers takes an array (k, n), outputs come as (k, n), matrices column by column.

    Attributes
    ----------
    widths: how many numbers each input has.
    """

    def __init__(self, function: ca.Function) -> None:
        self.name: str = function.name()
        self._plain = Compiled(function)
        self._function = function
        self.widths: list[int] = [function.numel_in(k) for k in range(function.n_in())]
        self._made = [function.numel_out(k) for k in range(function.n_out())]

    def __reduce__(self) -> tuple[type["Vectorised"], tuple[ca.Function]]:
        """A library does not pickle: another process builds its own from the expression."""
        return Vectorised, (self._function,)

    def __call__(
        self, *arguments: np.ndarray, rows: tuple[Int[np.ndarray, " n"] | None, ...]
    ) -> tuple[np.ndarray, ...]:
        """Evaluate for n items.

        Parameters
        ----------
        arguments: (k, width) each.   rows: per argument, (n,) which of its rows an item takes, or None where item i takes row i,
            or all items the only one.

        Raises
        ------
        ShapeError: for a wrong number or width of arguments, or rows that do not fit.
        """
        count = self._count(arguments, rows)
        if self._library is None:
            return _interpreted(self._plain, arguments, rows)
        return _run(self._library, arguments, rows, [(count, made) for made in self._made])

    @property
    def function(self) -> ca.Function:
        """The expression, for others to be made of it."""
        return self._function

    @built_property
    def loop(self) -> int | None:
        """Address of the compiled loop, for other compiled code to call; None where there is none."""
        return self._library and ctypes.cast(self._library.spinfilters_lanes, ctypes.c_void_p).value

    def _count(self, arguments: tuple[np.ndarray, ...], rows: tuple[np.ndarray | None, ...]) -> int:
        if len(arguments) != len(self.widths) or len(rows) != len(arguments):
            raise ShapeError(f"{self.name} takes {len(self.widths)} arguments with rows for each")
        counts: set[int] = set()
        for argument, row, width in zip(arguments, rows, self.widths, strict=True):
            if argument.ndim != 2 or argument.shape[1] != width:
                raise ShapeError(f"{self.name}: an argument of shape (k, {width}) is {argument.shape}")
            if row is not None and len(row) and not _largest(row) < len(argument):
                raise ShapeError(f"{self.name}: rows {row.min()} to {row.max()} of {len(argument)}")
            if row is not None or len(argument) != 1:
                counts.add(len(argument) if row is None else len(row))
        if len(counts) > 1:
            raise ShapeError(f"{self.name}: arguments have {sorted(counts)} items; give the same number")
        return counts.pop() if counts else 1

    @built_property
    def _library(self) -> ctypes.PyDLL | None:
        text = simd_text(self._plain.function)
        return None if text is None else load_text(f"{self.name}_lanes", text, SIMD_FLAGS)


class VectorisedScan:
    """Scan: an initial state, a repeated body, and an output, for many items side by side.

    Every input and output is a column of numbers, of an item (k, n), or of all of them (1, n).

    Parameters
    ----------
    begin: of the inputs; gives the state x, then columns that stay the same.
    turn: of x, of those columns, and of a last column of numbers that are others in every turn; gives the next x.
    end: of the inputs and x; gives what is wanted.
    """

    def __init__(self, begin: ca.Function, turn: ca.Function, end: ca.Function) -> None:
        self.name: str = turn.name()
        self._functions = (begin, turn, end)
        self._plain = [Compiled(function) for function in self._functions]
        self._widths = [begin.numel_in(k) for k in range(begin.n_in())]
        self._made = [end.numel_out(k) for k in range(end.n_out())]
        self._numbers: int = turn.numel_in(turn.n_in() - 1)

    def __reduce__(self) -> tuple[type["VectorisedScan"], tuple[ca.Function, ...]]:
        """A library does not pickle: another process builds its own from the expressions."""
        return VectorisedScan, self._functions

    def __call__(self, *arguments: np.ndarray, each: np.ndarray) -> tuple[np.ndarray, ...]:
        """Evaluate for k items.

        Parameters
        ----------
        each: (turns, numbers) of every turn.

        Raises
        ------
        ShapeError: for a wrong number, length or width of arguments, or of the numbers of turns.
        """
        if each.ndim != 2 or each.shape[1] != self._numbers:
            raise ShapeError(f"{self.name} takes {self._numbers} numbers for every turn, got {each.shape}")
        counts = {len(a) for a in arguments if len(a) != 1} or {1}
        shapes = [a.shape[1] if a.ndim == 2 else -1 for a in arguments]
        if shapes != self._widths or len(counts) != 1:
            given = [a.shape for a in arguments]
            raise ShapeError(f"{self.name} takes columns of {self._widths} numbers, got {given}")
        (count,) = counts
        if self._library is None:
            return self._interpreted([np.broadcast_to(a, (count, a.shape[1])) for a in arguments], each)
        same = (None,) * len(arguments)
        return _run(self._library, arguments, same, [(count, made) for made in self._made], each)

    def _interpreted(self, arguments: list[np.ndarray], each: np.ndarray) -> tuple[np.ndarray, ...]:
        begin, turn, end = self._plain
        x, *same = begin(*arguments)
        for numbers in each:
            (x,) = turn(x, *same, np.tile(numbers, (len(x), 1)))
        return end(*arguments, x)

    @built_property
    def _library(self) -> ctypes.PyDLL | None:
        text = scan_text(*[plain.function for plain in self._plain])
        return None if text is None else load_text(f"{self.name}_fold", text, SIMD_FLAGS)


_FLOAT, _INTEGER = np.dtype(np.float64), np.dtype(np.int64)


def _run(
    library: ctypes.PyDLL,
    arguments: tuple[np.ndarray, ...],
    rows: tuple[np.ndarray | None, ...],
    shapes: list[tuple[int, int]],
    each: np.ndarray | None = None,
) -> tuple[np.ndarray, ...]:
    arrays = [_plain(argument, _FLOAT) for argument in arguments]
    chosen = [None if row is None else _plain(row, _INTEGER) for row in rows]
    results = tuple([np.empty(shape) for shape in shapes])
    count, turned = shapes[0][0], None if each is None else _plain(each, _FLOAT)
    pointers, longs = ctypes.c_void_p * len(arrays), ctypes.c_longlong * len(arrays)
    library.spinfilters_lanes(
        ctypes.c_longlong(count),
        pointers(*[address(array) for array in arrays]),
        longs(
            *[0 if len(a) == 1 and row is None else a.shape[1] for a, row in zip(arrays, rows, strict=True)]
        ),
        pointers(*[None if row is None else address(row) for row in chosen]),
        (ctypes.c_void_p * len(results))(*[address(result) for result in results]),
        *(() if turned is None else (ctypes.c_longlong(len(turned)), ctypes.c_void_p(address(turned)))),
    )
    return results


def _interpreted(
    plain: Compiled, arguments: tuple[np.ndarray, ...], rows: tuple[np.ndarray | None, ...]
) -> tuple[np.ndarray, ...]:
    """The same without lanes; matrices lie column by column in the rows of arguments and results."""
    taken = [a if row is None else a[row] for a, row in zip(arguments, rows, strict=True)]
    for k, array in enumerate(taken):
        high, wide = plain.input_shapes[k]
        if wide != 1:
            taken[k] = array.reshape(len(array), wide, high).swapaxes(1, 2)
    results = plain(*taken)
    pairs = zip(results, plain.output_shapes, strict=True)
    return tuple(result.swapaxes(1, -1).reshape(len(result), high * wide) for result, (high, wide) in pairs)


def _largest(row: Int[np.ndarray, " n"]) -> int:
    """The largest number, where a negative one counts as larger than any."""
    if row.dtype is _INTEGER and row.flags.c_contiguous:
        return int(row.view(np.uint64).max())
    return int(row.max()) if row.min() >= 0 else np.iinfo(np.int64).max


def _plain(array: np.ndarray, kind: np.dtype[Any]) -> np.ndarray:
    """Contiguous and of one kind, the array itself where it is."""
    if array.dtype is kind and array.flags.c_contiguous:
        return array
    return np.ascontiguousarray(array, dtype=kind)
