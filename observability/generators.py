"""Generators in closed form: vector fields that move unknowns so that no output changes, found modulo a prime.

A field xi of the unknowns leaves all outputs alone, at all times, if D xi_x = X f for every state, D xi_p = 0 for every
parameter and X h = 0 for every output, where D is the derivative along the motion and X that along xi. With xi a sum of monomials
these are linear equations for its coefficients at every point. They are solved modulo a prime at random points, lifted to
fractions, and tried again at other points. The change of an unknown input is any function, and eliminated point by point.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations_with_replacement

import numpy as np
from jaxtyping import Num

from observability.exact_numbers import PrimeField, residue
from observability.invariant_manifold import restricted, staying
from observability.model import Model
from observability.model_rank import ReachedModel, draw_points, exact_rank, reached, start_values
from observability.monomials import (
    Polynomial,
    Values,
    coprime_integers,
    fraction_of,
    monomial_rate,
    monomial_value,
    polynomial_value,
    product_in_words,
    sum_in_words,
    weight,
)
from observability.null_fields import NullFields, is_rational
from observability.power_series import Series
from observability.rational_generators import rational_fields
from observability.residue_matrices import Echelon, reduce_columns

SPARE = 6
"""Equations beyond the number of coefficients."""
MOST_TERMS = 500
"""Coefficients solved for at once; a larger ansatz is not tried."""
INTERPOLATION_SECONDS = 6.0
"""After which rational fields are no longer looked for."""


@dataclass(frozen=True)
class Term:
    """One monomial of one component: the unknown that moves, and the factors."""

    moved: str
    factors: tuple[str, ...]


@dataclass(frozen=True)
class Generator:
    """A field of the unknowns with rational coefficients.

    Attributes
    ----------
    terms : dict[Term, Fraction]
        Coefficient by term.
    """

    terms: dict[Term, Fraction]

    @property
    def kind(self) -> str:
        """Scaling, translation, affine or polynomial."""
        if all(term.factors == (term.moved,) for term in self.terms):
            return "scaling"
        if not any(term.factors for term in self.terms):
            return "translation"
        return "affine" if all(len(term.factors) < 2 for term in self.terms) else "polynomial"

    @property
    def components(self) -> dict[str, str]:
        """xi of every unknown that moves, as a formula."""
        found: dict[str, list[str]] = defaultdict(list)
        for term, value in self.terms.items():
            found[term.moved].append(product_in_words(value, term.factors))
        return {name: sum_in_words(parts) for name, parts in found.items()}

    def component(self, name: str, values: Values, field: PrimeField) -> Num[np.ndarray, " b"]:
        """xi of one unknown at points."""
        own = {
            term.factors: residue(value, field.prime)
            for term, value in self.terms.items()
            if term.moved == name
        }
        return polynomial_value(own, values, field)

    def __str__(self) -> str:
        """Finite moves by an amount ε where they are simple: x -> e^ε x."""
        if self.kind == "scaling":
            moves = [f"{t.moved} -> {_exponential(v)} {t.moved}" for t, v in self.terms.items()]
        elif self.kind == "translation":
            moves = [f"{t.moved} -> {t.moved} {_signed(v)}" for t, v in self.terms.items()]
        else:
            moves = [f"d{name}/dε = {text}" for name, text in self.components.items()]
        return ", ".join(moves)


def _exponential(value: Fraction) -> str:
    if value.denominator == 1:
        return {1: "e^ε", -1: "e^-ε"}.get(int(value), f"e^({value}ε)")
    return f"e^({value} ε)"


def _signed(value: Fraction) -> str:
    size = "ε" if abs(value) == 1 else f"{abs(value)} ε"
    return f"{'-' if value < 0 else '+'} {size}"


def named_directions(model: Model) -> list[Generator]:
    """Independent generators of a model at its point.

    At a special point these are the generic ones, and those of the manifold of states that stay at their values there. With known
    initial values of states that leave them, those that keep these values.
    """
    if not model.point:
        return generic_directions(model)
    generic = replace(model, point={})
    found = generic_directions(generic)
    still = staying(model, model.point)
    if still:
        found += generic_directions(restricted(generic, still))
    return _independent(model, found)


def generic_directions(model: Model) -> list[Generator]:
    """Generators that hold everywhere."""
    part = reached(model)
    free = [Generator({Term(name, ()): Fraction(1)}) for name in model.unknowns if name not in part.unknowns]
    if model.known_initial_values:
        generic = replace(model, known_initial_values={})
        kept = _kept_at_start(model, generic_directions(generic))
        return _independent(generic, [*free, *kept], model.unknowns)
    found = exact_rank(part)
    moved = [name for name, row in zip(found.names, found.null_space, strict=True) if row.any()]
    return free + generators(part, moved, found.null_space.shape[1], found.order + 1)


def _kept_at_start(model: Model, found: list[Generator]) -> list[Generator]:
    """Sums of fields that keep known initial values: xi_x = (d x0 / d p) xi_p at time 0."""
    if not found:
        return []
    part, random = reached(model), np.random.default_rng(4)
    field = PrimeField()
    point = draw_points(part, random, field, len(found) + SPARE)
    start = start_values(part, point, 1 + len(part.unknowns))
    values = {
        name: each
        for names, group in zip(part.groups, point.values, strict=True)
        for name, each in zip(names, group.p, strict=True)
    }
    rows = Echelon(len(found), field)
    for state in model.known_initial_values:
        moves = [each.component(state, values, field) for each in found]
        if state in part.states:
            for k, name in enumerate(part.unknowns):
                slope = field.negative(start[part.states.index(state), :, 1 + k])
                moves = [
                    field.reduced(move + field.product(slope, each.component(name, values, field)))
                    for move, each in zip(moves, found, strict=True)
                ]
        rows.add(np.stack(moves, axis=1))
    sums = [combined(found, weights, field.prime) for weights in rows.null_space().T]
    names = set(model.known_initial_values)
    # What moves nothing but states that are known at time 0 is no direction of the unknowns.
    return [each for each in sums if each is not None and not names.issuperset(each.components)]


def _independent(
    model: Model, found: Iterable[Generator], unknowns: tuple[str, ...] | None = None
) -> list[Generator]:
    """Fields that are independent of the ones before at the model's point, in some unknowns."""
    field, random = PrimeField(), np.random.default_rng(3)
    symbols = (*model.states, *model.parameters, *model.known_constants)
    values = {
        name: field.numbers([model.point[name]])
        if name in model.point
        else random.integers(1, field.prime, 1, dtype=np.uint64)
        for name in symbols
    }
    counted = model.unknowns if unknowns is None else unknowns
    rows, kept = Echelon(len(counted), field), []
    for each in found:
        before = rows.rank
        rows.add(np.stack([each.component(name, values, field) for name in counted], axis=1))
        if rows.rank > before:
            kept.append(each)
    return kept


