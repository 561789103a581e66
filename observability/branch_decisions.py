"""Branches and exact exponents of a tape at a point."""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from jaxtyping import Bool, Float

from observability.rational import Rationals, as_floats
from observability.tape import CHOICES, CONDITIONS, Group, Tape, evaluate
from spinfilters.errors import InputError

COMPARED = {"fmax", "fmin", "lt", "le", "eq", "ne"}
PIECEWISE = CHOICES | CONDITIONS


@dataclass(frozen=True)
class BranchDecisions:
    """Decisions of a tape at a batch of points, by the number of the group.

    Attributes
    ----------
    choices: (g, b) whether a piecewise group takes its left operand, or what a condition says.
    exponents: arguments of exp as fractions, register by register, point by point.
    """

    choices: dict[int, Bool[np.ndarray, "g b"]]
    exponents: dict[int, list[Fraction]]


def branch_decisions(tape: Tape, points: list[list[Rationals]]) -> BranchDecisions:
    """The guide of a tape at exact points, given per input and item.

    Raises
    ------
    InputError: at a point where the alternatives of a piecewise expression meet: it has no derivative there.
    """
    operations = {group.operation for group in tape.groups}
    floats = [np.stack([as_floats(item) for item in items], axis=1) for items in points]
    exponents = _exponents(tape, points) if "exp" in operations else {}
    return BranchDecisions(float_branch_decisions(tape, floats).choices, exponents)


def float_branch_decisions(tape: Tape, points: list[Float[np.ndarray, "_ b"]]) -> BranchDecisions:
    """Branch decisions of a tape at points in floats.

    (n, b) per input: without exponents, which floats need not; errors as `branch_decisions`.
    """
    choices: dict[int, Bool[np.ndarray, "g b"]] = {}
    if any(group.operation in PIECEWISE for group in tape.groups):
        registers = evaluate(tape, points)
        for index, group in enumerate(tape.groups):
            choice = _choice(tape.name, group, registers)
            if choice is not None:
                choices[index] = choice
    return BranchDecisions(choices, {})


def _choice(
    name: str, group: Group, registers: Float[np.ndarray, "registers b"]
) -> Bool[np.ndarray, "g b"] | None:
    left, right, out = registers[group.left], registers[group.right], registers[group.out]
    if group.operation in COMPARED and not np.all(left != right):
        raise InputError(
            f"{name} is not differentiable at this point: both sides of {group.operation} are {left[left == right][0]:g}; "
            "move the point"
        )
    match group.operation:
        case "fmax" | "fmin":
            return out == left
        case "fabs":
            if not np.all(left != 0):
                raise InputError(
                    f"{name} is not differentiable at this point: the argument of fabs is 0; move the point"
                )
            return left > 0
        case "if_else_zero":
            return left != 0
        case "lt" | "le" | "eq" | "ne" | "not" | "and" | "or":
            return out != 0
        case _:
            return None


def _exponents(tape: Tape, points: list[list[Rationals]]) -> dict[int, list[Fraction]]:
    """Arguments of every exp, from a pass in fractions over what they depend on."""
    needed = _ancestors(tape)
    passes = [_exact_pass(tape, needed, [items[k] for items in points]) for k in range(len(points[0]))]
    return {
        index: [values[register] for register in group.left for values in passes]
        for index, group in enumerate(tape.groups)
        if group.operation == "exp"
    }


def _ancestors(tape: Tape) -> set[int]:
    needed: set[int] = set()
    for group in reversed(tape.groups):
        for out, left, right in zip(group.out, group.left, group.right, strict=True):
            if group.operation == "exp" or int(out) in needed:
                needed |= {int(left), int(right)}
    return needed


def _exact_pass(tape: Tape, needed: set[int], inputs: list[Rationals]) -> dict[int, Fraction]:
    values = dict(tape.constants)
    for where, item in zip(tape.inputs, inputs, strict=True):
        values |= dict(zip(map(int, where), item, strict=True))
    for group in tape.groups:
        for out, left, right in zip(group.out, group.left, group.right, strict=True):
            if int(out) in needed:
                values[int(out)] = _exactly(tape.name, group.operation, values[int(left)], values[int(right)])
    return values


def _exactly(name: str, operation: str, a: Fraction, b: Fraction) -> Fraction:
    match operation:
        case "add":
            return a + b
        case "sub":
            return a - b
        case "neg":
            return -a
        case "twice":
            return 2 * a
        case "mul":
            return a * b
        case "div":
            return a / b
        case "sq":
            return a * a
        case _:
            raise InputError(
                f"{name}: the argument of exp contains {operation}; keep it rational in the state"
            )
