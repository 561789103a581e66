"""Generators that are rational in the unknowns, interpolated from exact null vectors at many points.

The null space N of all derivatives of the outputs is invariant along the motion: for a field v in N the commutator [D, v] lies in
N again. A basis is normalised so that its components at d free unknowns are 1 and 0. Where these unknowns are constants, the
commutator is 0 there, hence 0 altogether: the normalised vectors are generators as they are. Where some are states, the sum of
c_f v_f is a generator if D c_f equals the change of the rate of f, which is linear in the coefficients of a polynomial c_f.

Each component is a rational function of the point. Its degrees are read off lines, its coefficients off random points, monomials
split by their weights under the scalings that are known; denominators of constants are multiplied out.

Fractions come from their residues by Euclid's algorithm, with as many primes as they need by the Chinese remainder theorem. A
residue modulo one prime of 31 bits is that of a fraction of at most 15 bits above and below, and nearly every residue is that of
some such fraction. A fraction is therefore believed only where it holds modulo a prime that it was not found from.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations, combinations_with_replacement, islice, product
from math import gcd, isqrt, lcm
from typing import Generic, TypeVar

import casadi as ca
import numpy as np
from jaxtyping import Bool, Num

from observability.exact_numbers import NotRegularError, PrimeField
from observability.monomials import (
    Monomial,
    Polynomial,
    Values,
    Weights,
    monomial_rate,
    monomial_value,
    multiplied,
    polynomial_value,
    weight,
)
from observability.null_fields import NotRationalError, NullFields
from observability.residue_matrices import Echelon

MOST_COEFFICIENTS = 520
"""Unknown coefficients solved for at once."""
MOST_MONOMIALS = 20_000
"""Of a numerator or denominator, before they are split by weights."""
HIGHEST_DEGREE = 7
"""Of numerators and denominators along a line."""
LINE_POINTS = 2 * HIGHEST_DEGREE + 4
MOST_CHOICES = 60
"""Sets of free unknowns of which the simplest is taken."""
MULTIPLIER_DEGREE = 3
"""Of the polynomials c_f."""
SPARE = 4
"""Equations beyond the number of coefficients."""


def rational_fields(
    fields: NullFields, constants: frozenset[str], weights: Weights
) -> Iterator[dict[str, Polynomial]]:
    """Fields without denominators, by the unknown that moves, the simplest first.

    Parameters
    ----------
    constants : frozenset[str]
        Names that stay as they are along the motion.
    weights : Weights
        Of the scalings known.
    """
    try:
        choice = _simplest_choice(fields, constants)
        moving = [name for name in choice.free if name not in constants]
        found: Iterator[Sequence[Polynomial]]
        if moving:
            found = _multipliers(fields, choice, constants, weights)
        else:
            rows = sorted(range(len(choice.free)), key=choice.row_sizes.__getitem__)
            found = ([{(): 1} if k == row else {} for k in range(len(rows))] for row in rows)
        for multipliers in found:
            try:
                yield _Interpolation(fields, choice, multipliers, constants, weights).field()
            except NotRationalError:
                continue
    except NotRationalError:
        return


@dataclass(frozen=True)
class FreeUnknowns:
    """Unknowns at which a basis is normalised, and what its components depend on.

    Attributes
    ----------
    free : tuple[str, ...]
        The unknowns.
    moved : tuple[str, ...]
        Unknowns that some vector moves.
    dependence : ndarray of shape (v, d, n)
        Whether a component of a row depends on a variable.
    """

    free: tuple[str, ...]
    moved: tuple[str, ...]
    dependence: Bool[np.ndarray, "v d n"]

    @property
    def row_sizes(self) -> list[int]:
        """Pairs of component and variable that depend on each other, row by row."""
        return self.dependence.sum(axis=(0, 2)).tolist()


def _simplest_choice(fields: NullFields, constants: frozenset[str]) -> FreeUnknowns:
    """Free unknowns, as many constants as possible, whose basis has the fewest dependences."""
    base = fields.draw(1)
    varied = fields.draw(len(fields.names))
    values = {
        name: np.concatenate(
            [base[name], np.where(np.arange(len(fields.names)) == k, varied[name], base[name])]
        )
        for k, name in enumerate(fields.names)
    }
    spaces = fields.at(values)
    unknowns = fields.part.unknowns
    moved = [k for k in range(len(unknowns)) if spaces[0, :, k].any()]
    if not moved:
        raise NotRationalError
    still = [k for k in moved if unknowns[k] in constants]
    others = [k for k in moved if unknowns[k] not in constants]
    rows = Echelon(len(still), fields.field)
    rows.add(spaces[0][:, still])
    count = rows.rank
    pairs = product(combinations(still, count), combinations(others, fields.dimension - count))
    best: FreeUnknowns | None = None
    for left, right in islice(pairs, MOST_CHOICES * 20):
        free = [*left, *right]
        _, good = fields.normalised(spaces[:1], free)
        if not good[0]:
            continue
        basis, good = fields.normalised(spaces, free)
        changes = (basis[1:] != basis[0]) & good[1:, np.newaxis, np.newaxis]
        found = FreeUnknowns(tuple(unknowns[k] for k in free), tuple(unknowns[k] for k in moved), changes)
        if best is None or sum(found.row_sizes) < sum(best.row_sizes):
            best = found
    if best is None:
        raise NotRationalError
    return best


def _multipliers(
    fields: NullFields, choice: FreeUnknowns, constants: frozenset[str], weights: Weights
) -> Iterator[Sequence[Polynomial]]:
    """Polynomials c_f of every free unknown that make a generator of sum_f c_f v_f."""
    unknowns, field = fields.part.unknowns, fields.field
    free = [unknowns.index(name) for name in choice.free]
    # Variables: what moves, and what any component or the rate of a state that moves depends on.
    touched = set(np.flatnonzero(choice.dependence.any(axis=(1, 2))).tolist())
    rates = [fields.part.model.rates[name] for name in choice.moved if name in fields.part.states]
    seen = {symbol.name() for each in rates for symbol in ca.symvar(each)} | set(choice.moved)
    relevant = [name for k, name in enumerate(fields.names) if k in touched or name in seen]
    relevant = [name for name in relevant if name not in fields.part.inputs]
    groups: dict[tuple[int, ...], list[tuple[int, Monomial]]] = defaultdict(list)
    for degree in range(MULTIPLIER_DEGREE + 1):
        for k, name in enumerate(choice.free):
            names = [each for each in relevant if each in constants] if name in constants else relevant
            for monomial in combinations_with_replacement(names, degree):
                groups[weight(monomial, (name,), weights, field.prime)].append((k, monomial))
    moving = [k for k, name in enumerate(choice.free) if name not in constants]
    for terms in sorted(groups.values(), key=len):
        if len(terms) > MOST_COEFFICIENTS:
            continue
        values = fields.draw(-(-(len(terms) + SPARE) // len(moving)) + 2)
        basis, good = fields.normalised(fields.at(values), free)
        rates = fields.rates(values)
        motion = dict(zip(fields.part.states, rates[..., 0], strict=True))
        rows = np.zeros((len(moving), len(good), len(terms)), dtype=np.uint64)
        for column, (k, monomial) in enumerate(terms):
            size = monomial_value(monomial, values, field)
            for row, f in enumerate(moving):
                # -c_k (gradient of the rate of f) . v_k, and D c_f where k = f
                gradient = rates[fields.part.states.index(choice.free[f]), :, 1:]
                along = field.reduced(field.product(gradient, basis[:, k]).sum(axis=1))
                entry = field.negative(field.product(size, along))
                if k == f:
                    entry = field.reduced(entry + monomial_rate(monomial, values, motion, field))
                rows[row, :, column] = entry
        echelon = Echelon(len(terms), field)
        echelon.add(rows[:, good].reshape(-1, len(terms)))
        kernel = echelon.null_space()
        for vector in sorted(kernel.T, key=np.count_nonzero):
            found: list[Polynomial] = [{} for _ in free]
            for (k, monomial), value in zip(terms, vector.tolist(), strict=True):
                if value:
                    found[k][monomial] = value
            yield found


class _Interpolation:
    """One field, component by component, over a common denominator."""

    def __init__(
        self,
        fields: NullFields,
        choice: FreeUnknowns,
        multipliers: Sequence[Polynomial],
        constants: frozenset[str],
        weights: Weights,
    ) -> None:
        self._fields, self._multipliers = fields, multipliers
        self._constants, self._weights = constants, weights
        self._free = [fields.part.unknowns.index(name) for name in choice.free]
        used = [k for k, each in enumerate(multipliers) if each]
        touched = set(np.flatnonzero(choice.dependence[:, used].any(axis=(1, 2))).tolist())
        factors = {name for each in multipliers for monomial in each for name in monomial}
        self._variables = [name for k, name in enumerate(fields.names) if k in touched or name in factors]
        self._lines: list[tuple[Values, Num[np.ndarray, " s"], Num[np.ndarray, "s n"]]] = []
        self._points: dict[str, Num[np.ndarray, " b"]] = {}
        self._vectors = np.zeros((0, len(fields.part.unknowns)), dtype=np.uint64)
        self._denominator: Polynomial = {(): 1}

    def field(self) -> dict[str, Polynomial]:
        """The field times the common denominator."""
        self._draw_lines()
        components = [k for k in range(self._vectors.shape[1]) if self._lines[-1][2][:, k].any()]
        found: dict[int, Polynomial] = {}
        for k in sorted(components, key=lambda k: (len(self._dependent(k)), k)):
            above, below = self._component(k)
            if below != {(): 1}:
                if not {name for monomial in below for name in monomial} <= self._constants:
                    raise NotRationalError
                prime = self._fields.field.prime
                found = {j: multiplied(each, below, prime) for j, each in found.items()}
                self._denominator = multiplied(self._denominator, below, prime)
            found[k] = above
        names = self._fields.part.unknowns
        return {names[k]: found[k] for k in sorted(found)}

    def _vector(self, values: Values) -> tuple[Num[np.ndarray, "b n"], Bool[np.ndarray, " b"]]:
        """The field's values."""
        field = self._fields.field
        basis, good = self._fields.normalised(self._fields.at(values), self._free)
        total = np.zeros((len(basis), basis.shape[2]), dtype=np.uint64)
        for k, each in enumerate(self._multipliers):
            if each:
                size = polynomial_value(each, values, field)
                total = field.reduced(total + field.product(basis[:, k], size[:, np.newaxis]))
        return total, good

    def _draw_lines(self) -> None:
        """One line along each variable, and one through all of them."""
        field, base = self._fields.field, self._fields.draw(1)
        direction = self._fields.draw(1)
        steps = np.arange(1, LINE_POINTS + 1, dtype=np.uint64)
        for moving in (*[[name] for name in self._variables], self._variables):
            values = {
                name: field.reduced(each + field.product(steps, direction[name]))
                if name in moving
                else np.repeat(each, len(steps))
                for name, each in base.items()
            }
            vectors, good = self._vector(values)
            kept = {name: each[good] for name, each in values.items()}
            self._lines.append((kept, steps[good], vectors[good]))

    def _dependent(self, component: int) -> list[int]:
        """Variables that a component depends on."""
        return [
            k
            for k, (_, _, vectors) in enumerate(self._lines[:-1])
            if (vectors[:, component] != vectors[0, component]).any()
        ]

    def _component(self, component: int) -> tuple[Polynomial, Polynomial]:
        """Numerator and denominator of a component times the common denominator."""
        field, bounds = self._fields.field, []
        for values, steps, vectors in self._lines:
            size = polynomial_value(self._denominator, values, field)
            bounds.append(_degrees(steps, field.product(vectors[:, component], size), field))
        names, (above, below) = self._variables, zip(*bounds, strict=True)
        groups: dict[tuple[int, ...], tuple[list[Monomial], list[Monomial]]] = defaultdict(lambda: ([], []))
        moved, shift = (self._fields.part.unknowns[component],), self._shift(field.prime)
        for monomial in _monomials(names, above[:-1], above[-1]):
            groups[weight(monomial, moved, self._weights, field.prime)][0].append(monomial)
        for monomial in _monomials(names, below[:-1], below[-1]):
            own = weight(monomial, (), self._weights, field.prime)
            groups[tuple((a + b) % field.prime for a, b in zip(own, shift, strict=True))][1].append(monomial)
        for numerators, denominators in sorted(groups.values(), key=lambda pair: len(pair[0]) + len(pair[1])):
            if numerators and denominators:
                found = self._fit_fraction(component, numerators, denominators)
                if found:
                    return found
        raise NotRationalError

    def _shift(self, prime: int) -> tuple[int, ...]:
        """Weight of the field times the common denominator: c_f by the weight of f."""
        k = next(k for k, each in enumerate(self._multipliers) if each)
        first = next(iter(self._multipliers[k]))
        common = next(iter(self._denominator))
        moved = (self._fields.part.unknowns[self._free[k]],)
        return weight((*first, *common), moved, self._weights, prime)

    def _fit_fraction(
        self, component: int, numerators: list[Monomial], denominators: list[Monomial]
    ) -> tuple[Polynomial, Polynomial] | None:
        """Coefficients with N - v D = 0 at random points; None where there are none."""
        count = len(numerators) + len(denominators)
        if count > MOST_COEFFICIENTS:
            return None
        self._need(count + SPARE)
        field, size = self._fields.field, count + SPARE
        values = {name: each[:size] for name, each in self._points.items()}
        common = polynomial_value(self._denominator, values, field)
        target = field.negative(field.product(self._vectors[:size, component], common))
        rows = np.stack(
            [monomial_value(each, values, field) for each in numerators]
            + [field.product(target, monomial_value(each, values, field)) for each in denominators],
            axis=1,
        )
        echelon = Echelon(count, field)
        echelon.add(rows)
        kernel = echelon.null_space()
        if not kernel.shape[1]:
            return None
        vector = min(kernel.T, key=np.count_nonzero)
        above = {each: int(value) for each, value in zip(numerators, vector, strict=False) if value}
        below = dict(zip(denominators, vector[len(numerators) :].tolist(), strict=True))
        below = {each: value for each, value in below.items() if value}
        if not above or not below:
            return None
        # The denominator's first coefficient is 1, so that denominators of 1 are recognised.
        scale = pow(next(iter(below.values())), -1, field.prime)
        above, below = (
            {each: value * scale % field.prime for each, value in part.items()} for part in (above, below)
        )
        return above, below

    def _need(self, count: int) -> None:
        """Draw as many regular points as are needed."""
        while len(self._vectors) < count:
            values = self._fields.draw(max(32, count - len(self._vectors) + 4))
            vectors, good = self._vector(values)
            if not good.any():
                raise NotRationalError
            for name, each in values.items():
                before = self._points.get(name, np.zeros(0, dtype=np.uint64))
                self._points[name] = np.concatenate([before, each[good]])
            self._vectors = np.concatenate([self._vectors, vectors[good]])


