"""A CasADi function of scalars evaluated for many items side by side, in the lanes of vector instructions.

CasADi's own C handles one item after the other. Here the instruction tape of the same expression is written out as the body of a
loop that a compiler turns into vector instructions: no formula is typed twice, and every operation rounds as in CasADi's virtual
machine.
"""

import ctypes
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Int

from spinfilters.errors import ShapeError
from spinfilters.symbolic.c_library import FLAGS, NATIVE, load_text
from spinfilters.symbolic.compiled import Compiled, address

LANES = 8
"""Items side by side: one vector of 512 bits, two of 256."""
LANE_FLAGS = (*FLAGS, "-O3", NATIVE, "-fopenmp-simd", "-fno-math-errno", "-fno-trapping-math")

_BINARY = {ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/", ca.OP_LT: "<", ca.OP_LE: "<="}
_COMPARED = {ca.OP_EQ: "==", ca.OP_NE: "!=", ca.OP_AND: "&&", ca.OP_OR: "||"}
_FORMS = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0}*{0}",
    ca.OP_TWICE: "2.*{0}",
    ca.OP_INV: "1./{0}",
    ca.OP_SQRT: "sqrt({0})",
    ca.OP_FABS: "fabs({0})",
    ca.OP_NOT: "!{0}",
    ca.OP_FMIN: "({0}<{1}?{0}:{1})",
    ca.OP_FMAX: "({0}>{1}?{0}:{1})",
    ca.OP_IF_ELSE_ZERO: "({0}?{1}:0.)",
    ca.OP_SIGN: "({0}>0.?1.:({0}<0.?-1.:{0}))",
    ca.OP_COPYSIGN: "copysign({0},{1})",
    ca.OP_EXP: "exp({0})",
    ca.OP_LOG: "log({0})",
    ca.OP_SIN: "sin({0})",
    ca.OP_COS: "cos({0})",
    ca.OP_TAN: "tan({0})",
    ca.OP_ATAN: "atan({0})",
    ca.OP_ATAN2: "atan2({0},{1})",
    ca.OP_POW: "pow({0},{1})",
    ca.OP_CONSTPOW: "pow({0},{1})",
    **{op: f"{{0}}{sign}{{1}}" for op, sign in (_BINARY | _COMPARED).items()},
}

_TEXT = """
#include <math.h>
void spinfilters_lanes(long long n, const double* const* base, const long long* width, const long long* const* row,
                       double* const* out, long long turns, const double* each) {{
  for (long long first = 0; first < n; first += {lanes}) {{
    long long live = n - first < {lanes} ? n - first : {lanes};
    double a[{used}][{lanes}], r[{made}][{lanes}];
    for (int l = 0; l < {lanes}; ++l) {{
      long long i = first + (l < live ? l : 0);
{items}
{gather}
    }}
    for (long long turn = 0; turn < turns; ++turn) {{
      #pragma omp simd
      for (int l = 0; l < {lanes}; ++l) {{
{body}
      }}
{feedback}
    }}
    for (int l = 0; l < live; ++l) {{
      long long i = first + l;
{scatter}
    }}
  }}
}}
"""


