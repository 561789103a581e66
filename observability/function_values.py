"""Values of roots, exponentials, logarithms and turns at a point, with two residues per number.

A number carries a residue modulo p = 4 q + 1 and one modulo q. Exponents live modulo q: exp(a) is the base to the power of a modulo
q, and the logarithm is found by baby and giant steps in the group of order q. So exp(a) exp(b) = exp(a + b), x^a x^b = x^(a + b)
and exp(log x) = x hold exactly. What no relation ties, such as the value of a logarithm modulo p, is drawn by a fixed rule.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Num

from observability.exact_numbers import (
    Arithmetic,
    NotRegularError,
    PrimeField,
    Rationals,
    as_floats,
    residue,
)
from observability.tape import TRANSCENDENTAL, Choices, Group, Tape, float_choices
from spinfilters.core.errors import InputError

SCALAR_SIZE = 64
"""Up to so many numbers Python's own power is faster than that of arrays."""
BABY_STEPS = 1 << 17


@dataclass(frozen=True)
class Residues:
    """Numbers modulo p and modulo q, (n, b) each."""

    p: Num[np.ndarray, "n b"]
    q: Num[np.ndarray, "n b"]


def residues_of(points: Sequence[Rationals], field: PrimeField) -> Residues:
    """Residues of b points of n fractions."""
    p = [[residue(value, field.prime) for value in point] for point in points]
    q = [[residue(value, field.order) for value in point] for point in points]
    shape = (len(points), -1)
    return Residues(*[np.array(each, dtype=np.uint64).reshape(shape).T for each in (p, q)])


@dataclass(frozen=True)
class FunctionValues:
    """Values modulo p of a tape's functions at a batch of points.

    Attributes
    ----------
    values : dict[int, ndarray of shape (g, b)]
        By the number of the group.
    output : Residues
        The tape's output.
    regular : ndarray of shape (b,)
        Where all of them exist.
    reason : str
        Of the last that does not.
    """

    values: dict[int, Num[np.ndarray, "g b"]]
    output: Residues
    regular: Bool[np.ndarray, " b"]
    reason: str


def function_values(
    tape: Tape, field: PrimeField, inputs: Sequence[Residues], choices: Choices, output_needed: bool = True
) -> FunctionValues:
    """Values of all functions of a tape at a batch of points; where no output is needed, its residues modulo q may be 0."""
    return _ProgramPass(tape, field, inputs, choices, output_needed).values()


@dataclass(frozen=True)
class BranchDecisions:
    """What a tape's power series needs to know of a batch of points beforehand.

    Attributes
    ----------
    choices : Choices
        Of piecewise groups.
    values : dict[int, ndarray of shape (g, b)]
        Values of transcendental groups in the field; none in floats.
    """

    choices: Choices
    values: dict[int, Num[np.ndarray, "g b"]]


def branch_decisions(tape: Tape, points: list[list[Rationals]], arithmetic: Arithmetic) -> BranchDecisions:
    """Decisions of a tape at exact points, given per input and item.

    Raises
    ------
    InputError
        At a point where the alternatives of a piecewise expression meet, or a function has no residue.
    """
    choices = float_choices(tape, [np.stack([as_floats(item) for item in items], axis=1) for items in points])
    field = arithmetic.field
    if field is None or TRANSCENDENTAL.isdisjoint(tape.operations):
        return BranchDecisions(choices, {})
    found = function_values(tape, field, [residues_of(items, field) for items in points], choices)
    if not found.regular.all():
        raise InputError(f"{tape.name} has no power series at this point: {found.reason}; move the point")
    return BranchDecisions(choices, found.values)


