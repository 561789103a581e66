"""Instructions of a CasADi expression as groups of array operations, with their branches and exact exponents at a point."""

from collections import defaultdict
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float, Int

from observability.exact_numbers import Rationals, as_floats, rational
from spinfilters.core.errors import InputError

NAMES = {value: name[3:].lower() for name, value in vars(ca).items() if name.startswith("OP_")}
"""Of CasADi's operations."""
LINEAR = {"add", "sub", "neg", "twice", "assign"}
PRODUCTS = {"mul", "sq", "div", "inv", "sqrt", "exp", "log"}
CHOICES = {"fmax", "fmin", "if_else_zero", "fabs"}
"""Piecewise: smooth except where the alternatives meet, which `BranchDecisions` refuses."""
CONDITIONS = {"lt", "le", "eq", "ne", "not", "and", "or"}
KNOWN = LINEAR | PRODUCTS | CHOICES | CONDITIONS


@dataclass(frozen=True)
class Group:
    """Equal operations that do not depend on one another: registers out = operation(left, right)."""

    operation: str
    out: Int[np.ndarray, " g"]
    left: Int[np.ndarray, " g"]
    right: Int[np.ndarray, " g"]


@dataclass(frozen=True)
class Tape:
    """A straight-line program.

    Attributes
    ----------
    name : str
        Of the expression, for complaints.
    size : int
        Number of registers.
    inputs : tuple[ndarray, ...]
        Registers of every element of each input.
    constants : tuple[tuple[int, Fraction], ...]
        Registers and their values.
    groups : tuple[Group, ...]
        In an order in which every operand is ready.
    output : ndarray
        Registers of the elements of the only output, column by column.
    """

    name: str
    size: int
    inputs: tuple[Int[np.ndarray, " _"], ...]
    constants: tuple[tuple[int, Fraction], ...]
    groups: tuple[Group, ...]
    output: Int[np.ndarray, " _"]


def tape_of(name: str, inputs: list[ca.SX], output: ca.SX) -> Tape:
    """The tape of an expression.

    Raises
    ------
    InputError
        When the expression holds an operation that has no derivative or no power series here.
    """
    function = ca.Function("tape", inputs, [ca.densify(output)])
    edges = np.concatenate([[0], np.cumsum([function.numel_in(k) for k in range(function.n_in())])])
    reader = _Reader(name, int(edges[-1]))
    for k in range(function.n_instructions()):
        reader.read(function, k, edges)
    registers = tuple(np.arange(start, stop) for start, stop in pairwise(edges))
    outputs = np.array([reader.outputs[k] for k in range(function.numel_out(0))], dtype=int)
    return Tape(name, len(reader.levels), registers, tuple(reader.constants), reader.groups(), outputs)


class _Reader:
    """Renames CasADi's reused work registers as it reads."""

    def __init__(self, name: str, inputs: int) -> None:
        self._name = name
        self.levels = [0] * inputs
        self.constants: list[tuple[int, Fraction]] = []
        self.outputs: dict[int, int] = {}
        self._current: dict[int, int] = {}
        self._instructions: dict[tuple[int, str], list[tuple[int, int, int]]] = defaultdict(list)

    def read(self, function: ca.Function, k: int, edges: Int[np.ndarray, " _"]) -> None:
        """Read instruction ``k`` of a CasADi function into registers."""
        operation = NAMES[function.instruction_id(k)]
        read, written = function.instruction_input(k), function.instruction_output(k)
        if operation == "output":
            self.outputs[written[1]] = self._current[read[0]]
        elif operation == "input":
            self._current[written[0]] = int(edges[read[0]]) + read[1]
        elif operation == "const":
            self.constants.append((len(self.levels), rational(function.instruction_constant(k))))
            self._write(written[0], 0)
        else:
            self._operate(operation, [self._current[register] for register in read], written[0])

    def _operate(self, operation: str, operands: list[int], written: int) -> None:
        if operation not in KNOWN:
            raise InputError(
                f"{self._name} contains {operation}, which has no power series here; write it with + - * / sqrt, exp, log, "
                "fmin, fmax or if_else"
            )
        level = 1 + max(self.levels[register] for register in operands)
        entry = (len(self.levels), operands[0], operands[-1])
        self._instructions[(level, operation)].append(entry)
        self._write(written, level)

    def _write(self, register: int, level: int) -> None:
        self._current[register] = len(self.levels)
        self.levels.append(level)

    def groups(self) -> tuple[Group, ...]:
        """The instructions by depth and operation, as array operations."""
        return tuple(
            Group(operation, *np.array(entries, dtype=int).T)
            for (_, operation), entries in sorted(self._instructions.items())
        )


def evaluate(tape: Tape, inputs: list[Float[np.ndarray, "_ b"]]) -> Float[np.ndarray, "registers b"]:
    """Every register as floats, for ``b`` points at once."""
    registers = np.zeros((tape.size, inputs[0].shape[1]))
    for where, values in zip(tape.inputs, inputs, strict=True):
        registers[where] = values
    for register, value in tape.constants:
        registers[register] = float(value)
    with np.errstate(all="ignore"):  # what is not finite is complained of by whoever needs it
        for group in tape.groups:
            operation = _FLOATS[group.operation]
            registers[group.out] = operation(registers[group.left], registers[group.right])
    return registers


_FLOATS = {
    "add": np.add,
    "sub": np.subtract,
    "neg": lambda a, _: -a,
    "twice": lambda a, _: 2 * a,
    "assign": lambda a, _: a,
    "mul": np.multiply,
    "sq": lambda a, _: a * a,
    "div": np.divide,
    "inv": lambda a, _: 1 / a,
    "sqrt": lambda a, _: np.sqrt(a),
    "exp": lambda a, _: np.exp(a),
    "log": lambda a, _: np.log(a),
    "fmax": np.fmax,
    "fmin": np.fmin,
    "fabs": lambda a, _: np.abs(a),
    "if_else_zero": lambda a, b: np.where(a != 0, b, 0.0),
    "lt": np.less,
    "le": np.less_equal,
    "eq": np.equal,
    "ne": np.not_equal,
    "not": lambda a, _: a == 0,
    "and": np.logical_and,
    "or": np.logical_or,
}


COMPARED = {"fmax", "fmin", "lt", "le", "eq", "ne"}
PIECEWISE = CHOICES | CONDITIONS


@dataclass(frozen=True)
class BranchDecisions:
    """Decisions of a tape at a batch of points, by the number of the group.

    Attributes
    ----------
    choices : dict[int, ndarray of shape (g, b)]
        (g, b) whether a piecewise group takes its left operand, or what a condition says.
    exponents : dict[int, list[Fraction]]
        Arguments of exp as fractions, register by register, point by point.
    """

    choices: dict[int, Bool[np.ndarray, "g b"]]
    exponents: dict[int, list[Fraction]]


def branch_decisions(tape: Tape, points: list[list[Rationals]]) -> BranchDecisions:
    """The guide of a tape at exact points, given per input and item.

    Raises
    ------
    InputError
        At a point where the alternatives of a piecewise expression meet: it has no derivative there.
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