def _degrees(
    steps: Num[np.ndarray, " s"], values: Num[np.ndarray, " s"], field: PrimeField
) -> tuple[int, int]:
    """Least degrees of numerator and denominator of a rational function of one variable.

    Raises
    ------
    NotRationalError
        Where they are higher than `HIGHEST_DEGREE`.
    """
    if not len(steps):
        raise NotRationalError
    if (values == values[0]).all():
        return 0, 0
    powers = [np.ones_like(steps)]
    for _ in range(HIGHEST_DEGREE):
        powers.append(field.product(powers[-1], steps))
    negative = field.negative(values)
    for total in range(1, 2 * HIGHEST_DEGREE + 1):
        if total + 4 > len(steps):
            break
        for below in range(max(0, total - HIGHEST_DEGREE), min(total, HIGHEST_DEGREE) + 1):
            above = total - below
            columns = [*powers[: above + 1], *[field.product(negative, each) for each in powers[: below + 1]]]
            echelon = Echelon(len(columns), field)
            echelon.add(np.stack(columns, axis=1))
            if echelon.rank < len(columns):
                return above, below
    raise NotRationalError


def _monomials(names: Sequence[str], most: Sequence[int], total: int) -> list[Monomial]:
    """Monomials within a degree in every variable and a total one.

    Raises
    ------
    NotRationalError
        Where there are too many.
    """
    found: list[Monomial] = [()]
    for name, limit in zip(names, most, strict=True):
        if limit:
            found = [
                (*each, *[name] * power)
                for each in found
                for power in range(min(limit, total - len(each)) + 1)
            ]
        if len(found) > MOST_MONOMIALS:
            raise NotRationalError
    return found


