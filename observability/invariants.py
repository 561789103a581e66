"""What is determined of unknowns that are not: invariants of all generators, and a model in them.

Scalings leave products of powers alone whose exponents are orthogonal to all weights, such as J2/J1. Other generators leave
polynomials alone, found by linear equations for their coefficients at random points; of those that are of one weight under the
scalings, products of powers are taken again. Each invariant is tried against every generator at points of another prime field.
Where all generators scale or shift, the unknowns divided by powers of some of them, or less multiples of them, obey equations of
their own: the same as with these some at 1 or 0, less what their own rates add (the moving frame of the group).
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations, combinations_with_replacement, islice, product

import casadi as ca
import numpy as np
from jaxtyping import Num

from observability.exact_numbers import PrimeField, residue
from observability.generators import Generator
from observability.model import Model
from observability.model_rank import ReachedModel, exact_rank, other_primes, output_coefficients, reached
from observability.monomials import (
    Monomial,
    Values,
    monomial_rate,
    polynomial_value,
    product_in_words,
    sum_in_words,
)
from observability.null_fields import is_rational, point_at
from observability.rational_generators import (
    Modulo,
    coprime_coefficients,
    coprime_integers,
    fractions_that_hold,
    sparsest_first,
)
from observability.residue_matrices import Echelon
from observability.written_formulas import written

HIGHEST_DEGREE = 3
"""Of the polynomials."""
MOST_TERMS = 400
"""Coefficients solved for at once."""
MOST_PRODUCTS = 20_000
"""Sets of polynomials of which products are tried."""
SPARE = 6
"""Equations beyond the number of coefficients."""
POINTS = 4
"""At which an invariant is tried."""
MOST_PRIMES = 6
"""That coefficients are put together of."""
MOST_CHOICES = 3_000
"""Sets of unknowns that may be set to 1 or 0."""
MOST_FRAMES = 30
"""Of which the one that makes the simplest model is taken."""
MOST_TRIED = 3
TRIED_ORDERS = 6
"""Derivatives of outputs that both models are compared in."""

IntegerPolynomial = Mapping[Monomial, Fraction]


@dataclass(frozen=True)
class Invariant:
    """A product of powers of polynomials that no generator changes.

    Attributes
    ----------
    factors : tuple[tuple[IntegerPolynomial, int], ...]
        Polynomials with their exponents.
    """

    factors: tuple[tuple[IntegerPolynomial, int], ...]

    def __str__(self) -> str:
        above = [_power_in_words(each, power) for each, power in self.factors if power > 0]
        below = [_power_in_words(each, -power) for each, power in self.factors if power < 0]
        if len(self.factors) == 1 and above and self.factors[0][1] == 1:
            return _in_words(self.factors[0][0])
        words = "*".join(above) or "1"
        if not below:
            return words
        return f"{words}/{below[0]}" if len(below) == 1 else f"{words}/({'*'.join(below)})"

    def expression(self, symbols: Mapping[str, ca.SX]) -> ca.SX:
        """Itself in symbols."""
        total = ca.SX(1)
        for polynomial, power in self.factors:
            size = ca.SX(0)
            for monomial, coefficient in polynomial.items():
                term = ca.SX(coefficient.numerator) / coefficient.denominator
                for name in monomial:
                    term *= symbols[name]
                size += term
            total *= size**power
        return total

    def value(self, values: Values, field: PrimeField) -> Num[np.ndarray, " b"]:
        """Itself at points."""
        total = np.ones_like(next(iter(values.values())))
        for polynomial, power in self.factors:
            size = polynomial_value(_residues(polynomial, field), values, field)
            for _ in range(abs(power)):
                total = field.product(total, size if power > 0 else field.inverse(size))
        return total

    def logarithmic_rate(self, rates: Values, values: Values, field: PrimeField) -> Num[np.ndarray, " b"]:
        """Derivative of its logarithm along a field with these components."""
        total = np.zeros_like(next(iter(values.values())))
        for polynomial, power in self.factors:
            size = field.inverse(polynomial_value(_residues(polynomial, field), values, field))
            rate = np.zeros_like(total)
            for monomial, value in polynomial.items():
                along = monomial_rate(monomial, values, rates, field)
                rate = field.reduced(rate + field.product(along, field.numbers([value])))
            share = field.product(field.product(rate, size), field.numbers([Fraction(power)]))
            total = field.reduced(total + share)
        return total


@dataclass(frozen=True)
class InvariantSet:
    """Independent invariants of the unknowns that generators move.

    Attributes
    ----------
    found : tuple[Invariant, ...]
        The simplest first.
    complete : bool
        Whether all that is determined of these unknowns is, locally, a function of them and of observable unknowns.
    """

    found: tuple[Invariant, ...]
    complete: bool

    def __str__(self) -> str:
        return ", ".join(str(each) for each in self.found)


def invariants(
    generators: Sequence[Generator], unknowns: Sequence[str], divisors: Sequence[str] = ()
) -> InvariantSet:
    """Functions of the unknowns that no generator changes, such as the ratio of two scaled ones.

    Parameters
    ----------
    generators : Sequence[Generator]
        Of all directions that are not observable.
    unknowns : Sequence[str]
        In whose order invariants are written.
    divisors : Sequence[str]
        Unknowns that stand below a fraction rather than above.
    """
    moved = [
        name
        for name in (*divisors, *[each for each in unknowns if each not in divisors])
        if any(name in each.components for each in generators)
    ]
    factors = {name for each in generators for term in each.terms for name in term.factors}
    others = sorted(factors - set(moved))
    return _InvariantSearch(generators, moved, others).result() if moved else InvariantSet((), not generators)


class _InvariantSearch:
    """Semi-invariant polynomials, and products of their powers."""

    def __init__(self, generators: Sequence[Generator], moved: list[str], others: list[str]) -> None:
        self._generators, self._moved_names, self._others = generators, moved, others
        self._scalings = [each for each in generators if each.kind == "scaling"]
        self._rest = [each for each in generators if each.kind != "scaling"]
        self._random = np.random.default_rng(6)
        self._field = PrimeField()
        self._confirming, *self._further = [PrimeField(prime=each) for each in other_primes()[:MOST_PRIMES]]

    def result(self) -> InvariantSet:
        names = [*self._moved_names, *self._others]
        values, field = self._draw(1, self._field), self._field
        wanted = len(self._moved_names) - self._rank(values)
        gradients = Echelon(len(names), field)
        # What is observable is known anyway: only what is independent of it is counted.
        known = np.zeros((len(self._others), len(names)), dtype=np.uint64)
        known[np.arange(len(self._others)), len(self._moved_names) + np.arange(len(self._others))] = 1
        gradients.add(known)
        found: list[Invariant] = []
        for each in self._candidates():
            if len(found) == wanted:
                break
            one = np.ones(1, dtype=np.uint64)
            rows = [each.logarithmic_rate({name: one}, values, field) for name in names]
            before = gradients.rank
            trial = np.stack(rows, axis=1)
            if not self._is_confirmed(each):
                continue
            gradients.add(trial)
            if gradients.rank > before:
                found.append(each)
        return InvariantSet(tuple(found), len(found) == wanted)

    def _draw(self, count: int, field: PrimeField) -> dict[str, Num[np.ndarray, " b"]]:
        return field.draw([*self._moved_names, *self._others], count, self._random)

    def _rank(self, values: Values) -> int:
        """Of the generators at a point."""
        rows = Echelon(len(self._moved_names), self._field)
        for each in self._generators:
            rows.add(each.vectors(self._moved_names, values, self._field))
        return rows.rank

    def _is_confirmed(self, invariant: Invariant) -> bool:
        """Whether no generator changes it, at points of another field."""
        field = self._confirming
        values = self._draw(POINTS, field)
        return not any(
            invariant.logarithmic_rate(_components(each, values, field), values, field).any()
            for each in self._generators
        )

    def _candidates(self) -> Iterator[Invariant]:
        """Products of powers of weight 0, of few polynomials first."""
        polynomials = self._polynomials()
        weights = [self._weights(each) for each in polynomials]
        for size in range(1, len(self._scalings) + 2):
            for chosen in islice(combinations(range(len(polynomials)), size), MOST_PRODUCTS):
                powers = _null_vector([weights[k] for k in chosen])
                if powers is not None and all(powers):
                    yield Invariant(
                        tuple((polynomials[k], power) for k, power in zip(chosen, powers, strict=True))
                    )

    def _weights(self, polynomial: IntegerPolynomial) -> tuple[Fraction, ...]:
        """Of its first monomial, for every scaling."""
        monomial = next(iter(polynomial))
        weights = [{term.moved: value for term, value in each.terms.items()} for each in self._scalings]
        return tuple(sum((own.get(name, Fraction(0)) for name in monomial), Fraction(0)) for own in weights)

    def _polynomials(self) -> list[IntegerPolynomial]:
        """Polynomials of one weight that the generators other than scalings leave alone."""
        if not self._rest:
            return [{(name,): Fraction(1)} for name in self._moved_names]
        groups: dict[tuple[int, tuple[Fraction, ...]], list[Monomial]] = defaultdict(list)
        for degree in range(1, HIGHEST_DEGREE + 1):
            for monomial in combinations_with_replacement([*self._moved_names, *self._others], degree):
                if not set(monomial).isdisjoint(self._moved_names):
                    groups[degree, self._weights({monomial: Fraction(1)})].append(monomial)
        found: list[IntegerPolynomial] = []
        by_weight: dict[tuple[Fraction, ...], list[Monomial]] = defaultdict(list)
        for (_, weights), monomials in sorted(groups.items(), key=lambda pair: pair[0][0]):
            # Lower degrees of the same weight may belong to the same polynomial.
            by_weight[weights] += monomials
            if len(by_weight[weights]) <= MOST_TERMS:
                found += self._left_alone(by_weight[weights])
        return found

    def _left_alone(self, monomials: list[Monomial]) -> list[IntegerPolynomial]:
        """Sums of monomials that the generators other than scalings leave alone."""
        check = self._conditions(monomials, self._confirming)
        first = self._conditions(monomials, self._field).null_space().T
        kernels = [first]

        def holds(values: list[Fraction]) -> bool:
            field = self._confirming
            return not field.reduced(field.product(check.rows, field.numbers(values)).sum(axis=1)).any()

        def vectors(k: int) -> Iterator[Modulo[Sequence[int]]]:
            for index, field in enumerate((self._field, *self._further)):
                if index == len(kernels):
                    kernels.append(self._conditions(monomials, field).null_space().T)
                if kernels[index].shape != first.shape:
                    return
                yield Modulo(field.prime, [int(value) for value in kernels[index][k]])

        found = []
        for k in sparsest_first(first):
            values = fractions_that_hold(vectors(k), holds)
            if values is not None:
                found.append(coprime_coefficients(monomials, values))
        return found

    def _conditions(self, monomials: list[Monomial], field: PrimeField) -> Echelon:
        """Rates of monomials along the generators other than scalings, at random points."""
        values = self._draw(-(-(len(monomials) + SPARE) // len(self._rest)) + 2, field)
        rows = Echelon(len(monomials), field)
        for each in self._rest:
            rates = _components(each, values, field)
            rows.add(np.stack([monomial_rate(term, values, rates, field) for term in monomials], axis=1))
        return rows


def _components(generator: Generator, values: Values, field: PrimeField) -> dict[str, Num[np.ndarray, " b"]]:
    return {name: generator.component(name, values, field) for name in generator.components}


def _residues(polynomial: IntegerPolynomial, field: PrimeField) -> dict[Monomial, int]:
    return {each: residue(value, field.prime) for each, value in polynomial.items()}


def _in_words(polynomial: IntegerPolynomial) -> str:
    return sum_in_words([product_in_words(value, each) for each, value in polynomial.items()])


def _power_in_words(polynomial: IntegerPolynomial, power: int) -> str:
    words = _in_words(polynomial)
    single = len(polynomial) == 1 and (power == 1 or len(next(iter(polynomial))) == 1)
    if not single:
        words = f"({words})"
    return words if power == 1 else f"{words}**{power}"


def _null_vector(weights: Sequence[tuple[Fraction, ...]]) -> list[int] | None:
    """Coprime integers e with sum_i e_i w_i = 0, most of them or the last positive; None unless it is the only one."""
    rows = [list(column) for column in zip(*weights, strict=True)]
    count, pivots = len(weights), []
    for row in rows:
        for pivot, known in pivots:
            row[:] = [a - row[pivot] * b for a, b in zip(row, known, strict=True)]
        place = next((k for k, value in enumerate(row) if value), None)
        if place is not None:
            row[:] = [value / row[place] for value in row]
            for _, known in pivots:
                known[:] = [a - known[place] * b for a, b in zip(known, row, strict=True)]
            pivots.append((place, row))
    if len(pivots) != count - 1:
        return None
    free = next(k for k in range(count) if k not in {pivot for pivot, _ in pivots})
    vector = [Fraction(0)] * count
    vector[free] = Fraction(1)
    for pivot, row in pivots:
        vector[pivot] = -row[free]
    if not all(vector):
        return None
    whole = [int(value) for value in coprime_integers(vector)]
    positive = sum(value > 0 for value in whole)
    flipped = positive < count - positive or (2 * positive == count and whole[-1] < 0)
    return [-value for value in whole] if flipped else whole


@dataclass(frozen=True)
class Reparametrisation:
    """A model with as many unknowns as are determined, which has the same outputs.

    Attributes
    ----------
    model : Model
        In the new unknowns; each has the name of the unknown it takes the place of.
    definitions : dict[str, str]
        The new unknowns that differ, by the old ones.
    fixed : dict[str, int]
        Unknowns that are left out, and the numbers that take their place.
    """

    model: Model
    definitions: dict[str, str]
    fixed: dict[str, int]

    def __str__(self) -> str:
        fixed = ", ".join(f"{name} = {value}" for name, value in self.fixed.items())
        news = ", ".join(f"{text} in the place of {name}" for name, text in self.definitions.items())
        return f"The outputs are the same with {fixed}" + (f" and {news}" if news else "")

    def document(self) -> dict[str, object]:
        """The model for JSON."""
        return {
            "fixed": self.fixed,
            "definitions": self.definitions,
            "equations": self.equations,
            "outputs": self.outputs,
        }

    @property
    def length(self) -> tuple[int, int]:
        """Quotients and characters of its formulas."""
        words = "".join((*self.equations.values(), *self.outputs.values()))
        return words.count("/"), len(words)

    @property
    def equations(self) -> dict[str, str]:
        """Rates of the states that are left."""
        return {name: written(self.model.rates[name]) for name in self.model.states}

    @property
    def outputs(self) -> dict[str, str]:
        """The outputs in the new unknowns."""
        return {name: written(each) for name, each in self.model.outputs.items()}


def reparametrised(model: Model, generators: Sequence[Generator]) -> Reparametrisation | None:
    """A minimal model with the same outputs; None where generators do more than scale and shift, or none is found.

    The outputs of both are compared at random points modulo a prime, derivative by derivative, and the new model has full rank.
    """
    if model.known_initial_values or model.point or not generators:
        return None
    scalings = [each for each in generators if each.kind == "scaling"]
    shifts = [each for each in generators if each.kind == "translation"]
    if len(scalings) + len(shifts) < len(generators):
        return None
    groups = [{name for each in part for name in each.components} for part in (scalings, shifts)]
    if groups[0] & groups[1]:
        return None
    names = [*model.parameters, *([] if model.unknown_inputs else model.states)]
    frames = [
        list(islice(_frames(part, [each for each in names if each in group]), MOST_FRAMES)) if part else [{}]
        for part, group in zip((scalings, shifts), groups, strict=True)
    ]
    tried = [(_in_frame(model, scaled, shifted), scaled, shifted) for scaled, shifted in product(*frames)]
    # Few quotients and short formulas first; states, whose rates come in, are fixed where constants do not suffice.
    tried.sort(key=lambda each: (len(set(each[0].fixed) & set(model.states)), each[0].length))
    for found, scaled, shifted in tried[:MOST_TRIED]:
        part = reached(found.model)
        if exact_rank(part).null_space.shape[1] == 0 and _same_outputs(reached(model), part, scaled, shifted):
            return found
    return None


Frame = dict[str, dict[str, int]]
"""By fixed unknown: the exponent or multiple with which every other one goes along."""


def _frames(generators: Sequence[Generator], names: Sequence[str]) -> Iterator[Frame]:
    """Sets of unknowns to fix, constants first, and integers with which the others go along."""
    weights = [{term.moved: value for term, value in each.terms.items()} for each in generators]
    moved = sorted({name for each in weights for name in each})
    for chosen in islice(combinations(names, len(generators)), MOST_CHOICES):
        table = [[own.get(name, Fraction(0)) for name in (*chosen, *moved)] for own in weights]
        solved = _reduce_rows(table, len(chosen))
        if solved is None or any(value.denominator != 1 for row in solved for value in row):
            continue
        others = [(len(chosen) + k, name) for k, name in enumerate(moved) if name not in chosen]
        yield {
            fixed: {name: int(row[k]) for k, name in others if row[k]}
            for fixed, row in zip(chosen, solved, strict=True)
        }


def _reduce_rows(rows: list[list[Fraction]], count: int) -> list[list[Fraction]] | None:
    """Rows with the unit matrix in their first columns; None where these are singular."""
    rows = [list(row) for row in rows]
    for k in range(count):
        pivot = next((i for i in range(k, count) if rows[i][k]), None)
        if pivot is None:
            return None
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [value / rows[k][k] for value in rows[k]]
        for i in range(count):
            if i != k and rows[i][k]:
                rows[i] = [a - rows[i][k] * b for a, b in zip(rows[i], rows[k], strict=True)]
    return rows


def _in_frame(model: Model, scaled: Frame, shifted: Frame) -> Reparametrisation:
    """The model at fixed unknowns of 1 or 0, less what their own rates add."""
    fixed = dict.fromkeys(scaled, 1) | dict.fromkeys(shifted, 0)
    symbols = ca.vertcat(*[model.symbols[name] for name in fixed])
    numbers = ca.DM(list(fixed.values()))

    def at_frame(expression: ca.SX) -> ca.SX:
        return ca.substitute(ca.SX(expression), symbols, numbers)

    rates = {}
    for name in model.states:
        if name in fixed:
            continue
        rate = at_frame(model.rates[name])
        for table, scales in ((scaled, True), (shifted, False)):
            for other, powers in table.items():
                if other in model.states and name in powers:
                    own = at_frame(model.rates[other]) * powers[name]
                    rate -= model.symbols[name] * own if scales else own
        rates[name] = rate
    left = {
        key: tuple(name for name in getattr(model, key) if name not in fixed)
        for key in ("states", "parameters")
    }
    outputs = {name: at_frame(each) for name, each in model.outputs.items()}
    reduced = replace(model, rates=rates, outputs=outputs, **left)
    definitions = {}
    for name in (*left["parameters"], *left["states"]):
        powers = [(other, row[name]) for other, row in scaled.items() if name in row]
        if powers:
            factors = (
                ({(name,): Fraction(1)}, 1),
                *[({(other,): Fraction(1)}, -power) for other, power in powers],
            )
            definitions[name] = str(Invariant(factors))
        multiples = [(other, row[name]) for other, row in shifted.items() if name in row]
        if multiples:
            parts = [name, *[product_in_words(Fraction(-value), (other,)) for other, value in multiples]]
            definitions[name] = sum_in_words(parts)
    return Reparametrisation(reduced, definitions, fixed)


def _same_outputs(old: ReachedModel, new: ReachedModel, scaled: Frame, shifted: Frame) -> bool:
    """Whether derivatives of outputs agree at random points; with unknown inputs or functions, that rests on the generators."""
    if not (is_rational(old) and is_rational(new)):
        return True
    field, random = PrimeField(), np.random.default_rng(8)
    names = {*old.model.states, *old.model.parameters, *old.model.known_constants, *old.model.inputs}
    values = field.draw(sorted(names), POINTS, random)
    image = dict(values)
    for fixed, row in scaled.items():
        inverse = field.inverse(values[fixed])
        for name, power in row.items():
            for _ in range(abs(power)):
                image[name] = field.product(image[name], inverse if power > 0 else values[fixed])
    for fixed, row in shifted.items():
        for name, multiple in row.items():
            step = field.product(values[fixed], field.numbers([Fraction(-multiple)]))
            image[name] = field.reduced(image[name] + step)
    found = []
    for part, given in ((old, values), (new, image)):
        point, good = point_at(part, given, field)
        if not good.all():
            return False
        seed = np.random.default_rng(9)
        found.append(np.stack(list(output_coefficients(part, point, TRIED_ORDERS, seed)))[..., 0])
    return bool((found[0] == found[1]).all())
