"""Null vectors of a model in rational numbers, and as formulas.

At a point of small integers the null space is found modulo several primes, put together by the Chinese remainder theorem, lifted to
fractions, and tried modulo one prime more. As formulas it is spanned by the generators; where directions lack one, by vectors whose
components are interpolated as rational functions of the unknowns.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import chain, islice

import casadi as ca
import numpy as np
from jaxtyping import Num

from observability.codistribution import ExactRank
from observability.exact_numbers import NotRegularError, PrimeField, residue, unit_vector
from observability.generators import INTERPOLATION_SECONDS, Generator, as_generator
from observability.generators import MOST_PRIMES as GENERATOR_PRIMES
from observability.invariant_manifold import at_values
from observability.model import Model
from observability.model_rank import ReachedModel, other_primes, output_rows
from observability.monomials import Polynomial
from observability.null_fields import NullFields, is_rational, point_at
from observability.rational_generators import Modulo, fractions_that_hold, rational_fields
from observability.residue_matrices import Echelon
from observability.tape import PIECEWISE, TRANSCENDENTAL
from observability.written_formulas import written
from spinfilters.core.errors import InputError

MOST_PRIMES = 12
"""That residues are put together of."""
TRIES = 8
"""Points, until one is regular and has the rank of a generic one."""
LARGEST_INTEGER = 30
"""Of a point's coordinates."""


@dataclass(frozen=True)
class RationalNullSpace:
    """Null vectors at a point.

    Attributes
    ----------
    point : dict[str, Fraction]
        Values of all symbols.
    vectors : tuple[dict[str, Fraction], ...]
        Components that are not 0, by unknown: to first order no output notices these changes.
    primes : int
        Primes that the vectors were lifted from; one more confirms them.
    """

    point: dict[str, Fraction]
    vectors: tuple[dict[str, Fraction], ...]
    primes: int

    def document(self) -> dict[str, object]:
        """The vectors for JSON, fractions as text."""
        vectors = [{name: str(value) for name, value in each.items()} for each in self.vectors]
        return {"point": {name: str(value) for name, value in self.point.items()}, "vectors": vectors}

    def __str__(self) -> str:
        where = ", ".join(f"{name} = {value}" for name, value in self.point.items())
        lines = [
            ", ".join(f"{name} {_signed(value)}" for name, value in each.items()) for each in self.vectors
        ]
        return "\n".join([f"At {where}:" if where else "Anywhere:", *[f"  {line}" for line in lines]])


def _signed(value: Fraction) -> str:
    return f"+{value}" if value > 0 else str(value)


def rational_null_space(part: ReachedModel, exact: ExactRank, seed: int = 0) -> RationalNullSpace | None:
    """The null space at a point of small integers; None with functions that have no rational values there.

    Parameters
    ----------
    part : ReachedModel
        The model; values of its point are kept, all others drawn.
    exact : ExactRank
        Its rank, which the point has to have.
    """
    free: tuple[dict[str, Fraction], ...] = tuple(
        {name: Fraction(1)} for name in part.model.unknowns if name not in part.unknowns
    )
    if not part.unknowns:
        return RationalNullSpace({}, free, 0)
    foreign = TRANSCENDENTAL | PIECEWISE | {"sqrt"}
    if foreign & (part.tape.operations | part.start.operations):
        return None
    random, primes = np.random.default_rng(seed), other_primes()[: MOST_PRIMES + 1]
    for _ in range(TRIES):
        point = _integers(part, random)
        try:
            found = _lift_fractions(part, exact, point, primes)
        except (NotRegularError, InputError):
            continue
        if found is not None:
            return replace(found, vectors=free + found.vectors)
    return None


def _integers(part: ReachedModel, random: np.random.Generator) -> dict[str, Fraction]:
    names = [name for group in part.groups for name in group]
    drawn = random.choice(np.arange(2, 2 + max(LARGEST_INTEGER, len(names))), len(names), replace=False)
    found = {name: Fraction(int(value)) for name, value in zip(names, drawn, strict=True)}
    for group in part.model.unit_vectors:
        found |= dict(zip(group, unit_vector([found[each] for each in group[:-1]]), strict=True))
    return found | {name: part.model.point[name] for name in names if name in part.model.point}


