"""CasADi functions called on NumPy arrays, vectorised over leading axes.

Calls run generated C where a compiler is there.
"""

import ctypes
import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import casadi as ca
import numpy as np

from spinfilters.core.c_library import kept_loop, load_loop, no_library
from spinfilters.core.errors import ShapeError
from spinfilters.core.working_time import building

_FLOAT = np.dtype(np.float64)
MOST_IDLE: Final = 16
"""Buffers of a function that are kept while no call needs them: as many as threads have called it at once."""
MOST_MAPPED = 1024
"""Items that one virtual machine takes at once: to build one takes as long as to run it, and counts vary."""
WORTH_COMPILING: Final = 100_000
"""Items of which the interpretation takes about as long as a compiler."""
Loader = Callable[[ca.Function], ctypes.PyDLL | None]
"""Makes the C library of a function's loop, or None to interpret it."""


class Compiled:
    """One CasADi function on NumPy arrays.

    An input of CasADi shape (n, 1) takes arrays of shape (*batch, n), one of shape (n, m) takes
    (*batch, n, m); batch axes broadcast against one another. Outputs have the broadcast batch axes in front
    and share no memory with later calls. C code and CasADi's virtual machine differ by the last bit of few numbers at
    most, so a machine without a compiler gives the same results to rounding.

    Any number of threads may call one instance: each call takes buffers that no other has.

    Parameters
    ----------
    function : ca.Function
        The expression; every output is made dense here, because bound buffers would keep only structural
        non-zeros.
    load : Loader
        Makes its library; see `Compiled.interpreted` for one that never runs a compiler.
    patience : int
        Items that are interpreted before a compiler runs.
    kept : Loader
        Finds the library where it is there already, as it is asked before the first item.

    Raises
    ------
    ShapeError
        At a call, for a wrong trailing shape or number of arguments, or batch axes that differ.
    """

    def __init__(
        self,
        function: ca.Function,
        load: Loader = load_loop,
        patience: int = 0,
        kept: Loader = kept_loop,
    ) -> None:
        self._load, self._patience, self._kept = load, patience, kept
        with building():
            self._function = _densified(function)
            self.name: str = function.name()
            names = [self._function.name_in(k) for k in range(self._function.n_in())]
            self._inputs = list(zip(names, map(self._function.size_in, range(len(names))), strict=True))
            self._outputs = [self._function.size_out(k) for k in range(self._function.n_out())]
        self._library: ctypes.PyDLL | None = None
        self._loaded = self._looked = load is no_library
        self._idle_machines: dict[int, deque[_VirtualMachine]] = {}
        self._widths = [rows if cols == 1 else 0 for _, (rows, cols) in self._inputs]
        self._pointers_in = ctypes.c_void_p * len(self._inputs)
        self._pointers_out = ctypes.c_void_p * len(self._outputs)
        self._longs_in = ctypes.c_longlong * len(self._inputs)
        self._strides_out = _long_array([rows * cols for rows, cols in self._outputs])
        self._idle_buffers = deque([self._new_buffers()], MOST_IDLE)

    @classmethod
    def interpreted(cls, function: ca.Function) -> "Compiled":
        """The function without C, for rarely called expressions."""
        return cls(function, no_library, kept=no_library)

    @classmethod
    def late(cls, function: ca.Function) -> "Compiled":
        """The function without C until a compiler would have repaid."""
        return cls(function, patience=WORTH_COMPILING, kept=no_library)

    @property
    def input_shapes(self) -> list[tuple[int, int]]:
        """Rows and columns of every input."""
        return [shape for _, shape in self._inputs]

    @property
    def output_shapes(self) -> list[tuple[int, int]]:
        """Rows and columns of every output."""
        return self._outputs

    @property
    def function(self) -> ca.Function:
        """The expression, every output dense."""
        return self._function

    @property
    def is_c(self) -> bool:
        """Whether calls run generated C (True) or CasADi's virtual machine (False). Compiles on first use."""
        self.build()
        return self._library is not None

    @property
    def loop(self) -> int | None:
        """Address of the compiled loop, for other compiled code to call; None where there is none."""
        self.build()
        return self._library and ctypes.cast(self._library.spinfilters_loop, ctypes.c_void_p).value

    def build(self) -> None:
        """Make the library now, where it otherwise would be made at the first call."""
        if not self._loaded:
            with building():
                if not self._loaded:
                    self._library = self._load(self._function)
                    self._loaded = True

    def _look(self) -> None:
        """Take the library, made now if need be; with patience only one that is there already."""
        with building():
            if not self._looked and not self._loaded:
                self._library = (self._load if self._patience <= 0 else self._kept)(self._function)
                self._loaded = self._library is not None or self._patience <= 0
            self._looked = True

    def __reduce__(self) -> tuple[type["Compiled"], tuple[ca.Function, Loader, int, Loader]]:
        """Buffers and libraries do not pickle: another process builds its own from the expression."""
        return Compiled, (self._function, self._load, self._patience, self._kept)

    def __call__(self, *arguments: np.ndarray | float) -> tuple[np.ndarray, ...]:
        """Evaluate; returns one array per output (see the class for shapes)."""
        if not self._looked:
            self._look()
        if self._library is not None:
            # taken out and put back in one step each, so that no other thread has the same; lost, if the call fails
            idle = self._idle_buffers
            try:
                bound = idle.pop()
            except IndexError:
                bound = self._new_buffers()
            results = bound.run(self._library, self._strides_out) if bound.accept(arguments) else None
            idle.append(bound)
            if results is not None:
                return results
        if len(arguments) != len(self._inputs):
            raise ShapeError(f"{self.name} takes {len(self._inputs)} arguments, got {len(arguments)}")
        count, strides = _plain_batch(arguments, self._widths)
        if count:
            results = self._empty_results(count)
            self._run(count, arguments, strides, results)
            return tuple([result if result.ndim == 2 else result.swapaxes(1, 2) for result in results])
        arrays = [self._column_major(k, argument) for k, argument in enumerate(arguments)]
        batch, arrays, strides = _broadcast(arrays, [size for _, size in self._inputs])
        count = math.prod(batch)
        results = self._empty_results(count)
        if count:
            self._run(count, arrays, strides, results)
        return tuple(self._natural(k, result, batch) for k, result in enumerate(results))

    def _new_buffers(self) -> "_BoundBuffers":
        return _BoundBuffers([size for _, size in self._inputs], self._outputs)

    def _empty_results(self, count: int) -> list[np.ndarray]:
        """Room for each output of ``count`` items, (count, rows), or column by column (count, cols, rows)."""
        return [
            np.empty((count, rows)) if cols == 1 else np.empty((count, cols, rows))
            for rows, cols in self._outputs
        ]

    def _run(self, count: int, arrays: Sequence[Any], strides: list[int], results: list[np.ndarray]) -> None:
        if self._library is not None:
            self._run_library(count, arrays, strides, results)
            return
        # the virtual machine takes stretches of the batch; a shared argument (stride 0) goes whole to each
        flat, first = [a.reshape(-1) for a in arrays], 0
        while first < count and self._library is None:
            stop = min(first + MOST_MAPPED, count)
            taken = [a[s * first : s * stop] if s else a for a, s in zip(flat, strides, strict=True)]
            self._interpret(stop - first, taken, strides, [result[first:stop] for result in results])
            if not self._loaded:
                self._patience -= stop - first
                if self._patience < 0:
                    self.build()
            first = stop
        if first < count:
            taken = [a[s * first :] if s else a for a, s in zip(flat, strides, strict=True)]
            self._run_library(count - first, taken, strides, [result[first:] for result in results])

    def _run_library(
        self, count: int, arrays: Sequence[Any], strides: list[int], results: list[np.ndarray]
    ) -> None:
        assert self._library is not None
        flag = self._library.spinfilters_loop(
            ctypes.c_longlong(count),
            self._pointers_in(*map(address, arrays)),
            self._longs_in(*strides),
            self._pointers_out(*map(address, results)),
            self._strides_out,
        )
        if flag:
            raise MemoryError(f"{self.name}: no memory for its work arrays")

    def _interpret(
        self, count: int, arrays: Sequence[Any], strides: list[int], results: list[np.ndarray]
    ) -> None:
        """Evaluate at most `MOST_MAPPED` items by CasADi's virtual machine."""
        idle = self._machines(count)
        try:
            machine = idle.pop()
        except IndexError:
            machine = self._new_machine(count)
        full = [_repeated(a, count, stride) for a, stride in zip(arrays, strides, strict=True)]
        for k, array in enumerate(full):
            machine.buffer.set_arg(k, array.data)  # pyright: ignore[reportCallIssue]
        for k, result in enumerate(results):
            machine.buffer.set_res(k, result.data)  # pyright: ignore[reportCallIssue]
        machine.evaluate()
        idle.append(machine)

    def _machines(self, count: int) -> "deque[_VirtualMachine]":
        """Virtual machines of so many items that no thread is using."""
        idle = self._idle_machines.get(count)
        if idle is None:
            if len(self._idle_machines) > 64:
                self._idle_machines.clear()
            idle = self._idle_machines.setdefault(count, deque(maxlen=MOST_IDLE))
        return idle

    def _new_machine(self, count: int) -> "_VirtualMachine":
        with building():  # a buffer takes memory of its own out of the function
            return _VirtualMachine(*(self._function if count == 1 else self._function.map(count)).buffer())

    def _column_major(self, index: int, argument: np.ndarray | float) -> np.ndarray:
        name, (rows, cols) = self._inputs[index]
        array = np.asarray(argument, dtype=np.float64)
        if cols != 1:  # CasADi lays a matrix column by column: its transpose in C order
            if array.shape[-2:] != (rows, cols):
                raise ShapeError(f"{self.name}: {name} must end in shape ({rows}, {cols}), got {array.shape}")
            return np.ascontiguousarray(np.swapaxes(array, -1, -2))
        if rows == 1 and array.ndim == 0:
            return array.reshape(1)
        if array.shape[-1:] != (rows,):
            raise ShapeError(f"{self.name}: {name} must end in shape ({rows},), got {array.shape}")
        return np.ascontiguousarray(array)

    def _natural(self, index: int, result: np.ndarray, batch: tuple[int, ...]) -> np.ndarray:
        rows, cols = self._outputs[index]
        if cols == 1:
            return result.reshape(*batch, rows)
        # back from columns to rows, then from one batch axis to the caller's
        return np.swapaxes(result, 1, 2).reshape(*batch, rows, cols)


