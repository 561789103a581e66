"""Instructions of a CasADi expression as groups of array operations, with their branches at a point."""

from collections import defaultdict
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float, Int

from observability.elementary_functions import (
    LOWERED,
    logarithm_multiple,
    roots_of_number,
    roots_of_turn,
    sum_of_roots,
)
from observability.exact_numbers import near_simple, rational
from spinfilters.core.errors import InputError

NAMES = {value: name[3:].lower() for name, value in vars(ca).items() if name.startswith("OP_")}
"""Of CasADi's operations."""
LINEAR = {"add", "sub", "neg", "twice", "assign"}
TRANSCENDENTAL = {"exp", "log", "cis", "arg"}
"""Values that residues do not compute from their operand's value alone: `function_values` finds them beforehand."""
TURNS = {"cis", "arg", "times_i"}
"""exp(i a), the angle of a number of modulus 1, and i a: sines and their inverses are written with them."""
ROOTING = {"sqrt", "log", "log1p", "pow", "constpow", "hypot", "asin", "acos", "asinh", "acosh", "atanh"}
"""Functions with a root or logarithm of what they are of: with them a sum of roots is no constant that is known to have one."""
PRODUCTS = {"mul", "sq", "div", "inv", "sqrt"} | TRANSCENDENTAL | {"times_i"}
CHOICES = {"fmax", "fmin", "if_else_zero", "fabs"}
"""Piecewise: smooth except where the alternatives meet, which `float_choices` refuses."""
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

    @cached_property
    def operations(self) -> frozenset[str]:
        """Which operations there are."""
        return frozenset(group.operation for group in self.groups)

    @cached_property
    def exponents(self) -> frozenset[int]:
        """Registers that the argument of an exponential or turn depends on."""
        needed: set[int] = set()
        for group in reversed(self.groups):
            taken = group.operation in ("exp", "cis")
            for out, *operands in zip(
                group.out.tolist(), group.left.tolist(), group.right.tolist(), strict=True
            ):
                if taken or out in needed:
                    needed.update(operands)
        return frozenset(needed)

    def radicands(self, inputs_have_roots: bool) -> frozenset[Fraction]:
        """Numbers under roots, and under logarithms in exponents, but for factors that have roots themselves.

        Parameters
        ----------
        inputs_have_roots : bool
            Whether all inputs do; else nothing is said of what depends on them.
        """
        known = dict(self.constants)
        if inputs_have_roots:
            known |= {int(register): Fraction(1) for where in self.inputs for register in where}
        found = set()
        for group in self.groups:
            for out, left, right in zip(
                group.out.tolist(), group.left.tolist(), group.right.tolist(), strict=True
            ):
                if group.operation == "sqrt" or (group.operation == "log" and out in self.exponents):
                    found.add(known.get(left))
                factor = _factor(group.operation, known.get(left), known.get(right))
                if factor is not None:
                    known[out] = factor
        return frozenset(each for each in found if each)


def _factor(operation: str, left: Fraction | None, right: Fraction | None) -> Fraction | None:
    """Factor of a result without the factors that have roots; None where it is unknown or 0."""
    if operation in ("sqrt", "exp", "cis"):
        return Fraction(1)
    if not left or not right:
        return None
    match operation:
        case "mul" | "sq":
            return left * right
        case "div":
            return left / right
        case "inv":
            return 1 / left
        case "neg":
            return -left
        case "twice":
            return 2 * left
        case "assign":
            return left
        case _:
            return None


def tape_of(name: str, inputs: list[ca.SX], output: ca.SX, constants_known: bool = False) -> Tape:
    """The tape of an expression.

    Parameters
    ----------
    name : str
        Of the expression, for complaints.
    inputs : list[casadi.SX]
        Its symbols.
    output : casadi.SX
        The expression.
    constants_known : bool
        Whether turns by multiples of pi/12 and constants with them are written with the roots of 2 and 3, and logarithms of
        numbers with those of primes. Not every prime field has these.

    Raises
    ------
    InputError
        When the expression holds an operation that has no derivative or no power series here.
    """
    function = ca.Function("tape", inputs, [ca.densify(output)])
    edges = np.concatenate([[0], np.cumsum([function.numel_in(k) for k in range(function.n_in())])])
    reader = _Reader(name, int(edges[-1]))
    if constants_known:
        operations = [NAMES[function.instruction_id(k)] for k in range(function.n_instructions())]
        reader.sums_roots = ROOTING.isdisjoint(operations)
        reader.roots = _roots_of_constants(function, operations, reader.sums_roots)
        reader.splits_logarithms = not {"log", "log1p"}.isdisjoint(operations)
    for k in range(function.n_instructions()):
        reader.read(function, k, edges)
    registers = tuple(np.arange(start, stop) for start, stop in pairwise(edges))
    outputs = np.array([reader.outputs[k] for k in range(function.numel_out(0))], dtype=int)
    return Tape(name, len(reader.levels), registers, tuple(reader.constants), reader.groups(), outputs)


