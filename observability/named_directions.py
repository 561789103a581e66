"""Named directions of a model: what no output depends on, generators, and those that hold at a special point."""

from collections.abc import Iterable
from dataclasses import replace
from fractions import Fraction

import numpy as np
from jaxtyping import Num

from observability.exact_numbers import PrimeField, residue
from observability.generators import Generator, Term, combined, generators
from observability.invariant_manifold import restricted, staying
from observability.model import Model
from observability.model_rank import draw_points, exact_rank, reached, start_values
from observability.residue_matrices import Echelon

SPARE = 4
"""Points beyond the number of fields."""


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
        return free + _kept_at_start(model, generic_directions(replace(model, known_initial_values={})))
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
        moves = [_component(each, state, values, field) for each in found]
        if state in part.states:
            for k, name in enumerate(part.unknowns):
                slope = field.negative(start[part.states.index(state), :, 1 + k])
                moves = [
                    field.reduced(move + field.product(slope, _component(each, name, values, field)))
                    for move, each in zip(moves, found, strict=True)
                ]
        rows.add(np.stack(moves, axis=1))
    sums = [combined(found, weights, field.prime) for weights in rows.null_space().T]
    names = set(model.known_initial_values)
    # What moves nothing but states that are known at time 0 is no direction of the unknowns.
    kept = [each for each in sums if each is not None and not names.issuperset(each.components)]
    return _independent(replace(model, known_initial_values={}), kept, model.unknowns)


def _component(
    generator: Generator, name: str, values: dict[str, Num[np.ndarray, " b"]], field: PrimeField
) -> Num[np.ndarray, " b"]:
    """A field's component at points."""
    total = np.zeros_like(next(iter(values.values())))
    for term, coefficient in generator.terms.items():
        if term.moved == name:
            size = np.full_like(total, residue(coefficient, field.prime))
            for factor in term.factors:
                size = field.product(size, values[factor])
            total = field.reduced(total + size)
    return total


def _independent(
    model: Model, found: Iterable[Generator], unknowns: tuple[str, ...] | None = None
) -> list[Generator]:
    """Fields that are independent of the ones before at the model's point, in some unknowns."""
    field, random = PrimeField(), np.random.default_rng(3)
    symbols = (*model.states, *model.parameters, *model.known_constants)
    values = {
        name: residue(model.point[name], field.prime)
        if name in model.point
        else int(random.integers(1, field.prime))
        for name in symbols
    }
    counted = model.unknowns if unknowns is None else unknowns
    chosen = [model.unknowns.index(name) for name in counted]
    rows, kept = Echelon(len(chosen), field), []
    for each in found:
        before = rows.rank
        rows.add(_direction(each, model, values, field)[np.newaxis][:, chosen])
        if rows.rank > before:
            kept.append(each)
    return kept


def _direction(
    generator: Generator, model: Model, values: dict[str, int], field: PrimeField
) -> Num[np.ndarray, " n"]:
    """A field's value at a point."""
    vector = dict.fromkeys(model.unknowns, 0)
    for term, coefficient in generator.terms.items():
        size = residue(coefficient, field.prime)
        for name in term.factors:
            size = size * values[name] % field.prime
        vector[term.moved] = (vector[term.moved] + size) % field.prime
    return np.array(list(vector.values()), dtype=np.uint64)
