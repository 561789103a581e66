"""CasADi functions over many rows at once: C code with SIMD lanes, generated, compiled and called on arrays."""

import ctypes
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Sequence
from itertools import accumulate, pairwise
from typing import Any, Final, NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Int

from spinfilters.core.c_library import FLAGS, LANES, NATIVE, load_text
from spinfilters.core.compiled import Compiled, address
from spinfilters.core.errors import ShapeError
from spinfilters.core.large_arrays import LARGE, pooled_array
from spinfilters.core.working_time import built_property

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

_LANES = """
#include <math.h>
{turn}
void spinfilters_lanes(long long n, const double* const* base, const long long* width, const long long* const* row,
                       double* const* out) {{
  for (long long first = 0; first < n; first += {lanes}) {{
    long long live = n - first < {lanes} ? n - first : {lanes};
    double a[{used}][{lanes}], r[{made}][{lanes}];
    for (int l = 0; l < {lanes}; ++l) {{
      long long i = first + (l < live ? l : 0);
{items}
{gather}
    }}
    #pragma omp simd
    for (int l = 0; l < {lanes}; ++l) {{
{body}
    }}
    for (int l = 0; l < live; ++l) {{
      long long i = first + l;
{behind}
{scatter}
    }}
    if (live == {lanes}) {{
{wide}
    }}
  }}
}}
"""

_FOLD = """
#include <math.h>
#include <string.h>
{turning}
void spinfilters_lanes(long long n, const double* const* base, const long long* width, const long long* const* row,
                       double* const* out, long long turns, const double* each) {{
  (void)row;
  for (long long first = 0; first < n; first += {lanes}) {{
    long long live = n - first < {lanes} ? n - first : {lanes};
    double a[{used}][{lanes}], x[{state}][{lanes}], y[{state}][{lanes}], s[{same}][{lanes}], r[{made}][{lanes}];
    for (int l = 0; l < {lanes}; ++l) {{
      long long i = first + (l < live ? l : 0);
{gather}
    }}
    #pragma omp simd
    for (int l = 0; l < {lanes}; ++l) {{
{begin}
    }}
    for (long long turn = 0; turn < turns; ++turn, each += {numbers}) {{
      #pragma omp simd
      for (int l = 0; l < {lanes}; ++l) {{
{turn}
      }}
      memcpy(x, y, sizeof(x));
    }}
    each -= turns * {numbers};
    #pragma omp simd
    for (int l = 0; l < {lanes}; ++l) {{
{end}
    }}
    for (int l = 0; l < live; ++l) {{
      long long i = first + l;
{scatter}
    }}
    if (live == {lanes}) {{
{wide}
    }}
  }}
}}
"""

_TURN = """
typedef double lanes_of __attribute__((vector_size(8 * {lanes}), aligned(8)));
#if defined(__clang__) || __GNUC__ >= 12
#define MIX(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#else
typedef long long picks_of __attribute__((vector_size(8 * {lanes})));
#define MIX(a, b, ...) __builtin_shuffle(a, b, (picks_of){{__VA_ARGS__}})
#endif
/* Numbers r [{lanes}][{lanes}] of items side by side into the rows of the items, `width` apart: squares beside the diagonal,
 * of one, two, four ..., change places. */
static inline __attribute__((always_inline)) void turn(double (*r)[{lanes}], double* out, long long width) {{
  lanes_of x[{lanes}], y[{lanes}];
  for (int k = 0; k < {lanes}; ++k) x[k] = *(lanes_of*)r[k];
{stages}
  for (int k = 0; k < {lanes}; ++k) *(lanes_of*)(out + k * width) = x[k];
}}
"""

_Place = Callable[[int, int], str]
"""C of one component of an input or output."""


