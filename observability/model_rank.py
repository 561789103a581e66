"""Exact rank of a model's outputs by its unknowns at a random or special point, with its null space."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, cached_property

import casadi as ca
import numpy as np
from jaxtyping import Bool, Int, Num

from observability.codistribution import ExactRank, Flow, motion_coefficients, rank_by_orders
from observability.exact_numbers import PRIME, NotRegularError, PrimeField, residue
from observability.function_values import (
    BranchDecisions,
    FunctionValues,
    Residues,
    function_values,
    powers,
)
from observability.invariant_manifold import staying
from observability.model import Model
from observability.power_series import Series
from observability.residue_matrices import Reduced, null_vectors, reduce_columns
from observability.tape import PIECEWISE, Choices, Tape, float_choices, tape_of
from spinfilters.core.errors import InputError

BATCHES = (1, 16, 64, 256)
"""Random points drawn at once until all roots and logarithms exist."""
MOST_PRIMES = 400
"""Primes tried for values that are given and cannot be drawn."""
MOST_FIELDS = 60
"""Primes tried for fields of which some are wanted."""
MOST_POINTS = 20_000
"""Points drawn at once, at most."""
LARGEST_INPUT = 1 << 30
"""Of the integers drawn as derivatives of inputs: below all primes, so that they are the same modulo each."""
THOUSANDTHS = 1000
"""In a unit: of values at which branches are decided."""
LARGEST_WORK = 1e9
"""Products of a series, order by order, after which no higher derivative is taken: some 25 seconds."""
COFACTOR = 24
"""Of primes 24 q + 1, of which 2 and 3 may have roots: those of a prime 4 q + 1 never do."""
ROOTED = (2, 3, 5, 7)
SIEVED_FOR_ROOTS = 1 << 20
SIEVED = 1 << 18
"""Numbers q below 2^29 among which primes are looked for."""


@dataclass(frozen=True)
class ReachedModel:
    """What of a model some output depends on, as one tape.

    Attributes
    ----------
    model : Model
        The whole.
    states, constants, inputs, unknown_inputs : tuple[str, ...]
        Names that outputs depend on; constants are parameters and known constants.
    """

    model: Model
    states: tuple[str, ...]
    constants: tuple[str, ...]
    inputs: tuple[str, ...]
    unknown_inputs: tuple[str, ...]

    @cached_property
    def unknowns(self) -> tuple[str, ...]:
        """In the order of the model's unknowns."""
        named = {*self.states, *self.constants, *self.unknown_inputs}
        return tuple(each for each in self.model.unknowns if each in named)

    @cached_property
    def is_invariant(self) -> bool:
        """Whether the point is a generic one of an invariant manifold: what has a special value keeps it."""
        model = self.model
        if model.known_initial_values or model.unknown_inputs:
            return False
        moving = set(model.point) & set(self.states)
        return moving <= set(staying(model, model.point))

    @property
    def rows(self) -> list[ca.SX]:
        """Rates of the states, then outputs."""
        return [self.model.rates[each] for each in self.states] + list(self.model.outputs.values())

    @cached_property
    def tape(self) -> Tape:
        """(states, constants, inputs, unknown inputs) -> rates, then outputs."""
        return tape_of(self.model.name, self.arguments, ca.vertcat(*self.rows), constants_known=True)

    @cached_property
    def start(self) -> Tape:
        """Same arguments -> states at time 0."""
        known, symbols = self.model.known_initial_values, self.model.symbols
        rows = [known.get(each, symbols[each]) for each in self.states]
        return tape_of(
            f"{self.model.name}: the start", self.arguments, ca.vertcat(*rows), constants_known=True
        )

    @cached_property
    def radicands(self) -> frozenset[Fraction]:
        """Numbers that a prime field must have a root of: constants under a root or logarithm, and factors of symbols there.

        Drawn values are themselves in the group of numbers with roots, and so are their products, roots and powers.
        """
        drawn = not (self.model.point or self.model.known_initial_values or self.model.unit_vectors)
        tapes = (self.tape, self.start) if self.model.known_initial_values else (self.tape,)
        drawn = drawn and PIECEWISE.isdisjoint(self.tape.operations)
        return frozenset().union(*[each.radicands(drawn) for each in tapes])

    @property
    def arguments(self) -> list[ca.SX]:
        """Symbols, group by group."""
        return [
            ca.vertcat(*[self.model.symbols[each] for each in group]) if group else ca.SX(0, 1)
            for group in self.groups
        ]

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """The names, group by group."""
        return (self.states, self.constants, self.inputs, self.unknown_inputs)

    @property
    def most_orders(self) -> int:
        """Orders (in discrete time periods) that are taken where nothing shows that fewer are enough."""
        return len(self.unknowns) + 2 + len(self.states)

    @property
    def orders_with_unknown_inputs(self) -> tuple[int, ...]:
        """Numbers of orders after which a rank with unknown inputs is computed, ascending."""
        most = self.most_orders
        return tuple(sorted({most // 2 + 1, (3 * most) // 4 + 1, most}))

    def drawn_unit_vectors(self, names: Sequence[str]) -> list[list[int]]:
        """Places among these names of the unit vectors whose values are drawn."""
        vectors = [
            each for each in self.model.unit_vectors if each[0] in names and each[0] not in self.model.point
        ]
        return [[names.index(name) for name in each] for each in vectors]

    def jet_columns(self, order: int) -> Int[np.ndarray, " k"]:
        """Columns of the unknown inputs' coefficients of an order from 1 on, after the value and the unknowns' tangents."""
        count = len(self.unknown_inputs)
        return 1 + len(self.unknowns) + (order - 1) * count + np.arange(count)


def reached(model: Model) -> ReachedModel:
    """The part of a model that its outputs depend on."""
    seen = set(model.reached)
    for state in model.states:
        if state in seen and state in model.known_initial_values:
            seen |= {symbol.name() for symbol in ca.symvar(model.known_initial_values[state])}
    constants = (*model.parameters, *model.known_constants)
    groups = (model.states, constants, model.inputs, model.unknown_inputs)
    return ReachedModel(model, *[tuple(each for each in group if each in seen) for group in groups])


@dataclass(frozen=True)
class DrawnPoint:
    """A point, or several, in the residues of a prime field.

    Attributes
    ----------
    field : PrimeField
        Of the residues.
    values : tuple[Residues, ...]
        States, constants, inputs, unknown inputs, (n, b) each.
    decisions, start_decisions : BranchDecisions
        Of the tapes of motion and start.
    """

    field: PrimeField
    values: tuple[Residues, ...]
    decisions: BranchDecisions
    start_decisions: BranchDecisions

    @property
    def count(self) -> int:
        """Points."""
        return self.values[0].p.shape[1]

    @property
    def first(self) -> "DrawnPoint":
        """The first of several points."""
        values = tuple(Residues(each.p[:, :1], each.q[:, :1]) for each in self.values)
        return DrawnPoint(self.field, values, _first(self.decisions), _first(self.start_decisions))


def _first(decisions: BranchDecisions) -> BranchDecisions:
    choices, values = (
        {index: each[:, :1] for index, each in group.items()}
        for group in (decisions.choices, decisions.values)
    )
    return BranchDecisions(choices, values)


def draw_point(part: ReachedModel, generator: np.random.Generator) -> DrawnPoint:
    """A random point at which all functions have values; what the model's point gives is kept.

    Raises
    ------
    InputError
        Where none is found.
    """
    reason = "division by 0"
    for (prime, cofactor), batch in _attempts(part):
        field = PrimeField(int(generator.integers(2, 1 << 30)), prime, cofactor)
        if not _has_roots(part, field):
            reason = "a root or a logarithm has no exact value"
            continue
        try:
            return _try_batch(part, field, batch, generator).first
        except NotRegularError as error:
            reason = str(error)
    where = " with these values given" if part.model.point or part.model.known_initial_values else ""
    raise InputError(
        f"{part.model.name}: no point was found{where} at which all functions have exact values ({reason}); "
        "leave given values generic, or move them off a singularity"
    )


def _field(generator: np.random.Generator) -> PrimeField:
    return PrimeField(int(generator.integers(2, 1 << 30)))


def _attempts(part: ReachedModel) -> Iterator[tuple[tuple[int, int], int]]:
    """Primes with their cofactors, and batch sizes."""
    for batch in BATCHES:
        yield (PRIME, 4), batch
    needs_primes = bool(part.model.point or part.model.known_initial_values) or _constants_matter(part)
    if needs_primes:
        for prime in other_primes()[:MOST_PRIMES]:
            yield (prime, 4), BATCHES[1]
        for prime in primes_with_roots():
            yield (prime, COFACTOR), BATCHES[1]
        for prime in primes_with_roots()[:MOST_FIELDS]:
            yield (prime, COFACTOR), BATCHES[-1]


def _has_roots(part: ReachedModel, field: PrimeField) -> bool:
    """Whether no root or logarithm, of what is a number wherever the unknowns lie, fails in a field."""
    try:
        return all(pow(residue(each, field.prime), field.order, field.prime) == 1 for each in part.radicands)
    except NotRegularError:
        return False


def _constants_matter(part: ReachedModel) -> bool:
    """Whether a root or logarithm may be of a number of the formulas."""
    return bool(part.tape.operations & {"sqrt", "log", "arg"})


@cache
def other_primes() -> tuple[int, ...]:
    """Primes 4 q + 1 with q prime, the largest below 2^31. Of none of them 2, 3 or 4 has an exact root."""
    return _primes(4, 1 << 29, SIEVED)


@cache
def primes_with_roots() -> tuple[int, ...]:
    """Primes 24 q + 1 with q prime, first those of which more of the numbers 2, 3, 5 and 7 have an exact root."""
    found = _primes(COFACTOR, 1 << 26, SIEVED_FOR_ROOTS)
    counts = [sum(pow(number, (prime - 1) // COFACTOR, prime) == 1 for number in ROOTED) for prime in found]
    ranked = sorted(range(len(found)), key=lambda k: -counts[k])
    return tuple(found[k] for k in ranked[:MOST_PRIMES])


def _primes(cofactor: int, top: int, sieved: int) -> tuple[int, ...]:
    """Primes that are 1 more than the cofactor times a prime below a number, the largest first."""
    numbers = np.arange(top - sieved, top, dtype=np.int64)
    good = numbers % 2 == 1
    root = np.arange(3, 1 << 16, 2)
    small = root[[all(value % k for k in range(3, int(value**0.5) + 1, 2)) for value in root.tolist()]]
    for divisor in small.tolist():
        first = -(top - sieved) % divisor
        good[first::divisor] = False
        if cofactor % divisor:
            # cofactor q + 1 = 0 modulo the divisor
            also = (-pow(cofactor, -1, divisor) - (top - sieved)) % divisor
            good[also::divisor] = False
    return tuple(int(cofactor * q + 1) for q in numbers[good][::-1].tolist())


def fields_of(part: ReachedModel, random: np.random.Generator) -> Iterator[PrimeField]:
    """The usual field if the numbers of the formulas have their roots there, then `other_fields`."""
    usual = PrimeField()
    if _has_roots(part, usual):
        yield usual
    yield from other_fields(part, random)


def other_fields(part: ReachedModel, random: np.random.Generator) -> Iterator[PrimeField]:
    """Fields of other primes in which all functions have values at some random points."""
    primes = [(prime, 4) for prime in other_primes()[:MOST_FIELDS]]
    if _constants_matter(part):
        primes += [(prime, COFACTOR) for prime in primes_with_roots()[:MOST_FIELDS]]
    for prime, cofactor in primes:
        field = PrimeField(prime=prime, cofactor=cofactor)
        if not _has_roots(part, field):
            continue
        if _constants_matter(part):
            try:
                _try_batch(part, field, BATCHES[-1], random)
            except NotRegularError:
                continue
        yield field


def draw_points(
    part: ReachedModel, generator: np.random.Generator, field: PrimeField, count: int
) -> DrawnPoint:
    """At least so many random points of a field at once.

    Raises
    ------
    InputError
        Where they are not found.
    """
    batch = count
    while batch <= MOST_POINTS:
        try:
            found = _try_batch(part, field, batch, generator)
        except NotRegularError:
            batch *= 4
            continue
        if found.values[0].p.shape[1] >= count:
            return found
        batch *= 4
    raise InputError(f"{part.model.name}: too few points at which all functions have exact values")


def _try_batch(
    part: ReachedModel, field: PrimeField, batch: int, generator: np.random.Generator
) -> DrawnPoint:
    """The good points of a batch; NotRegularError where there is none."""
    piecewise = not PIECEWISE.isdisjoint(part.tape.operations)
    floats = [_floats(part, group, batch, generator) for group in part.groups] if piecewise else []
    given = [
        drawn_values(part, group, field, batch, generator, floats[k] if piecewise else None)
        for k, group in enumerate(part.groups)
    ]
    start = function_values(part.start, field, given, {}) if part.model.known_initial_values else None
    if start is not None:
        given[0] = start.output
    choices = float_choices(part.tape, _on_spheres(part, floats)) if piecewise else {}
    motion = function_values(part.tape, field, given, choices, output_needed=False)
    good = motion.regular if start is None else start.regular & motion.regular
    if not good.any():
        raise NotRegularError(motion.reason or (start.reason if start else ""))
    values = tuple(Residues(each.p[:, good], each.q[:, good]) for each in given)
    at_start = BranchDecisions({}, {}) if start is None else _decisions(start, {}, good)
    return DrawnPoint(field, values, _decisions(motion, choices, good), at_start)


def _decisions(found: FunctionValues, choices: Choices, good: Bool[np.ndarray, " b"]) -> BranchDecisions:
    values, kept = (
        {index: each[:, good] for index, each in group.items()} for group in (found.values, choices)
    )
    return BranchDecisions(kept, values)


def _floats(
    part: ReachedModel, names: Sequence[str], batch: int, generator: np.random.Generator
) -> Num[np.ndarray, "n b"]:
    """Thousandths between 0.5 and 2 that floats hold nearly, where branches are to be decided; unit vectors before projection."""
    drawn = generator.integers(THOUSANDTHS // 2, 2 * THOUSANDTHS, (len(names), batch)) / THOUSANDTHS
    for k, name in enumerate(names):
        if name in part.model.point:
            drawn[k] = float(part.model.point[name])
        elif name in part.model.known_initial_values:
            raise InputError(
                f"{part.model.name}: abs, min and max together with known initial values are not analysed; give a point instead"
            )
    return drawn


def _on_spheres(part: ReachedModel, floats: Sequence[Num[np.ndarray, "n b"]]) -> list[Num[np.ndarray, "n b"]]:
    """The same values with those of unit vectors projected as `unit_residues` does."""
    found = [each.copy() for each in floats]
    for names, values in zip(part.groups, found, strict=True):
        for where in part.drawn_unit_vectors(names):
            values[where] = projected(values[where[:-1]])
    return found


def projected(u: Num[np.ndarray, "n b"]) -> Num[np.ndarray, "m b"]:
    """Vectors of norm 1 by stereographic projection, in floats."""
    s = (u * u).sum(axis=0)
    return np.concatenate([2 * u, (1 - s)[np.newaxis]]) / (1 + s)


def drawn_values(
    part: ReachedModel,
    names: Sequence[str],
    field: PrimeField,
    batch: int,
    generator: np.random.Generator,
    floats: Num[np.ndarray, "n b"] | None,
) -> Residues:
    """Values of a group: fourth powers modulo p, so that roots of their products exist, anything modulo q."""
    shape = (len(names), batch)
    if not names:
        return Residues(np.zeros(shape, dtype=np.uint64), np.zeros(shape, dtype=np.uint64))
    p = powers(field.base, generator.integers(1, field.order, shape, dtype=np.uint64), field.prime)
    q = generator.integers(1, field.order, shape, dtype=np.uint64)
    for k, name in enumerate(names):
        if name in part.model.point:
            value = part.model.point[name]
            p[k], q[k] = residue(value, field.prime), residue(value, field.order)
        elif floats is not None:
            for j in range(batch):
                value = Fraction(round(THOUSANDTHS * floats[k, j]), THOUSANDTHS)
                p[k, j], q[k, j] = residue(value, field.prime), residue(value, field.order)
    for where in part.drawn_unit_vectors(names):
        p[where], q[where] = unit_residues(p[where], field.prime), unit_residues(q[where], field.order)
    return Residues(p, q)


def unit_residues(given: Num[np.ndarray, "n b"], modulus: int) -> Num[np.ndarray, "n b"]:
    """Vectors of norm 1 of all entries but the last, by stereographic projection (`exact_numbers.unit_vector`)."""
    m, u = np.uint64(modulus), given[:-1]
    s = (u * u % m).sum(axis=0) % m
    over = powers((s + np.uint64(1)) % m, modulus - 2, modulus)
    return np.concatenate([np.uint64(2) * u % m, ((np.uint64(1) + m - s) % m)[np.newaxis]]) * over % m


def exact_rank(part: ReachedModel, seed: int = 0) -> ExactRank:
    """Rank and null space of a model's outputs by its unknowns.

    At a generic point with generic inputs the first order that adds nothing is the last, also at a generic point of an invariant
    manifold: the rows of an order are the derivatives along the motion of those before. Elsewhere as many orders are taken as there
    are unknowns and states, and two more.
    """
    generator = np.random.default_rng(seed)
    names = part.unknowns
    if not names:
        return ExactRank(names, (0,), np.zeros((0, 0), dtype=np.uint64), True, _field(generator))
    point = draw_point(part, generator)
    if part.unknown_inputs:
        return _with_unknown_inputs(part, point, generator)
    most = len(names) + 2 if part.is_invariant else part.most_orders
    flow = flow_at(part, point, most, generator)
    return rank_by_orders(names, [flow], point.field, most, part.is_invariant)


def _with_unknown_inputs(part: ReachedModel, point: DrawnPoint, generator: np.random.Generator) -> ExactRank:
    """Derivatives of unknown inputs are unknown as well, and eliminated first."""
    names, field = part.unknowns, point.field
    most, taken, ranks = part.most_orders, [], []
    for orders, rows in enumerate(output_rows(part, point, most, generator), start=1):
        taken.append(rows[:, 0])
        if orders not in part.orders_with_unknown_inputs:
            continue
        last = reduced_without_jets(np.concatenate(taken), len(names), field)
        ranks.append(int(last.rank[0]))
        if ranks[-1] == len(names) or orders == most:
            space = null_vectors(last, len(names), field)
            return ExactRank(names, tuple(ranks), space, ranks[-1] == len(names), field)
    raise AssertionError


def reduced_without_jets(rows: Num[np.ndarray, "r m"], unknowns: int, field: PrimeField) -> Reduced:
    """Columns of the unknowns, which are the first, reduced after an elimination of all others."""
    jets = rows.shape[1] - unknowns
    ordered = np.concatenate([rows[:, unknowns:], rows[:, :unknowns]], axis=1)
    rest = reduce_columns(ordered[np.newaxis], jets, field).rest[0, :, jets:]
    return reduce_columns(rest[rest.any(axis=1)][np.newaxis], unknowns, field)


def output_rows(
    part: ReachedModel, point: DrawnPoint, orders: int, generator: np.random.Generator
) -> Iterator[Num[np.ndarray, "r b n"]]:
    """Gradients of the outputs' Taylor coefficients at every point, order by order, by unknowns, then jets of unknown inputs."""
    for found in output_coefficients(part, point, orders, generator):
        yield found[..., 1:]


def output_coefficients(
    part: ReachedModel, point: DrawnPoint, orders: int, generator: np.random.Generator
) -> Iterator[Num[np.ndarray, "r b n"]]:
    """The outputs' Taylor coefficients at every point, order by order, each value before its gradient.

    Raises
    ------
    InputError
        Where those of another order would take too long.
    """
    flow = flow_at(part, point, orders, generator)
    for _, found in motion_coefficients(flow, orders):
        yield found


def flow_at(part: ReachedModel, point: DrawnPoint, orders: int, generator: np.random.Generator) -> Flow:
    """The model's motion at every point, with tangents by unknowns and by jets of unknown inputs up to so many orders."""
    width = 1 + len(part.unknowns) + len(part.unknown_inputs) * (orders - 1)
    products = part.tape.size * width * point.count

    def others(order: int) -> Iterator[tuple[int, Num[np.ndarray, "n b m"]]]:
        if order * (order + 1) / 2 * products > LARGEST_WORK:
            raise InputError(
                f"{part.model.name}: derivatives of the outputs of order {order} and more by {len(part.unknowns)} unknowns take "
                "too long; measure more states, declare what is known among known_constants, or analyse a part of the system"
            )
        return _draw_coefficients(part, point, order, width, generator)

    return Flow(point.field, part.tape, point.decisions, start_values(part, point, width), others)


def start_values(part: ReachedModel, point: DrawnPoint, width: int) -> Num[np.ndarray, "n b m"]:
    """States at time 0 with their tangents by the unknowns."""
    if not part.model.known_initial_values:
        return with_tangents(part, part.states, point.values[0].p, width)
    series = Series(part.start, point.start_decisions, point.field, (1, point.count, width))
    for index, (group, values) in enumerate(zip(part.groups, point.values, strict=True)):
        series.put(index, 0, with_tangents(part, group, values.p, width))
    return series.advance(0)


def _draw_coefficients(
    part: ReachedModel, point: DrawnPoint, order: int, width: int, generator: np.random.Generator
) -> Iterator[tuple[int, Num[np.ndarray, "n b m"]]]:
    """Coefficients of constants, known inputs and unknown inputs of an order."""
    if order == 0:
        for index in (1, 2, 3):
            yield index, with_tangents(part, part.groups[index], point.values[index].p, width)
        return
    for index in (2, 3):
        count = len(part.groups[index])
        if not count:
            continue
        values = generator.integers(0, LARGEST_INPUT, (count, point.count), dtype=np.uint64)
        yield index, later_inputs(part, index, order, values, width)


def later_inputs(
    part: ReachedModel, index: int, order: int, p: Num[np.ndarray, "n b"], width: int
) -> Num[np.ndarray, "n b m"]:
    """Coefficients of an order from 1 on of the inputs of a group; each of an unknown input is an unknown of its own."""
    values = with_tangents(part, (), p, width)
    if index == 3:
        values[np.arange(len(p)), :, part.jet_columns(order)] = 1
    return values


def with_tangents(
    part: ReachedModel, names: Sequence[str], p: Num[np.ndarray, "n b"], width: int
) -> Num[np.ndarray, "n b m"]:
    """Values of these names with their derivatives by the unknowns: 1 by itself where a name is unknown."""
    values = np.zeros((*p.shape, width), dtype=p.dtype)
    values[..., 0] = p
    for k, name in enumerate(names):
        if name in part.unknowns:
            values[k, :, 1 + part.unknowns.index(name)] = 1
    return values