class _VirtualMachine(NamedTuple):
    """Addresses of arguments and results, and what evaluates the function there."""

    buffer: Any
    evaluate: Callable[[], None]


class _BoundBuffers:
    """Fixed input and output buffers of a single evaluation: no pointer is looked up per call."""

    def __init__(self, inputs: list[tuple[int, int]], outputs: list[tuple[int, int]]) -> None:
        flat_in = [np.zeros((cols, rows)) for rows, cols in inputs]
        flat_out = [np.zeros((cols, rows)) for rows, cols in outputs]
        self._inputs = [b[0] if b.shape[0] == 1 else b.T for b in flat_in]
        self._outputs = [b[0] if b.shape[0] == 1 else b.T for b in flat_out]
        self._shapes = [b.shape for b in self._inputs]
        self._pointers_in, self._pointers_out = _pointers(flat_in), _pointers(flat_out)
        self._no_strides = _long_array([0] * len(inputs))
        self._one = ctypes.c_longlong(1)

    def accept(self, arguments: tuple[np.ndarray | float, ...]) -> bool:
        """Copy the arguments in when every one is a single item of its documented shape."""
        if len(arguments) != len(self._shapes):
            return False
        for argument, shape, buffer in zip(arguments, self._shapes, self._inputs, strict=True):
            if isinstance(argument, float) and shape == (1,):
                buffer[0] = argument
            elif isinstance(argument, np.ndarray) and argument.shape == shape:
                buffer[...] = argument
            else:
                return False
        return True

    def run(
        self, library: ctypes.PyDLL, strides_out: ctypes.Array[ctypes.c_longlong]
    ) -> tuple[np.ndarray, ...]:
        """Copies of the outputs at the bound inputs. MemoryError: no work arrays."""
        if library.spinfilters_loop(
            self._one, self._pointers_in, self._no_strides, self._pointers_out, strides_out
        ):
            raise MemoryError("no memory for the work arrays of a compiled function")
        return tuple([buffer.copy() for buffer in self._outputs])