def _constant(value: float) -> Fraction:
    """The fraction that a constant of an expression represents, which CasADi may have computed from others."""
    return (near_simple(value) if np.isfinite(value) else None) or rational(value)


def _roots_of_constants(function: ca.Function, operations: list[str], sums_roots: bool) -> frozenset[int]:
    """Numbers, 2 or 3, whose roots the sines and cosines of a function's constant angles contain, or its other constants."""
    turns = not {"sin", "cos", "tan"}.isdisjoint(operations)
    found: frozenset[int] = frozenset()
    for k, each in enumerate(operations):
        value = function.instruction_constant(k) if each == "const" else 0.0
        if value and np.isfinite(value):
            found |= roots_of_turn(value) if turns else frozenset()
            found |= roots_of_number(value) if sums_roots else frozenset()
    return found


class _Reader:
    """Renames CasADi's reused work registers as it reads."""

    def __init__(self, name: str, inputs: int) -> None:
        self._name = name
        self.roots: frozenset[int] = frozenset()
        self.splits_logarithms = False
        self.sums_roots = False
        self.levels = [0] * inputs
        self.constants: list[tuple[int, Fraction]] = []
        self._constants: dict[int, Fraction] = {}
        self.outputs: dict[int, int] = {}
        self._current: dict[int, int] = {}
        self._written: dict[tuple[str, int, int], int] = {}
        self._writers: dict[int, tuple[str, int, int]] = {}
        self._constant_registers: dict[Fraction, int] = {}
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
            self._current[written[0]] = self._name_constant(function.instruction_constant(k))
        else:
            self._operate(operation, [self._current[register] for register in read], written[0])

    def _name_constant(self, value: float) -> int:
        """The register of a constant, which is written as what it was computed from where that is known."""
        for named in (sum_of_roots, logarithm_multiple):
            register = named(self, value) if np.isfinite(value) else None
            if register is not None:
                return register
        return self.constant(_constant(value))

    def _operate(self, operation: str, operands: list[int], written: int) -> None:
        if operation in LOWERED:
            self._current[written] = LOWERED[operation](self, *operands)
        elif operation in KNOWN:
            self._current[written] = self.emit(operation, *operands)
        else:
            raise InputError(
                f"{self._name} contains {operation}, which has no power series here; write it with + - * / powers, sqrt, exp, "
                "log, sin, cos, tan, their inverses, tanh, fmin, fmax or if_else"
            )

    def emit(self, operation: str, *operands: int) -> int:
        """The register of an operation, the same for the same operands."""
        entry = (operation, operands[0], operands[-1])
        if entry not in self._written:
            level = 1 + max(self.levels[register] for register in operands)
            self._instructions[(level, operation)].append((len(self.levels), operands[0], operands[-1]))
            self._written[entry] = self._register(level)
            self._writers[self._written[entry]] = entry
        return self._written[entry]

    def constant(self, value: Fraction) -> int:
        """The register of a constant."""
        if value not in self._constant_registers:
            self.constants.append((len(self.levels), value))
            self._constants[len(self.levels)] = value
            self._constant_registers[value] = self._register(0)
        return self._constant_registers[value]

    def constant_of(self, register: int) -> Fraction | None:
        """The constant in a register, if there is one."""
        return self._constants.get(register)

    def written_as(self, register: int) -> tuple[str, int, int] | None:
        """The operation that a register was written by, with its operands."""
        return self._writers.get(register)

    def _register(self, level: int) -> int:
        self.levels.append(level)
        return len(self.levels) - 1

    def groups(self) -> tuple[Group, ...]:
        """The instructions by depth and operation, as array operations."""
        return tuple(
            Group(operation, *np.array(entries, dtype=int).T)
            for (_, operation), entries in sorted(self._instructions.items())
        )


def evaluate(tape: Tape, inputs: list[Float[np.ndarray, "_ b"]]) -> Float[np.ndarray, "registers b"]:
    """Every register as floats, for ``b`` points at once."""
    turns = not TURNS.isdisjoint(tape.operations)
    registers = np.zeros((tape.size, inputs[0].shape[1]), dtype=complex if turns else float)
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
    "cis": lambda a, _: np.exp(1j * a),
    "arg": lambda a, _: np.angle(a),
    "times_i": lambda a, _: 1j * a,
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


Choices = dict[int, Bool[np.ndarray, "g b"]]
"""Decisions of a tape at a batch of points, by the number of the group.

Whether a piecewise group takes its left operand, or what a condition says.
"""


def float_choices(tape: Tape, points: list[Float[np.ndarray, "_ b"]]) -> Choices:
    """Branch decisions of a tape at points in floats, (n, b) per input.

    Raises
    ------
    InputError
        At a point where the alternatives of a piecewise expression meet: it has no derivative there.
    """
    choices: Choices = {}
    if not PIECEWISE.isdisjoint(tape.operations):
        registers = np.real(evaluate(tape, points))
        for index, group in enumerate(tape.groups):
            choice = _choice(tape.name, group, registers)
            if choice is not None:
                choices[index] = choice
    return choices


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
