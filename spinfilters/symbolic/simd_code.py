"""SIMD code generator: a CasADi function's tape as C over items side by side."""

from collections.abc import Callable, Iterable, Sequence
from itertools import accumulate, pairwise
from typing import NamedTuple

import casadi as ca

LANES = 8
"""Items side by side: one vector of 512 bits, two of 256."""

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
{scatter}
    }}
  }}
}}
"""

_FOLD = """
#include <math.h>
#include <string.h>
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
  }}
}}
"""

_Place = Callable[[int, int], str]
"""C of one component of an input or output."""


def simd_text(function: ca.Function) -> str | None:
    """C of a function's loop over items, or None.

    None where its tape holds an operation that is not known here.
    """
    gather: list[str] = []

    def taken(which: int, place: int) -> str:
        """C of an argument, which is gathered."""
        gather.append(f"      a[{len(gather)}][l] = at{which}[{place}];")
        return f"a[{len(gather) - 1}][l]"

    made = _offsets(function.numel_out(k) for k in range(function.n_out()))
    body = _tape(function, taken, lambda which, place: f"r[{made[which] + place}][l]")
    if body is None:
        return None
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
        scatter=_scatter(made),
    )


def scan_text(begin: ca.Function, turn: ca.Function, end: ca.Function) -> str | None:
    """C of the loop over items of a `spinfilters.symbolic.vectorised.VectorisedScan`, or None as in `simd_text`."""
    widths = [begin.numel_in(k) for k in range(begin.n_in())]
    given, kept = _offsets(widths), _offsets(begin.numel_out(k) for k in range(1, begin.n_out()))
    made = _offsets(end.numel_out(k) for k in range(end.n_out()))
    bodies = _scan_bodies(_Scanned(begin, turn, end), given, kept, made)
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
        **bodies,
    )


class _Scanned(NamedTuple):
    """Functions of a scan: before the loop, of a step, after it."""

    begin: ca.Function
    turn: ca.Function
    end: ca.Function


def _scan_bodies(
    scan: _Scanned, given: Sequence[int], kept: Sequence[int], made: Sequence[int]
) -> dict[str, str | None]:
    """C of the three functions.

    Parameters
    ----------
    given, kept, made: places of the inputs, of what ``begin`` keeps for all steps, and of the outputs.
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
            scan.begin, at_end, lambda k, place: f"s[{kept[k - 1] + place}][l]" if k else f"x[{place}][l]"
        ),
        "turn": _tape(scan.turn, of_turn, lambda _, place: f"y[{place}][l]"),
        "end": _tape(scan.end, at_end, lambda which, place: f"r[{made[which] + place}][l]"),
    }


def _offsets(sizes: Iterable[int]) -> list[int]:
    return [0, *accumulate(sizes)]


def _scatter(made: list[int]) -> str:
    return "\n".join(
        f"      for (int c = 0; c < {stop - start}; ++c) out[{k}][i * {stop - start} + c] = r[{start} + c][l];"
        for k, (start, stop) in enumerate(pairwise(made))
    )


def _tape(function: ca.Function, take: _Place, give: _Place) -> str | None:
    """The instructions of a function in C, one a line."""
    if not function.is_a("SXFunction"):
        return None
    lines = ["double " + ", ".join(f"w{k}" for k in range(max(function.sz_w(), 1))) + ";"]
    for k in range(function.n_instructions()):
        line = _line(function, k, take, give)
        if line is None:
            return None
        lines.append(line)
    return "\n".join(f"        {line}" for line in lines)


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
