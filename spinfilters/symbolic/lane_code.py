"""The instruction tape of a CasADi function written out as C whose inner loop runs over items, side by side."""

import casadi as ca
import numpy as np

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
