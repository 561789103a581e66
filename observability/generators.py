"""Generators in closed form: vector fields that move unknowns so that no output changes, found modulo a prime.

A field xi of the unknowns leaves all outputs alone, at all times, if D xi_x = X f for every state, D xi_p = 0 for every
parameter and X h = 0 for every output, where D is the derivative along the motion and X that along xi. With xi a sum of monomials
these are linear equations for its coefficients at every point. They are solved at random points modulo as many primes as it takes
to lift them to fractions, which are tried at points modulo another prime: a coefficient that is no fraction is none of both.
The change of an unknown input is any function, and eliminated point by point.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import chain, combinations_with_replacement, islice

import numpy as np
from jaxtyping import Num

from observability.exact_numbers import SIMPLE, PrimeField, residue
from observability.invariant_manifold import restricted, staying
from observability.model import Model
from observability.model_rank import (
    ReachedModel,
    draw_points,
    exact_rank,
    fields_of,
    reached,
    start_values,
)
from observability.monomials import (
    Polynomial,
    Values,
    monomial_rate,
    monomial_value,
    polynomial_value,
    product_in_words,
    sum_in_words,
    weight,
)
from observability.null_fields import NullFields, is_rational
from observability.power_series import Series
from observability.rational_generators import (
    Modulo,
    coprime_coefficients,
    fractions_that_hold,
    rational_fields,
    sparsest_first,
)
from observability.residue_matrices import Echelon, reduce_columns

SPARE = 6
"""Equations beyond the number of coefficients."""
MOST_TERMS = 500
"""Coefficients solved for at once; a larger ansatz is not tried."""
INTERPOLATION_SECONDS = 6.0
"""After which rational fields are no longer looked for."""
LARGEST_BESIDE_ROUNDED = 10**12
"""Of the integers of a field where equations hold constants that are rounded: longer ones are made of these."""
MOST_PRIMES = 6
"""That coefficients are put together of."""


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

    def vectors(self, names: Sequence[str], values: Values, field: PrimeField) -> Num[np.ndarray, "b n"]:
        """Its components of these unknowns at points."""
        return np.stack([self.component(name, values, field) for name in names], axis=1)

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

    def conditions(field: PrimeField) -> Echelon:
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
        return rows

    sums = [combined(found, weights) for weights in _confirmed_kernel(part, conditions, random)]
    names = set(model.known_initial_values)
    # What moves nothing but states that are known at time 0 is no direction of the unknowns.
    return [each for each in sums if not names.issuperset(each.components)]


def _confirmed_kernel(
    part: ReachedModel, conditions: Callable[[PrimeField], Echelon], random: np.random.Generator
) -> Iterator[list[Fraction]]:
    """Null vectors of conditions in fractions, without those that are of none that hold modulo another prime."""
    fields = fields_of(part, random)
    first, checked = next(fields, None), next(fields, None)
    if first is None or checked is None:
        return
    kernels = [Modulo(first.prime, conditions(first).null_space().T)]
    if not len(kernels[0].residues):
        return
    check = conditions(checked)

    def holds(values: list[Fraction]) -> bool:
        sizes = checked.product(check.rows, checked.numbers(values))
        return not checked.reduced(sizes.sum(axis=1)).any()

    for k in range(len(kernels[0].residues)):
        columns = _columns(
            kernels, k, (Modulo(each.prime, conditions(each).null_space().T) for each in fields)
        )
        found = fractions_that_hold(columns, holds)
        if found is not None:
            yield found


Kernel = Modulo[Num[np.ndarray, "k t"]]
"""Null vectors modulo a prime, a row each."""


def _columns(known: list[Kernel], k: int, further: Iterator[Kernel]) -> Iterator[Modulo[Sequence[int]]]:
    """The k-th null vector modulo one prime after the other; those of further primes are added to the known ones."""
    for index in range(MOST_PRIMES):
        if index == len(known):
            new = next(further, None)
            if new is None:
                return
            known.append(new)
        each = known[index]
        if each.residues.shape != known[0].residues.shape:
            return
        yield Modulo(each.prime, [int(value) for value in each.residues[k]])


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
        rows.add(each.vectors(counted, values, field))
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


def _is_rounded(value: Fraction) -> bool:
    """Whether a constant has all digits of a float, as that of a root or cosine has."""
    return value.denominator > SIMPLE and Fraction(f"{float(value):.15g}") != value


class _Search:
    """Ansatz after ansatz, until all directions have a generator."""

    def __init__(self, part: ReachedModel, moved: list[str], count: int, seed: int) -> None:
        self._part, self._moved_names, self._count = part, moved, count
        self._random = np.random.default_rng(seed)
        fields = fields_of(part, self._random)
        self._field = next(fields, PrimeField())
        self.found: list[Generator] = []
        self._scalings: list[Generator] = []
        self._rounded = any(_is_rounded(value) for _, value in part.tape.constants)
        self._points = _Points(part, self._field, self._random)
        self._fixed_point = _Points(part, self._field, self._random)
        confirming = next(fields, None)
        self._confirming = None if confirming is None else _Points(part, confirming, self._random)
        self._further = (_Points(part, each, self._random) for each in fields)
        self._others: list[_Points] = []
        self._directions = Echelon(len(moved) + len(part.unknown_inputs), self._field)

    @property
    def missing(self) -> int:
        """Directions without a generator."""
        return self._count - len(self.found)

    def scalings(self) -> None:
        """Fields x -> weight x."""
        self._solve([Term(name, (name,)) for name in self._moved_names])
        self._scalings = list(self.found)

    def _weights(self, prime: int) -> list[dict[str, int]]:
        """Of the scalings found, as residues."""
        return [
            {term.moved: residue(value, prime) for term, value in each.terms.items()}
            for each in self._scalings
        ]

    def try_degrees(self, degrees: Sequence[int], wide: bool) -> None:
        """Monomials of some degrees, split by their weights under the scalings found.

        Factors are the unknowns that move, or (``wide``) all constants as well.
        """
        groups: dict[tuple[int, ...], list[Term]] = defaultdict(list)
        prime = self._field.prime
        weights = self._weights(prime)
        others = [name for name in self._part.constants if wide or name in self._moved_names]
        states = [name for name in self._moved_names if name not in self._part.constants]
        for name in self._moved_names:
            factors = others if name in others else [*others, *states]
            for degree in degrees:
                for chosen in combinations_with_replacement(factors, degree):
                    term = Term(name, chosen)
                    groups[weight(chosen, (name,), weights, prime)].append(term)
        for terms in sorted(groups.values(), key=len):
            if self.missing and len(terms) <= MOST_TERMS:
                self._solve(terms)

    def interpolate(self, orders: int) -> None:
        """Rational fields, cleared of their denominators, from null vectors at many points."""
        part = self._part
        still = [name for name in part.states if part.model.rates[name].is_zero()]
        constants = frozenset((*part.constants, *still))

        def started(field: PrimeField) -> Iterator[dict[str, Polynomial]]:
            fields = NullFields(part, orders, self._count, field, self._random, INTERPOLATION_SECONDS)
            return rational_fields(fields, constants, self._weights(field.prime))

        for index, found in enumerate(started(self._field)):
            others = (
                Modulo(each.field.prime, next(islice(started(each.field), index, None), {}))
                for each in self._other_points()
            )
            generator = as_generator(chain([Modulo(self._field.prime, found)], others), self._is_confirmed)
            if generator is not None:
                self._keep(generator)
            if not self.missing:
                return

    def _other_points(self) -> Iterator[_Points]:
        """Points of the primes that coefficients are put together of, beyond the first; drawn when they are needed."""
        for index in range(MOST_PRIMES - 1):
            if index == len(self._others):
                new = next(self._further, None)
                if new is None:
                    return
                self._others.append(new)
            yield self._others[index]

    def _solve(self, terms: list[Term]) -> None:
        count = len(terms) + SPARE
        first = self._kernel(terms, self._points, count)
        # Some equations of a point are dependent or empty, such as those of states that nothing moves: take more points then.
        while len(first) and not self._hold_elsewhere(terms, first):
            count *= 2
            first = self._kernel(terms, self._points, count)
        kernels = [Modulo(self._field.prime, first)]
        further = (
            Modulo(each.field.prime, self._kernel(terms, each, count)) for each in self._other_points()
        )
        for k in sparsest_first(first):
            if not self.missing:
                return
            values = fractions_that_hold(
                _columns(kernels, k, further), lambda values: self._is_confirmed(_generator(terms, values))
            )
            if values is not None:
                self._keep(_generator(terms, values))

    @staticmethod
    def _kernel(terms: list[Term], points: _Points, count: int) -> Num[np.ndarray, "k t"]:
        """Null vectors of so many equations for the coefficients."""
        rows = Echelon(len(terms), points.field)
        rows.add(points.equations(terms, count))
        return rows.null_space().T

    def _hold_elsewhere(self, terms: list[Term], kernel: Num[np.ndarray, "k t"]) -> bool:
        """Whether null vectors fulfil the equations of points that they were not found from."""
        field = self._field
        rows = self._fixed_point.equations(terms, SPARE)
        return not any(field.reduced(field.product(rows, each).sum(axis=1)).any() for each in kernel)

    def _is_confirmed(self, generator: Generator) -> bool:
        """Whether a generator holds at points modulo a prime that it was not found from."""
        points = self._confirming
        longest = max(abs(value) for value in generator.terms.values())
        if points is None or (self._rounded and longest > LARGEST_BESIDE_ROUNDED):
            return False
        rows = points.equations(list(generator.terms), SPARE)
        coefficients = points.field.numbers(list(generator.terms.values()))
        return not points.field.reduced(points.field.product(rows, coefficients).sum(axis=1)).any()

    def _keep(self, generator: Generator) -> None:
        """Keep a generator that is independent of those known."""
        before = self._directions.rank
        self._directions.add(self._fixed_point.direction(generator, self._moved_names)[np.newaxis])
        if self._directions.rank > before:
            self.found.append(generator)


def combined(fields: Sequence[Generator], weights: Sequence[Fraction]) -> Generator:
    """The sum of fields with weights."""
    terms: dict[Term, Fraction] = defaultdict(Fraction)
    for factor, each in zip(weights, fields, strict=True):
        for term, value in each.terms.items():
            terms[term] += value * factor
    return Generator({term: value for term, value in terms.items() if value})


def as_generator(
    found: Iterable[Modulo[dict[str, Polynomial]]], holds: Callable[[Generator], bool]
) -> Generator | None:
    """A field in coprime integers, from its residues up to a factor modulo one prime after the other; None unless it holds."""
    fields = iter(found)
    first = next(fields)
    terms = [Term(name, factors) for name, each in first.residues.items() for factors in each]

    def scaled(each: Modulo[dict[str, Polynomial]], by: Term) -> Modulo[Sequence[int]]:
        field, prime = each.residues, each.prime
        factor = pow(field[by.moved][by.factors], -1, prime)
        return Modulo(prime, [field[term.moved][term.factors] * factor % prime for term in terms])

    def confirmed(vectors: Iterable[Modulo[Sequence[int]]]) -> Generator | None:
        values = fractions_that_hold(vectors, lambda values: holds(_generator(terms, values)))
        return None if values is None else _generator(terms, values)

    # Any coefficient may carry the common factor: the first by which all others are simple fractions is it.
    for term in terms:
        generator = confirmed([scaled(first, term)])
        if generator is not None:
            return generator
    monomials = {name: set(each) for name, each in first.residues.items()}
    alike = (each for each in fields if {name: set(own) for name, own in each.residues.items()} == monomials)
    return confirmed(scaled(each, terms[0]) for each in chain([first], alike))


def _generator(terms: Sequence[Term], values: Sequence[Fraction]) -> Generator:
    """Terms with coprime integers as coefficients, without those of 0."""
    return Generator(coprime_coefficients(terms, values))
