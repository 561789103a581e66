"""Conditions under which an analysis of equations with max, min, abs or comparisons holds: those of the point it was made at."""

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Final

import casadi as ca
import numpy as np

from observability.model_rank import THOUSANDTHS, ReachedModel, draw_point, projected
from observability.tape import NAMES, PIECEWISE
from observability.written_formulas import written
from spinfilters.core.errors import InputError

LONGEST_CONDITION: Final = 80
"""Characters of a side of a condition that is printed."""
COMPARISONS: Final = {"fmax", "fmin", "lt", "le"}


def branch_conditions(part: ReachedModel) -> list[str]:
    """Inequalities such as "a > b" that hold at the point of an exact rank, one for each place where branches meet."""
    if PIECEWISE.isdisjoint(part.tape.operations):
        return []
    rows = [part.model.rates[each] for each in part.states] + list(part.model.outputs.values())
    sides = list(_sides(rows))
    if not sides:
        return []
    differences = ca.Function("differences", part.arguments, [ca.vertcat(*[a - b for a, b in sides])])
    values = np.array(differences(*_point(part))).ravel()
    texts = [
        f"{_text(a)} {'>' if value > 0 else '<'} {_text(b)}"
        for (a, b), value in zip(sides, values, strict=True)
    ]
    return list(dict.fromkeys(texts))


def _sides(rows: Sequence[ca.SX]) -> Iterator[tuple[ca.SX, ca.SX]]:
    """Both sides of every place where branches meet."""
    waiting, seen = [row[k] for row in map(ca.SX, rows) for k in range(row.numel())], set()
    while waiting:
        node = waiting.pop()
        if node.element_hash() in seen:
            continue
        seen.add(node.element_hash())
        if node.is_leaf():
            continue
        operands = [node.dep(k) for k in range(node.n_dep())]
        operation = NAMES[node.op()]
        if operation in COMPARISONS:
            yield operands[0], operands[1]
        elif operation == "fabs":
            yield operands[0], ca.SX(0)
        waiting += operands


def _point(part: ReachedModel) -> list[list[float]]:
    """The point that the exact rank was found at, as floats."""
    point = draw_point(part, np.random.default_rng(0))
    prime, given, found = point.field.prime, part.model.point, []
    for names, values in zip(part.groups, point.values, strict=True):
        numbers = values.p[:, 0].tolist()
        vectors = part.drawn_unit_vectors(names)
        for where in vectors:  # u = x / (1 + x_last), as drawn
            over = pow(1 + numbers[where[-1]], -1, prime)
            for k in where[:-1]:
                numbers[k] = numbers[k] * over % prime
        floats = np.array([float(Fraction(p * THOUSANDTHS % prime, THOUSANDTHS)) for p in numbers])
        for where in vectors:
            floats[where] = projected(floats[where[:-1], np.newaxis])[:, 0]
        pairs = zip(names, floats.tolist(), strict=True)
        found.append([float(given[name]) if name in given else value for name, value in pairs])
    return found


def _text(expression: ca.SX) -> str:
    try:
        text = written(expression)
    except InputError:
        text = str(expression)
    return text if len(text) <= LONGEST_CONDITION else f"{text[:LONGEST_CONDITION]}..."