def _densified(function: ca.Function) -> ca.Function:
    names_in = [function.name_in(k) for k in range(function.n_in())]
    names_out = [function.name_out(k) for k in range(function.n_out())]
    symbol = function.sx_in if function.is_a("SXFunction") else function.mx_in
    symbols: list[Any] = [symbol(k) for k in range(function.n_in())]
    dense = [ca.densify(output) for output in function.call(symbols)]
    once = {"cse": function.is_a("SXFunction")}  # of what a derivative writes out many times; the bits stay
    return ca.Function(function.name(), symbols, dense, names_in, names_out, once)


def _plain_batch(arguments: tuple[Any, ...], widths: list[int]) -> tuple[int, list[int]]:
    """Number of items and strides of arguments that can be read in place, (width,) or (count, width); otherwise 0.

    A shortcut for the common case of `_broadcast`, in a fifth of its time.
    """
    count, strides = 0, []
    for array, width in zip(arguments, widths, strict=True):
        if type(array) is not np.ndarray or array.dtype is not _FLOAT or not array.flags.c_contiguous:
            return 0, []
        if array.shape == (width,):
            strides.append(0)
        elif array.ndim == 2 and array.shape[1] == width and count in (0, len(array)):
            count = len(array)
            strides.append(width)
        else:
            return 0, []
    return count, strides