def simd_text(function: ca.Function, reciprocals: bool = False) -> str | None:
    """C of a function's loop over items; None where the function has an operation without a C form here.

    Parameters
    ----------
    reciprocals : bool
        Whether to divide by a number that divides more than once through its reciprocal, which changes last bits.
    """
    gather: list[str] = []

    def taken(which: int, place: int) -> str:
        """C of an argument, which is gathered."""
        gather.append(f"      a[{len(gather)}][l] = at{which}[{place}];")
        return f"a[{len(gather) - 1}][l]"

    made = _offsets(function.numel_out(k) for k in range(function.n_out()))
    late = _late_logarithms(function)
    body = _tape(function, taken, lambda which, place: f"r[{made[which] + place}][l]", late, reciprocals)
    if body is None:
        return None
    places = [made[which] + place for which, place in late.values()]
    items = [
        f"      const double* at{k} = base[{k}] + (row[{k}] ? row[{k}][i] : i) * width[{k}];"
        for k in range(function.n_in())
    ]
    return _LANES.format(
        lanes=LANES,
        items="\n".join(items),
        used=max(len(gather), 1),
        made=max(made[-1], 1),
        gather="\n".join(gather),
        body=body,
        behind="\n".join(f"      r[{place}][l] = log(r[{place}][l]);" for place in places),
        scatter=_scatter(made),
        wide=_scatter_wide(made),
        turn=_turn_text(made),
    )


def _late_logarithms(function: ca.Function) -> dict[int, tuple[int, int]]:
    """Instructions that take the logarithm of an output, and nothing else does: with the output and the place in it.

    They are left to the loop that writes the outputs: no vector instructions are made of a loop that calls a function.
    """
    every = range(function.n_instructions()) if function.is_a("SXFunction") else ()
    if all(function.instruction_id(k) != ca.OP_LOG for k in every):
        return {}
    written: dict[int, int] = {}  # work number -> the logarithm that is in it
    found: dict[int, list[int]] = {}  # logarithm -> instructions that read it
    for k in range(function.n_instructions()):
        op, takes = function.instruction_id(k), function.instruction_input(k)
        if op != ca.OP_INPUT and op != ca.OP_CONST:
            for number in takes[:1] if op == ca.OP_OUTPUT else takes:
                if number in written:
                    found[written[number]].append(k)
        if op == ca.OP_OUTPUT:
            continue
        for number in function.instruction_output(k):
            written.pop(number, None)
            if op == ca.OP_LOG:
                written[number] = k
                found[k] = []
    late = {}
    for k, readers in found.items():
        if len(readers) == 1 and function.instruction_id(readers[0]) == ca.OP_OUTPUT:
            which, place = function.instruction_output(readers[0])
            late[k] = (which, place)
    return late


def scan_text(
    begin: ca.Function, turn: ca.Function, end: ca.Function, reciprocals: bool = False
) -> str | None:
    """C of the loop over items of a `spinfilters.core.vectorised.VectorisedScan`, or None as in `simd_text`."""
    widths = [begin.numel_in(k) for k in range(begin.n_in())]
    given, kept = _offsets(widths), _offsets(begin.numel_out(k) for k in range(1, begin.n_out()))
    made = _offsets(end.numel_out(k) for k in range(end.n_out()))
    bodies = _scan_bodies(_Scanned(begin, turn, end, reciprocals), given, kept, made)
    if None in bodies.values():
        return None
    gather = [
        f"      for (int c = 0; c < {width}; ++c) a[{given[k]} + c][l] = base[{k}][i * width[{k}] + c];"
        for k, width in enumerate(widths)
    ]
    return _FOLD.format(
        lanes=LANES,
        used=max(given[-1], 1),
        state=begin.numel_out(0),
        same=max(kept[-1], 1),
        made=max(made[-1], 1),
        numbers=turn.numel_in(begin.n_out()),
        gather="\n".join(gather),
        scatter=_scatter(made),
        wide=_scatter_wide(made),
        turning=_turn_text(made),
        **bodies,
    )


class _Scanned(NamedTuple):
    """Functions of a scan: before the loop, of a step, after it."""

    begin: ca.Function
    turn: ca.Function
    end: ca.Function
    reciprocals: bool


def _scan_bodies(
    scan: _Scanned, given: Sequence[int], kept: Sequence[int], made: Sequence[int]
) -> dict[str, str | None]:
    """C of the three functions.

    Parameters
    ----------
    given, kept, made : Sequence[int]
        Places of the inputs, of what ``begin`` keeps for all steps, and of the outputs.
    """
    last, inputs = scan.begin.n_out(), scan.begin.n_in()

    def of_turn(which: int, place: int) -> str:
        """Place of an input of a step."""
        if which == 0:
            return f"x[{place}][l]"
        return f"each[{place}]" if which == last else f"s[{kept[which - 1] + place}][l]"

    def at_end(which: int, place: int) -> str:
        """Place of an input before or after the loop."""
        return f"x[{place}][l]" if which == inputs else f"a[{given[which] + place}][l]"

    return {
        "begin": _tape(
            scan.begin,
            at_end,
            lambda k, place: f"s[{kept[k - 1] + place}][l]" if k else f"x[{place}][l]",
            (),
            scan.reciprocals,
        ),
        "turn": _tape(scan.turn, of_turn, lambda _, place: f"y[{place}][l]", (), scan.reciprocals),
        "end": _tape(
            scan.end, at_end, lambda which, place: f"r[{made[which] + place}][l]", (), scan.reciprocals
        ),
    }