def generators(
    part: ReachedModel, moved: Sequence[str], count: int, orders: int, seed: int = 1
) -> list[Generator]:
    """Independent generators, at most so many: scalings, then translations, affine and quadratic fields.

    Parameters
    ----------
    part : ReachedModel
        The model without a special point and known initial values.
    moved : Sequence[str]
        Unknowns that some null direction moves.
    count : int
        Dimension of the null space.
    orders : int
        Orders of derivatives that reach the rank.
    """
    moving = [name for name in moved if name not in part.unknown_inputs]
    if not moving:
        return []
    search = _Search(part, moving, count, seed)
    search.scalings()
    for degrees in ((0, 1), (0, 1, 2)):
        if search.missing:
            search.try_degrees(degrees, wide=False)
    if search.missing and is_rational(part):
        search.interpolate(orders)
    if search.missing and part.unknown_inputs:
        search.try_degrees((3,), wide=False)
    if search.missing:
        search.try_degrees((1, 2), wide=True)
    return search.found


class _Search:
    """Ansatz after ansatz, until all directions have a generator."""

    def __init__(self, part: ReachedModel, moved: list[str], count: int, seed: int) -> None:
        self._part, self._moved, self._count = part, moved, count
        self._random = np.random.default_rng(seed)
        self._field = PrimeField()
        self.found: list[Generator] = []
        self._weights: list[dict[str, int]] = []
        self._points = _Points(part, self._field, self._random)
        self._fixed_point = _Points(part, self._field, self._random)
        self._directions = Echelon(len(moved) + len(part.unknown_inputs), self._field)

    @property
    def missing(self) -> int:
        """Directions without a generator."""
        return self._count - len(self.found)

    def scalings(self) -> None:
        """Fields x -> weight x."""
        self._solve([Term(name, (name,)) for name in self._moved])
        self._weights = [
            {term.moved: residue(value, self._field.prime) for term, value in each.terms.items()}
            for each in self.found
        ]

    def try_degrees(self, degrees: Sequence[int], wide: bool) -> None:
        """Monomials of some degrees, split by their weights under the scalings found.

        Factors are the unknowns that move, or (``wide``) all constants as well.
        """
        groups: dict[tuple[int, ...], list[Term]] = defaultdict(list)
        others = [name for name in self._part.constants if wide or name in self._moved]
        states = [name for name in self._moved if name not in self._part.constants]
        for name in self._moved:
            factors = others if name in others else [*others, *states]
            for degree in degrees:
                for chosen in combinations_with_replacement(factors, degree):
                    term = Term(name, chosen)
                    groups[weight(chosen, (name,), self._weights, self._field.prime)].append(term)
        for terms in sorted(groups.values(), key=len):
            if self.missing and len(terms) <= MOST_TERMS:
                self._solve(terms)

    def interpolate(self, orders: int) -> None:
        """Rational fields, cleared of their denominators, from null vectors at many points."""
        part = self._part
        fields = NullFields(part, orders, self._count, self._field, self._random, INTERPOLATION_SECONDS)
        still = [name for name in part.states if part.model.rates[name].is_zero()]
        for found in rational_fields(fields, frozenset((*part.constants, *still)), self._weights):
            generator = as_generator(found, self._field.prime)
            if generator is not None:
                self._take(generator)
            if not self.missing:
                return

    def _solve(self, terms: list[Term]) -> None:
        matrix = self._points.equations(terms, len(terms) + SPARE)
        rows = Echelon(len(terms), self._field)
        rows.add(matrix)
        kernel = rows.null_space()
        for column in sorted(kernel.T, key=np.count_nonzero):
            generator = _lifted(terms, column, self._field.prime)
            if generator is not None and self.missing:
                self._take(generator)

    def _take(self, generator: Generator) -> None:
        """Keep a generator that holds at fresh points and is independent of those known."""
        terms = list(generator.terms)
        fresh = _Points(self._part, PrimeField(base=271828183), self._random)
        coefficients = fresh.field.numbers(list(generator.terms.values()))
        rows = fresh.equations(terms, SPARE)
        if fresh.field.reduced(fresh.field.product(rows, coefficients).sum(axis=1)).any():
            return
        before = self._directions.rank
        self._directions.add(self._fixed_point.direction(generator, self._moved)[np.newaxis])
        if self._directions.rank > before:
            self.found.append(generator)