T = TypeVar("T")


@dataclass(frozen=True)
class Modulo(Generic[T]):
    """Residues of whatever kind, with their prime.

    Attributes
    ----------
    prime : int
        Of the field.
    residues : T
        A vector, a matrix or a field of the unknowns.
    """

    prime: int
    residues: T


def fraction_of(number: int, modulus: int) -> Fraction | None:
    """The fraction with small numerator and denominator that a residue is of, by Euclid's algorithm."""
    bound = isqrt(modulus // 2)
    above, below = (modulus, 0), (number, 1)
    while below[0] > bound:
        step = above[0] // below[0]
        above, below = below, (above[0] - step * below[0], above[1] - step * below[1])
    if not below[1] or abs(below[1]) > bound:
        return None
    return Fraction(below[0], below[1])


def fractions_that_hold(
    vectors: Iterable[Modulo[Sequence[int]]], holds: Callable[[list[Fraction]], bool]
) -> list[Fraction] | None:
    """Fractions put together of the residues of one prime after the other, until they hold; None where they never do.

    Parameters
    ----------
    vectors : Iterable[Modulo[Sequence[int]]]
        Residues of the same numbers modulo different primes.
    holds : Callable[[list[Fraction]], bool]
        The trial, modulo a prime that is not among these.
    """
    whole: list[int] = []
    modulus = 1
    for vector in vectors:
        prime, new = vector.prime, vector.residues
        if modulus == 1:
            whole = list(new)
        elif len(new) != len(whole):
            return None
        else:
            inverse = pow(modulus, -1, prime)
            whole = [
                old + modulus * ((value - old) * inverse % prime)
                for old, value in zip(whole, new, strict=True)
            ]
        modulus *= prime
        found = [fraction_of(value, modulus) for value in whole]
        fractions = [value for value in found if value is not None]
        try:
            if len(fractions) == len(found) and holds(fractions):
                return fractions
        except NotRegularError:
            continue
    return None


def coprime_coefficients(terms: Sequence[T], values: Sequence[Fraction]) -> dict[T, Fraction]:
    """Coprime integers in the proportion of some values by term, without those of 0."""
    kept = [(term, value) for term, value in zip(terms, values, strict=True) if value]
    whole = coprime_integers([value for _, value in kept])
    return {term: value for (term, _), value in zip(kept, whole, strict=True)}


def sparsest_first(vectors: Num[np.ndarray, "k t"]) -> list[int]:
    """Rows in the order of how many numbers they have that are not 0."""
    return sorted(range(len(vectors)), key=lambda k: np.count_nonzero(vectors[k]))


def coprime_integers(values: Sequence[Fraction]) -> list[Fraction]:
    """A vector scaled to coprime integers, the first of them positive."""
    scale = lcm(*[value.denominator for value in values])
    whole = [int(value * scale) for value in values]
    divisor = gcd(*whole) * (1 if whole[0] > 0 else -1)
    return [Fraction(value, divisor) for value in whole]