def _offsets(sizes: Iterable[int]) -> list[int]:
    return [0, *accumulate(sizes)]


def _scatter(made: list[int]) -> str:
    """Outputs of item i; those that are as wide as a vector only where no vector of items is full."""
    return "\n".join(
        ("      " if stop - start < LANES else f"      if (live < {LANES}) ")
        + f"for (int c = 0; c < {stop - start}; ++c) out[{k}][i * {stop - start} + c] = r[{start} + c][l];"
        for k, (start, stop) in enumerate(pairwise(made))
    )


def _scatter_wide(made: list[int]) -> str:
    """Outputs as wide as a vector, of a full vector of items; the last square ends where the output ends."""
    lines = []
    for k, (start, stop) in enumerate(pairwise(made)):
        width = stop - start
        places = [*range(0, width - LANES, LANES), width - LANES] if width >= LANES else []
        lines += [
            f"      turn(r + {start + place}, out[{k}] + first * {width} + {place}, {width});"
            for place in places
        ]
    return "\n".join(lines)


def _turn_text(made: list[int]) -> str:
    """C of `turn`, where an output is wide enough for it."""
    if all(stop - start < LANES for start, stop in pairwise(made)):
        return ""
    stages, side = [], 1
    while side < LANES:
        # rows k and k + side: their squares beside the diagonal change places
        low = [j if not j & side else j - side + LANES for j in range(LANES)]
        high = [j + side if not j & side else j + LANES for j in range(LANES)]
        stages.append(
            f"  for (int k = 0; k < {LANES}; ++k)\n    if (!(k & {side})) {{\n"
            f"      y[k] = MIX(x[k], x[k + {side}], {', '.join(map(str, low))});\n"
            f"      y[k + {side}] = MIX(x[k], x[k + {side}], {', '.join(map(str, high))});\n    }}\n"
            f"  for (int k = 0; k < {LANES}; ++k) x[k] = y[k];"
        )
        side *= 2
    return _TURN.format(lanes=LANES, stages="\n".join(stages))


def _tape(
    function: ca.Function,
    take: _Place,
    give: _Place,
    passed: Collection[int] = (),
    reciprocals: bool = False,
) -> str | None:
    """The instructions of a function in C, one a line; those that are passed hand their argument on."""
    if not function.is_a("SXFunction"):
        return None
    lines = ["double " + ", ".join(f"w{k}" for k in range(max(function.sz_w(), 1))) + ";"]
    divisors, known = _shared_divisors(function) if reciprocals else {}, set[int]()
    for k in range(function.n_instructions()):
        line = _line(function, k, take, give)
        if k in divisors:
            (first, (numerator, divisor)), (made,) = (
                (divisors[k], function.instruction_input(k)),
                function.instruction_output(k),
            )
            if first not in known:
                known.add(first)
                lines.append(f"const double d{first} = 1./w{divisor};")
            line = f"w{made} = w{numerator}*d{first};"
        if k in passed:
            line = f"w{function.instruction_output(k)[0]} = w{function.instruction_input(k)[0]};"
        if line is None:
            return None
        lines.append(line)
    return "\n".join(f"        {line}" for line in lines)


def _shared_divisors(function: ca.Function) -> dict[int, int]:
    """Divisions by a number that divides more than once: instruction -> the first one that divides by the same number."""
    written: dict[int, int] = {}  # work number -> the instruction that wrote it last
    by_divisor: dict[int, list[int]] = {}  # instruction -> divisions by what it wrote
    for k in range(function.n_instructions()):
        if function.instruction_id(k) == ca.OP_DIV:
            by_divisor.setdefault(written[function.instruction_input(k)[1]], []).append(k)
        if function.instruction_id(k) != ca.OP_OUTPUT:
            written |= dict.fromkeys(function.instruction_output(k), k)
    shared = [divisions for divisions in by_divisor.values() if len(divisions) > 1]
    return {k: divisions[0] for divisions in shared for k in divisions}