def _broadcast(
    arrays: list[np.ndarray], sizes: list[tuple[int, int]]
) -> tuple[tuple[int, ...], list[np.ndarray], list[int]]:
    """Common batch shape of the arguments, with the arrays and their strides.

    An array that all items share is kept whole with stride 0; any other is expanded to the batch, with the stride of an item.
    """
    # after the batch axes stand one axis of a vector or two of a matrix
    trailing = [1 if cols == 1 else 2 for _, cols in sizes]
    shapes = [array.shape[: array.ndim - t] for array, t in zip(arrays, trailing, strict=True)]
    batch = shapes[0] if shapes else ()
    if any(shape != batch for shape in shapes[1:]):
        try:
            batch = np.broadcast_shapes(*shapes)
        except ValueError as error:
            raise ShapeError(f"batch axes do not broadcast: {', '.join(map(str, shapes))}") from error
    # stride of an item, in numbers: rows times columns, or 0 of what all items share
    expanded, strides = [], []
    for array, shape, t, (rows, cols) in zip(arrays, shapes, trailing, sizes, strict=True):
        shared = math.prod(shape) == 1
        if not shared and shape != batch:
            array = np.ascontiguousarray(np.broadcast_to(array, batch + array.shape[array.ndim - t :]))
        expanded.append(array)
        strides.append(0 if shared else rows * cols)
    return batch, expanded, strides


def _repeated(array: np.ndarray, count: int, stride: int) -> np.ndarray:
    if stride or count == 1:
        return array
    return np.ascontiguousarray(np.broadcast_to(array.reshape(-1), (count, array.size)))


def _pointers(arrays: list[np.ndarray]) -> ctypes.Array[ctypes.c_void_p]:
    return (ctypes.c_void_p * len(arrays))(*map(address, arrays))


def address(array: np.ndarray) -> int:
    """Address of a contiguous array's data."""
    try:
        return ctypes.addressof(ctypes.c_char.from_buffer(array))  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError):  # read-only, or of no size
        return array.__array_interface__["data"][0]


_ADDRESS, _START = ctypes.addressof, ctypes.c_char.from_buffer


def addresses(*arrays: np.ndarray) -> list[int]:
    """`address` of many arrays, in two thirds of the time."""
    try:
        return [_ADDRESS(_START(array)) for array in arrays]  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError):  # one is read-only, or of no size
        return [address(array) for array in arrays]


def _long_array(values: list[int]) -> ctypes.Array[ctypes.c_longlong]:
    return (ctypes.c_longlong * len(values))(*values)