def _lift_fractions(
    part: ReachedModel, exact: ExactRank, point: dict[str, Fraction], primes: Sequence[int]
) -> RationalNullSpace | None:
    """Fractions that hold modulo a prime that they were not lifted from."""
    directions, used = exact.null_space.shape[1], 0
    confirming = _null_space(part, point, PrimeField(prime=primes[-1]))
    if confirming.shape[1] != directions:
        return None

    def spaces() -> Iterator[Modulo[Sequence[int]]]:
        nonlocal used
        for prime in primes[:-1]:
            used += 1
            space = _null_space(part, point, PrimeField(prime=prime))
            if space.shape != confirming.shape:
                return
            yield Modulo(prime, [int(value) for value in space.ravel()])

    expected = [int(value) for value in confirming.ravel()]
    found = fractions_that_hold(
        spaces(), lambda values: [residue(value, primes[-1]) for value in values] == expected
    )
    if found is None:
        return None
    table = np.array(found, dtype=object).reshape(confirming.shape)
    vectors = tuple(
        {name: value for name, value in zip(part.unknowns, column, strict=True) if value}
        for column in table.T
    )
    return RationalNullSpace(point, vectors, used)


def _null_space(part: ReachedModel, point: dict[str, Fraction], field: PrimeField) -> Num[np.ndarray, "n d"]:
    """At a point, modulo a prime; derivatives of inputs are the same integers modulo each."""
    values = {name: field.numbers([value]) for name, value in point.items()}
    drawn, good = point_at(part, values, field)
    if not good.all():
        raise NotRegularError("the point")
    names = part.unknowns
    orders = len(names) + 2 + (0 if part.is_invariant else len(part.states))
    rows = np.concatenate(list(output_rows(part, drawn, orders, np.random.default_rng(5))))[:, 0]
    jets = rows.shape[1] - len(names)
    echelon = Echelon(rows.shape[1], field)
    # Derivatives of unknown inputs come first, so that rows with a pivot among the unknowns hold none of them.
    echelon.add(np.concatenate([rows[:, len(names) :], rows[:, : len(names)]], axis=1))
    own = Echelon(len(names), field)
    own.add(
        np.array(
            [row[jets:] for row, pivot in zip(echelon.rows, echelon.pivots, strict=True) if pivot >= jets],
            dtype=np.uint64,
        ).reshape(-1, len(names))
    )
    return own.null_space()


def symbolic_null_vectors(
    model: Model, exact: ExactRank, generators: Sequence[Generator], part: ReachedModel
) -> list[dict[str, str]]:
    """Null vectors as formulas, by unknown; fewer than directions where some are not rational functions of low degree.

    Each is scaled so that its last component that is a product is 1.
    """
    fields = list(generators)
    missing = exact.null_space.shape[1] + len(model.unknowns) - len(part.unknowns) - len(fields)
    if missing > 0 and is_rational(part) and exact.null_space.shape[1]:
        random = np.random.default_rng(12)
        directions = exact.null_space.shape[1]
        first, checked, *others = (
            PrimeField(),
            *[PrimeField(prime=each) for each in other_primes()[:GENERATOR_PRIMES]],
        )

        def spaces(field: PrimeField) -> NullFields:
            return NullFields(part, exact.order + 1, directions, field, random, INTERPOLATION_SECONDS)

        def started(field: PrimeField) -> Iterator[dict[str, Polynomial]]:
            fields = spaces(field)
            return rational_fields(fields, frozenset(fields.names), ())

        confirming = spaces(checked)
        values = confirming.draw(1)
        basis = confirming.at(values)[0]

        def holds(generator: Generator) -> bool:
            rows = Echelon(basis.shape[1], checked)
            rows.add(basis)
            rows.add(generator.vectors(part.unknowns, values, checked))
            return rows.rank == directions

        found = [
            as_generator(
                chain(
                    [Modulo(first.prime, each)],
                    (Modulo(other.prime, next(islice(started(other), index, None), {})) for other in others),
                ),
                holds,
            )
            for index, each in enumerate(started(first))
        ]
        unreached = [each for each in fields if not set(each.components) <= set(part.unknowns)]
        fields = [*unreached, *[each for each in found if each is not None]]
    return [_normalised(each, model) for each in fields]


def _normalised(generator: Generator, model: Model) -> dict[str, str]:
    """The components over the last of them that is a single product."""
    expressions: dict[str, ca.SX] = {}
    count: dict[str, int] = {}
    for term, value in generator.terms.items():
        product = ca.SX(value.numerator) / value.denominator
        for name in term.factors:
            product *= model.symbols[name]
        expressions[term.moved] = expressions.get(term.moved, ca.SX(0)) + product
        count[term.moved] = count.get(term.moved, 0) + 1
    ordered = [name for name in model.unknowns if name in expressions]
    single = [name for name in ordered if count[name] == 1]
    divisor = expressions[single[-1]] if single else ca.SX(1)
    found = {name: written(at_values(expressions[name] / divisor, model, model.point)) for name in ordered}
    return {name: text for name, text in found.items() if text != "0"}