class _ProgramPass:
    """One pass over a tape in both residues."""

    def __init__(
        self,
        tape: Tape,
        field: PrimeField,
        inputs: Sequence[Residues],
        choices: dict[int, Bool[np.ndarray, "g b"]],
        output_needed: bool,
    ) -> None:
        batch = inputs[0].p.shape[1]
        self._tape, self._field, self._choices = tape, field, choices
        self._moduli = (np.uint64(field.prime), np.uint64(field.order))
        self._registers = [np.zeros((tape.size, batch), dtype=np.uint64) for _ in range(2)]
        for where, given in zip(tape.inputs, inputs, strict=True):
            self._registers[0][where], self._registers[1][where] = given.p, given.q
        for register, value in tape.constants:
            self._registers[0][register] = residue(value, field.prime)
            self._registers[1][register] = residue(value, field.order)
        # Sums and products alone have no use for residues modulo q.
        self._both = output_needed or not tape.operations.isdisjoint(TRANSCENDENTAL | {"sqrt"})
        self._exponents = tape.exponents
        self._regular, self._reason = np.ones(batch, dtype=bool), ""
        self._known_logarithms: dict[int, int] = {1: 0}

    def values(self) -> FunctionValues:
        """The pass itself."""
        found = {}
        for index, group in enumerate(self._tape.groups):
            results = self._results(index, group)
            for registers, result in zip(self._registers, results, strict=True):
                registers[group.out] = result
            if group.operation in TRANSCENDENTAL:
                found[index] = results[0]
        output = Residues(*[registers[self._tape.output] for registers in self._registers])
        return FunctionValues(found, output, self._regular, self._reason)

    def _results(self, index: int, group: Group) -> tuple[np.ndarray, np.ndarray]:
        p = self._registers[0][group.left]
        match group.operation:
            case "sqrt":
                return self._pair_with_random(self._root(p))
            case "exp":
                return self._pair_with_random(self._exponential(group, p))
            case "cis":
                exponents = self._registers[1][group.left]
                return self._pair_with_random(powers(self._field.turn_base, exponents, self._field.prime))
            case "log":
                return self._logarithm(group, p), self._discrete(group, p, self._field.base)
            case "arg":
                return _scrambled(p, self._field.prime), self._discrete(group, p, self._field.turn_base)
            case "times_i":
                return self._pair_with_random(self._field.times_i(p))
            case _:
                p, q = (
                    self._rational(index, group.operation, registers[group.left], registers[group.right], m)
                    if self._both or m == self._moduli[0]
                    else registers[group.out]
                    for registers, m in zip(self._registers, self._moduli, strict=True)
                )
                return p, q

    def _rational(
        self, index: int, operation: str, a: np.ndarray, b: np.ndarray, modulus: np.uint64
    ) -> np.ndarray:
        match operation:
            case "add":
                return (a + b) % modulus
            case "sub":
                return (a + (modulus - b)) % modulus
            case "neg":
                return (modulus - a) % modulus
            case "twice":
                return (a + a) % modulus
            case "assign":
                return a
            case "mul" | "sq":
                return a * b % modulus
            case "div":
                return a * self._inverse(b, int(modulus)) % modulus
            case "inv":
                return self._inverse(a, int(modulus))
            case _:
                return self._choose_branch(index, operation, a, b, modulus)

    def _choose_branch(
        self, index: int, operation: str, a: np.ndarray, b: np.ndarray, modulus: np.uint64
    ) -> np.ndarray:
        choice = self._choices[index]
        match operation:
            case "fmax" | "fmin":
                return np.where(choice, a, b)
            case "fabs":
                return np.where(choice, a, (modulus - a) % modulus)
            case "if_else_zero":
                return np.where(choice, b, np.uint64(0))
            case _:  # a condition
                return choice.astype(np.uint64)

    def _inverse(self, a: np.ndarray, modulus: int) -> np.ndarray:
        self._require(a != 0, "division by 0")
        return powers(np.where(a == 0, np.uint64(1), a), modulus - 2, modulus)

    def _root(self, a: np.ndarray) -> np.ndarray:
        self._require_power(a, "a square root")
        return powers(a, (self._field.order + 1) // 2, self._field.prime)

    def _exponential(self, group: Group, p: np.ndarray) -> np.ndarray:
        result = powers(self._field.base, self._registers[1][group.left], self._field.prime)
        self._known_logarithms |= dict(zip(result.ravel().tolist(), p.ravel().tolist(), strict=True))
        return result

    def _logarithm(self, group: Group, a: np.ndarray) -> np.ndarray:
        """A number modulo p: that whose exponential was taken, else one drawn by the argument."""
        self._require(a != 0, "a logarithm of 0")
        drawn = _scrambled(a, self._field.prime)
        known = [
            self._known_logarithms.get(number, other)
            for number, other in zip(a.ravel().tolist(), drawn.ravel().tolist(), strict=True)
        ]
        return np.array(known, dtype=np.uint64).reshape(a.shape)

    def _discrete(self, group: Group, a: np.ndarray, base: int) -> np.ndarray:
        """Exponent of the base, for those logarithms that an exponential depends on."""
        wanted = np.array([int(out) in self._exponents for out in group.out])
        result = _scrambled(a, self._field.order)
        if wanted.any():
            self._require_power(a[wanted], "a logarithm or a power")
            good = np.ix_(wanted, self._regular)
            result[good] = discrete_logarithms(a[good], base, self._field)
        return result

    def _require_power(self, a: np.ndarray, words: str) -> None:
        self._require(powers(a, self._field.order, self._field.prime) == 1, f"{words} has no exact value")

    def _require(self, holds: np.ndarray, reason: str) -> None:
        if not holds.all():
            self._regular, self._reason = self._regular & holds.all(axis=0), reason

    def _pair_with_random(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The value modulo p with one modulo q that nothing ties to it."""
        return p, _scrambled(p, self._field.order)


def powers(base: np.ndarray | int, exponent: np.ndarray | int, modulus: int) -> np.ndarray:
    """base^exponent modulo a number below 2^32, elementwise."""
    shape = np.broadcast_shapes(np.shape(base), np.shape(exponent))
    bases, exponents = (
        np.broadcast_to(np.asarray(each, dtype=np.uint64), shape) for each in (base, exponent)
    )
    if bases.size <= SCALAR_SIZE:
        both = zip(bases.ravel().tolist(), exponents.ravel().tolist(), strict=True)
        return np.array([pow(a, b, modulus) for a, b in both], dtype=np.uint64).reshape(shape)
    result, square, left = np.ones(shape, dtype=np.uint64), bases.copy(), exponents.copy()
    m, one = np.uint64(modulus), np.uint64(1)
    while left.any():
        result = np.where(left & one, result * square % m, result)
        square, left = square * square % m, left >> one
    return result


def discrete_logarithms(a: np.ndarray, base: int, field: PrimeField) -> np.ndarray:
    """x with base^x = a modulo p, for a in the group of order q that the base generates."""
    if not a.size:
        return a
    values, exponents, giants = _steps(base, field.prime, field.order)
    found = np.zeros(a.size, dtype=np.uint64)
    for index, number in enumerate(a.ravel().tolist()):
        tries = np.uint64(number) * giants % np.uint64(field.prime)
        at = np.minimum(np.searchsorted(values, tries), len(values) - 1)
        (hits,) = np.nonzero(values[at] == tries)
        if not len(hits):
            raise NotRegularError("a logarithm outside of the group")
        found[index] = (int(exponents[at[hits[0]]]) + int(hits[0]) * BABY_STEPS) % field.order
    return found.reshape(a.shape)


@lru_cache(maxsize=8)
def _steps(base: int, prime: int, order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sorted baby steps base^j with their j, and giant steps base^(-m i)."""
    babies = _geometric(base, BABY_STEPS, prime)
    ranked = np.argsort(babies)
    giants = _geometric(pow(base, -BABY_STEPS, prime), order // BABY_STEPS + 1, prime)
    return babies[ranked], ranked.astype(np.uint64), giants


def _geometric(ratio: int, count: int, prime: int) -> np.ndarray:
    """1, r, r^2, ... by doubling."""
    series = np.ones(1, dtype=np.uint64)
    while len(series) < count:
        step = np.uint64(pow(ratio, len(series), prime))
        series = np.concatenate([series, series * step % np.uint64(prime)])
    return series[:count]


def _scrambled(a: np.ndarray, modulus: int) -> np.ndarray:
    """A residue that depends on a number in no simple way (the finaliser of splitmix64)."""
    with np.errstate(over="ignore"):
        mixed = (a ^ (a >> np.uint64(16))) * np.uint64(0xBF58476D1CE4E5B9)
        mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return (mixed ^ (mixed >> np.uint64(31))) % np.uint64(modulus)