def _line(function: ca.Function, k: int, take: _Place, give: _Place) -> str | None:
    op, takes, gives = (
        function.instruction_id(k),
        function.instruction_input(k),
        function.instruction_output(k),
    )
    if op == ca.OP_CONST:
        return f"w{gives[0]} = {function.instruction_constant(k)!r};"
    if op == ca.OP_INPUT:
        return f"w{gives[0]} = {take(*takes)};"
    if op == ca.OP_OUTPUT:
        return f"{give(*gives)} = w{takes[0]};"
    if op not in _FORMS:
        return None
    return f"w{gives[0]} = {_FORMS[op].format(*[f'w{t}' for t in takes])};"


SIMD_FLAGS = (*FLAGS, "-O3", NATIVE, "-fopenmp-simd", "-fno-math-errno", "-fno-trapping-math")


class _GeneratedLoop(ABC):
    """A loop over items in generated C, which is compiled on first use."""

    @property
    def is_c(self) -> bool:
        """Whether calls run generated C. Compiles on first use."""
        return self._library is not None

    @built_property
    def loop(self) -> int | None:
        """Address of the compiled loop, for other compiled code to call; None where there is none."""
        return self._library and ctypes.cast(self._library.spinfilters_lanes, ctypes.c_void_p).value

    def build(self) -> None:
        """Compile or load it now, as before a clock runs; without a compiler nothing."""
        _ = self.loop

    @built_property
    def _library(self) -> ctypes.PyDLL | None:
        """The compiled loop; None where there is none."""
        text, name = self._text()
        return None if text is None else load_text(name, text, SIMD_FLAGS)

    @abstractmethod
    def _text(self) -> tuple[str | None, str]:
        """C of the loop, None where an instruction has none, and the name of its library."""


class Vectorised(_GeneratedLoop):
    """One function whose inputs and outputs are columns of numbers, for items in rows.

    Parameters
    ----------
    function : ca.Function
        An SX function; an input of n numbers takes an array (k, n), outputs come as (k, n), matrices column by
        column.
    reciprocals : bool
        As of `simd_text`.

    Attributes
    ----------
    widths : list[int]
        How many numbers each input has.
    """

    def __init__(self, function: ca.Function, reciprocals: bool = False) -> None:
        self.name: str = function.name()
        self._reciprocals = reciprocals
        self._plain = Compiled(function)
        self._function = function
        self.widths: list[int] = [function.numel_in(k) for k in range(function.n_in())]
        self._made = [function.numel_out(k) for k in range(function.n_out())]

    def __reduce__(self) -> tuple[type["Vectorised"], tuple[ca.Function, bool]]:
        """A library does not pickle: another process builds its own from the expression."""
        return Vectorised, (self._function, self._reciprocals)

    def __call__(
        self, *arguments: np.ndarray, rows: tuple[Int[np.ndarray, " n"] | None, ...]
    ) -> tuple[np.ndarray, ...]:
        """Evaluate for n items.

        Parameters
        ----------
        arguments : np.ndarray
            (k, width) each.
        rows : tuple[Int[np.ndarray, ' n'] | None, ...]
            Per argument, (n,) which of its rows an item takes, or None where item i takes row i, or all items the
            only one.

        Raises
        ------
        ShapeError
            For a wrong number or width of arguments, or rows that do not fit.
        """
        count = self._count(arguments, rows)
        if self._library is None:
            return _interpreted(self._plain, arguments, rows)
        return _run(self._library, arguments, rows, [(count, made) for made in self._made])

    @property
    def function(self) -> ca.Function:
        """The expression, for others to be made of it."""
        return self._function

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

    def _text(self) -> tuple[str | None, str]:
        return simd_text(self._plain.function, self._reciprocals), f"{self.name}_lanes"