class Lanes:
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

    def __reduce__(self) -> tuple[type["Lanes"], tuple[ca.Function]]:
        """A library does not pickle: another process builds its own from the expression."""
        return Lanes, (self._function,)

    def __call__(
        self, *arguments: np.ndarray, rows: tuple[Int[np.ndarray, " n"] | None, ...]
    ) -> tuple[np.ndarray, ...]:
        """Evaluate for n items.

        Parameters
        ----------
        arguments: (k, width) each.   rows: per argument, (n,) which of its rows an item takes, or None where item i takes row i.

        Raises
        ------
        ShapeError: for a wrong number or width of arguments, or rows that do not fit.
        """
        count = self._count(arguments, rows)
        if self._library is None:
            return _interpreted(self._plain, arguments, rows)
        return _run(self._library, arguments, rows, [(count, made) for made in self._made])

    def _count(self, arguments: tuple[np.ndarray, ...], rows: tuple[np.ndarray | None, ...]) -> int:
        if len(arguments) != len(self.widths) or len(rows) != len(arguments):
            raise ShapeError(f"{self.name} takes {len(self.widths)} arguments with rows for each")
        counts: set[int] = set()
        for argument, row, width in zip(arguments, rows, self.widths, strict=True):
            if argument.ndim != 2 or argument.shape[1] != width:
                raise ShapeError(f"{self.name}: an argument of shape (k, {width}) is {argument.shape}")
            if row is not None and len(row) and not _largest(row) < len(argument):
                raise ShapeError(f"{self.name}: rows {row.min()} to {row.max()} of {len(argument)}")
            counts.add(len(argument) if row is None else len(row))
        if len(counts) != 1:
            raise ShapeError(f"{self.name}: arguments have {sorted(counts)} items; give the same number")
        return counts.pop()

    @cached_property
    def _library(self) -> ctypes.PyDLL | None:
        text = lane_text(self._plain.function)
        return None if text is None else load_text(f"{self.name}_lanes", text, LANE_FLAGS)


class Fold:
    """One function applied again and again to its own result, for many items side by side.

    Parameters
    ----------
    function: an SX function of a column x, any further columns that stay the same, and last a number that is another one in every
        turn; its one output is the next x.
    """

    def __init__(self, function: ca.Function) -> None:
        self.name: str = function.name()
        self._plain = Compiled(function)
        self._function = function
        self.width: int = function.numel_in(0)

    def __reduce__(self) -> tuple[type["Fold"], tuple[ca.Function]]:
        """A library does not pickle: another process builds its own from the expression."""
        return Fold, (self._function,)

    def __call__(self, *arguments: np.ndarray, each: np.ndarray) -> np.ndarray:
        """x (k, width) after len(each) turns; every argument is (k, width of its input)."""
        if self._library is None or not len(each):
            x, same = arguments[0].copy(), (None,) * (len(arguments) + 1)
            for number in each:
                turn = np.full((len(x), 1), float(number))
                (x,) = _interpreted(self._plain, (x, *arguments[1:], turn), same)
            return x
        every = (*arguments, np.zeros((len(arguments[0]), 1)))
        return _run(self._library, every, (None,) * len(every), [(len(arguments[0]), self.width)], each)[0]

    @cached_property
    def _library(self) -> ctypes.PyDLL | None:
        text = lane_text(self._plain.function, folded=True)
        return None if text is None else load_text(f"{self.name}_fold", text, LANE_FLAGS)


_NO_TURNS = np.zeros(1)
_FLOAT, _INTEGER = np.dtype(np.float64), np.dtype(np.int64)


def _run(
    library: ctypes.PyDLL,
    arguments: tuple[np.ndarray, ...],
    rows: tuple[np.ndarray | None, ...],
    shapes: list[tuple[int, int]],
    each: np.ndarray = _NO_TURNS,
) -> tuple[np.ndarray, ...]:
    arrays = [_plain(argument, _FLOAT) for argument in arguments]
    chosen = [None if row is None else _plain(row, _INTEGER) for row in rows]
    results, each = tuple(np.empty(shape) for shape in shapes), _plain(each, _FLOAT)
    pointers, longs = ctypes.c_void_p * len(arrays), ctypes.c_longlong * len(arrays)
    library.spinfilters_lanes(
        ctypes.c_longlong(shapes[0][0]),
        pointers(*[address(array) for array in arrays]),
        longs(*[array.shape[1] for array in arrays]),
        pointers(*[None if row is None else address(row) for row in chosen]),
        (ctypes.c_void_p * len(results))(*[address(result) for result in results]),
        ctypes.c_longlong(len(each)),
        ctypes.c_void_p(address(each)),
    )
    return results