class _Points:
    """A model's rates, outputs and their gradients at random points."""

    def __init__(self, part: ReachedModel, field: PrimeField, random: np.random.Generator) -> None:
        self._part, self.field, self._random = part, field, random
        self._values: dict[str, np.ndarray] = {}
        self._rows = np.zeros((0, 0, 0), dtype=np.uint64)

    def direction(self, generator: Generator, names: Sequence[str]) -> Num[np.ndarray, " n"]:
        """The field at the first point."""
        self._need(1)
        found = dict.fromkeys(names, 0)
        for term, value in generator.terms.items():
            size = residue(value, self.field.prime) * int(
                monomial_value(term.factors, self._values, self.field)[0]
            )
            found[term.moved] = (found[term.moved] + size) % self.field.prime
        own = np.array(list(found.values()), dtype=np.uint64)
        return np.concatenate([own, self._change_of_inputs(generator)])

    def _change_of_inputs(self, generator: Generator) -> Num[np.ndarray, " w"]:
        """Change of the unknown inputs at the first point that a field goes with: f_w dw = D xi - X f, h_w dw = -X h."""
        field = self.field
        free = [1 + self._part.unknowns.index(name) for name in self._part.unknown_inputs]
        if not free:
            return np.zeros(0, dtype=np.uint64)
        total = np.zeros(self._rows.shape[0], dtype=np.uint64)
        for term, value in generator.terms.items():
            size = np.array(residue(value, field.prime), dtype=np.uint64)
            total = field.reduced(total + field.product(size, self._entry(term, 1)[:, 0]))
        joined = np.concatenate([self._rows[:, 0, free], field.negative(total)[:, np.newaxis]], axis=1)
        reduced = reduce_columns(joined[np.newaxis], len(free), field)
        pivots = reduced.pivots[0]
        return np.where(pivots < 0, 0, reduced.rows[0, pivots, -1]).astype(np.uint64)

    def equations(self, terms: Sequence[Term], count: int) -> Num[np.ndarray, "r t"]:
        """At least so many equations for the coefficients of terms."""
        part, field = self._part, self.field
        each = max(1, len(part.states) + len(part.model.outputs) - len(part.unknown_inputs))
        points = -(-count // each) + 2
        self._need(points)
        rows = np.zeros((points, self._rows.shape[0], len(terms)), dtype=np.uint64)
        for k, term in enumerate(terms):
            rows[:, :, k] = self._entry(term, points).T
        free = [1 + part.unknowns.index(name) for name in part.unknown_inputs]
        if free:
            inputs = self._rows[:, :points, free].transpose(1, 0, 2)
            reduced = reduce_columns(np.concatenate([inputs, rows], axis=2), len(free), field)
            rows = reduced.rest[:, :, len(free) :]
        return rows.reshape(-1, len(terms))

    def _entry(self, term: Term, points: int) -> Num[np.ndarray, "r b"]:
        """X f - D xi_x, then X h, of one term."""
        field, part = self.field, self._part
        gradient = self._rows[:, :points, 1 + part.unknowns.index(term.moved)]
        entry = field.product(gradient, monomial_value(term.factors, self._values, field)[:points])
        if term.moved in part.states:
            row = part.states.index(term.moved)
            motion = dict(zip(part.states, self._rows[..., 0], strict=False))
            rate = monomial_rate(term.factors, self._values, motion, field)
            entry[row] = field.reduced(entry[row] + field.negative(rate[:points]))
        return entry

    def _need(self, count: int) -> None:
        """Draw as many points as are needed."""
        if self._rows.shape[1] >= count:
            return
        part, unknowns = self._part, self._part.unknowns
        point = draw_points(part, self._random, self.field, max(8, count))
        batch, width = point.values[0].p.shape[1], 1 + len(unknowns)
        series = Series(part.tape, point.decisions, self.field, (1, batch, width))
        self._values = {}
        for index, (group, values) in enumerate(zip(part.groups, point.values, strict=True)):
            given = np.zeros((len(group), batch, width), dtype=np.uint64)
            given[..., 0] = values.p
            for k, name in enumerate(group):
                self._values[name] = values.p[k]
                if name in unknowns:
                    given[k, :, 1 + unknowns.index(name)] = 1
            series.put(index, 0, given)
        self._rows = series.advance(0)


def combined(fields: Sequence[Generator], weights: Num[np.ndarray, " n"], prime: int) -> Generator | None:
    """The sum of fields with residues as weights; None where these are of no simple fractions."""
    factors = [fraction_of(int(weight), prime) for weight in weights]
    if any(factor is None for factor in factors):
        return None
    terms: dict[Term, Fraction] = defaultdict(Fraction)
    for factor, each in zip(factors, fields, strict=True):
        for term, value in each.terms.items():
            terms[term] += value * (factor or 0)
    return Generator({term: value for term, value in terms.items() if value})


def as_generator(components: dict[str, Polynomial], prime: int) -> Generator | None:
    """A field of residues in coprime integers."""
    pairs = [
        (Term(name, factors), value) for name, each in components.items() for factors, value in each.items()
    ]
    values = np.array([value for _, value in pairs], dtype=np.uint64)
    # Any coefficient may carry the common factor: the first by which all others are simple fractions is it.
    for value in values.tolist():
        scaled = values * np.uint64(pow(value, -1, prime)) % np.uint64(prime)
        generator = _lifted([term for term, _ in pairs], scaled, prime)
        if generator is not None:
            return generator
    return None


def _lifted(terms: Sequence[Term], column: Num[np.ndarray, " t"], prime: int) -> Generator | None:
    """A kernel vector in fractions, with coprime integers; None where its residues are of no simple fractions."""
    kept = np.flatnonzero(column)
    values = [fraction_of(int(column[k]), prime) for k in kept]
    if any(value is None for value in values):
        return None
    fractions = [value for value in values if value is not None]
    whole = coprime_integers(fractions)
    return Generator({terms[k]: value for k, value in zip(kept.tolist(), whole, strict=True)})
