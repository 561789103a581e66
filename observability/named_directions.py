"""Named directions of a model: what no output depends on, generators, and those that hold at a special point."""

from collections.abc import Iterable
from dataclasses import replace
from fractions import Fraction

import numpy as np
from jaxtyping import Num

from observability.exact_numbers import PrimeField, residue
from observability.generators import Generator, Term, generators
from observability.invariant_manifold import restricted, staying
from observability.model import Model
from observability.model_rank import exact_rank, reached
from observability.residue_matrices import Echelon


def named_directions(model: Model) -> list[Generator]:
    """Independent generators of a model at its point.

    At a special point these are the generic ones, and those of the manifold of states that stay at their values there. With known
    initial values of states that leave them, only what no output depends on.
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
        return free
    found = exact_rank(part)
    moved = [name for name, row in zip(found.names, found.null_space, strict=True) if row.any()]
    return free + generators(part, moved, found.null_space.shape[1])


def _independent(model: Model, found: Iterable[Generator]) -> list[Generator]:
    """Those of the fields that are independent of the ones before at the model's point."""
    field, random = PrimeField(), np.random.default_rng(3)
    symbols = (*model.states, *model.parameters, *model.known_constants)
    values = {
        name: residue(model.point[name], field.prime)
        if name in model.point
        else int(random.integers(1, field.prime))
        for name in symbols
    }
    rows, kept = Echelon(len(model.unknowns), field), []
    for each in found:
        before = rows.rank
        rows.add(_direction(each, model, values, field)[np.newaxis])
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