def _interpreted(
    plain: Compiled, arguments: tuple[np.ndarray, ...], rows: tuple[np.ndarray | None, ...]
) -> tuple[np.ndarray, ...]:
    """The same without lanes; matrices lie column by column in the rows of arguments and results."""
    taken = [a if row is None else a[row] for a, row in zip(arguments, rows, strict=True)]
    for k, array in enumerate(taken):
        high, wide = plain.function.size_in(k)
        if wide != 1:
            taken[k] = array.reshape(len(array), wide, high).swapaxes(1, 2)
    results = plain(*taken)
    made = [plain.function.numel_out(k) for k in range(len(results))]
    pairs = zip(results, made, strict=True)
    return tuple(result.swapaxes(1, -1).reshape(len(result), width) for result, width in pairs)


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


def lane_text(function: ca.Function, folded: bool = False) -> str | None:
    """C of a function's loop over items, or None where its tape holds an operation that is not known here.

    Parameters
    ----------
    folded: whether the output is the first input of the next turn, and the last input each turn's own number.
    """
    if not function.is_a("SXFunction"):
        return None
    gather: list[str] = []
    last = function.n_in() - 1 if folded else -1
    body = ["      double " + ", ".join(f"w{k}" for k in range(max(function.sz_w(), 1))) + ";"]
    made = np.concatenate([[0], np.cumsum([function.numel_out(k) for k in range(function.n_out())])])
    for k in range(function.n_instructions()):
        line = _line(function, k, gather, made)
        if function.instruction_id(k) == ca.OP_INPUT and function.instruction_input(k)[0] == last:
            line = f"w{function.instruction_output(k)[0]} = each[turn];"
        if line is None:
            return None
        body.append(f"      {line}")
    scatter = [
        f"      for (int c = 0; c < {made[k + 1] - made[k]}; ++c) "
        f"out[{k}][i * {made[k + 1] - made[k]} + c] = r[{made[k]} + c][l];"
        for k in range(function.n_out())
    ]
    items = [
        f"      const double* at{k} = base[{k}] + (row[{k}] ? row[{k}][i] : i) * width[{k}];"
        for k in range(function.n_in())
    ]
    return _TEXT.format(
        lanes=LANES,
        feedback="\n".join(_feedback(function)) if folded else "",
        items="\n".join(items),
        used=max(len(gather), 1),
        made=max(int(made[-1]), 1),
        gather="\n".join(gather),
        body="\n".join(body),
        scatter="\n".join(scatter),
    )


def _feedback(function: ca.Function) -> list[str]:
    """The output put where the first input was gathered."""
    inputs = [
        function.instruction_input(k)
        for k in range(function.n_instructions())
        if function.instruction_id(k) == ca.OP_INPUT
    ]
    loop = f"      for (int l = 0; l < {LANES}; ++l)"
    return [
        f"{loop} a[{slot}][l] = r[{place}][l];" for slot, (which, place) in enumerate(inputs) if which == 0
    ]


def _line(function: ca.Function, k: int, gather: list[str], made: np.ndarray) -> str | None:
    """One instruction in C; an input is added to what is gathered."""
    op, takes, gives = (
        function.instruction_id(k),
        function.instruction_input(k),
        function.instruction_output(k),
    )
    if op == ca.OP_CONST:
        return f"w{gives[0]} = {function.instruction_constant(k)!r};"
    if op == ca.OP_INPUT:
        which, place = takes
        gather.append(f"      a[{len(gather)}][l] = at{which}[{place}];")
        return f"w{gives[0]} = a[{len(gather) - 1}][l];"
    if op == ca.OP_OUTPUT:
        return f"r[{made[gives[0]] + gives[1]}][l] = w{takes[0]};"
    if op not in _FORMS:
        return None
    return f"w{gives[0]} = {_FORMS[op].format(*[f'w{t}' for t in takes])};"