class VectorisedScan(_GeneratedLoop):
    """Scan: an initial state, a repeated body, and an output, for many items side by side.

    Every input and output is a column of numbers, of an item (k, n), or of all of them (1, n).

    Parameters
    ----------
    begin : ca.Function
        Of the inputs; gives the state x, then columns that stay the same.
    turn : ca.Function
        Of x, of those columns, and of a last column of numbers that are others in every turn; gives the next x.
    end : ca.Function
        Of the inputs and x; gives what is wanted.
    reciprocals : bool
        As of `simd_text`.
    """

    def __init__(
        self, begin: ca.Function, turn: ca.Function, end: ca.Function, reciprocals: bool = False
    ) -> None:
        self.name: str = turn.name()
        self._reciprocals = reciprocals
        self._functions = (begin, turn, end)
        self._plain = [Compiled(function) for function in self._functions]
        self._widths = [begin.numel_in(k) for k in range(begin.n_in())]
        self._made = [end.numel_out(k) for k in range(end.n_out())]
        self._numbers: int = turn.numel_in(turn.n_in() - 1)

    def __reduce__(
        self,
    ) -> tuple[type["VectorisedScan"], tuple[ca.Function, ca.Function, ca.Function, bool]]:
        """A library does not pickle: another process builds its own from the expressions."""
        return VectorisedScan, (*self._functions, self._reciprocals)

    def __call__(self, *arguments: np.ndarray, each: np.ndarray) -> tuple[np.ndarray, ...]:
        """Evaluate for k items.

        Parameters
        ----------
        each : np.ndarray
            (turns, numbers) of every turn.

        Raises
        ------
        ShapeError
            For a wrong number, length or width of arguments, or of the numbers of turns.
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

    @property
    def output_widths(self) -> list[int]:
        """Numbers of each output of an item."""
        return self._made

    def bound(
        self, arguments: Sequence[np.ndarray], results: Sequence[np.ndarray], each: np.ndarray
    ) -> Callable[[], None] | None:
        """A call of the compiled scan on these very arrays, for thousands of short calls; None without compiled code.

        Parameters
        ----------
        arguments, results : Sequence[np.ndarray]
            Contiguous arrays of float, (k, width) each, or (1, width) of an argument that all items share. A result may be an
            argument: an item's results are written after its arguments have been read.
        each : np.ndarray
            As of a call.
        """
        if self._library is None:
            return None
        given = _call_arguments(arguments, (None,) * len(arguments), results, each)
        kept = (arguments, results, each)  # as long as the call
        run = self._library.spinfilters_lanes
        return lambda _kept=kept: run(*given)

    def _interpreted(self, arguments: list[np.ndarray], each: np.ndarray) -> tuple[np.ndarray, ...]:
        begin, turn, end = self._plain
        x, *same = begin(*arguments)
        for numbers in each:
            (x,) = turn(x, *same, np.tile(numbers, (len(x), 1)))
        return end(*arguments, x)

    def _text(self) -> tuple[str | None, str]:
        begin, turn, end = (plain.function for plain in self._plain)
        return scan_text(begin, turn, end, self._reciprocals), f"{self.name}_fold"


LARGEST_LENT: Final = 1 << 20
"""Numbers of a result, 8 MB, above which it has memory of its own, that is given back when the result is gone."""
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
    results = tuple([result_array(*shape) for shape in shapes])
    turned = None if each is None else _plain(each, _FLOAT)
    library.spinfilters_lanes(*_call_arguments(arrays, chosen, results, turned))
    return results


def result_array(count: int, width: int) -> np.ndarray:
    """Room for a result of many items, lent where it is of some size."""
    return pooled_array(count, width) if LARGE <= count * width <= LARGEST_LENT else np.empty((count, width))


def _call_arguments(
    arrays: Sequence[np.ndarray],
    rows: Sequence[np.ndarray | None],
    results: Sequence[np.ndarray],
    each: np.ndarray | None,
) -> tuple[Any, ...]:
    """Arguments of the generated function for plain arrays, which must be kept as long as they are used."""
    pointers, longs = ctypes.c_void_p * len(arrays), ctypes.c_longlong * len(arrays)
    return (
        ctypes.c_longlong(len(results[0])),
        pointers(*[address(array) for array in arrays]),
        longs(
            *[0 if len(a) == 1 and row is None else a.shape[1] for a, row in zip(arrays, rows, strict=True)]
        ),
        pointers(*[None if row is None else address(row) for row in rows]),
        (ctypes.c_void_p * len(results))(*[address(result) for result in results]),
        *(() if each is None else (ctypes.c_longlong(len(each)), ctypes.c_void_p(address(each)))),
    )


def _interpreted(
    plain: Compiled, arguments: tuple[np.ndarray, ...], rows: tuple[np.ndarray | None, ...]
) -> tuple[np.ndarray, ...]:
    """The same without lanes; matrices lie column by column in the rows of arguments and results."""
    # rows of the arguments as the lanes would gather them, each matrix from columns to rows
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
