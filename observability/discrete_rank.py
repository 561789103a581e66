"""Exact rank of a model in discrete time, x[k+1] = f, y[k] = h: gradients of the outputs carried from step to step."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from jaxtyping import Num

from observability.codistribution import ExactRank
from observability.exact_numbers import PrimeField
from observability.function_values import BranchDecisions, Residues, function_values
from observability.model_rank import (
    DrawnPoint,
    ReachedModel,
    draw_point,
    drawn_values,
    exact_rank,
    later_inputs,
    reduced_without_jets,
    start_values,
    with_tangents,
)
from observability.power_series import Series
from observability.residue_matrices import Echelon, null_vectors, rank_of
from observability.tape import PIECEWISE
from spinfilters.core.errors import InputError

ATTEMPTS: Final = 200
"""Points tried until all functions have exact values at every step."""
LONGEST_PERIOD: Final = 1000
"""Steps after which outputs of several rates meet again."""


def outputs_rank(part: ReachedModel, seed: int = 0) -> ExactRank:
    """Rank and null space of a model's outputs by its unknowns, in continuous or in discrete time."""
    return discrete_rank(part, seed) if part.model.discrete else exact_rank(part, seed)


def discrete_rank(part: ReachedModel, seed: int = 0) -> ExactRank:
    """Rank of the outputs of all steps by the unknowns at the first.

    At a generic point of an invertible step with known inputs, the first period that adds nothing is the last: its gradients are
    combinations of earlier ones, and so are then those a period later. A period is one step, or that after which outputs of
    several rates meet again.

    Raises
    ------
    InputError
        For branches, for rates that do not meet, and where functions have no exact values.
    """
    model, names = part.model, part.unknowns
    if not PIECEWISE.isdisjoint(part.tape.operations):
        raise InputError(
            f"{model.name}: abs, min and max in discrete time are not analysed; write the branch that holds"
        )
    period = model.period
    if period > LONGEST_PERIOD:
        raise InputError(
            f"{model.name}: the outputs' rates meet again after {period} steps only; choose rates that meet within {LONGEST_PERIOD}"
        )
    generator = np.random.default_rng(seed)
    if not names:
        return ExactRank(names, (0,), np.zeros((0, 0), dtype=np.uint64), True, PrimeField())
    for _ in range(ATTEMPTS):
        point = draw_point(part, generator)
        try:
            return _rank_at(part, point, period, generator)
        except _NoExactValueError:
            continue
    raise InputError(
        f"{model.name}: no point was found at which all functions have exact values at every step; "
        "write roots, logarithms and powers of states as states or parameters of their own"
    )


class _NoExactValueError(Exception):
    """Of a function at some step."""


def _rank_at(part: ReachedModel, point: DrawnPoint, period: int, generator: np.random.Generator) -> ExactRank:
    names, unknown, field = part.unknowns, len(part.unknown_inputs), point.field
    periods = part.most_orders
    width = 1 + len(names) + unknown * (periods * period - 1)
    generic = not (part.model.point or part.model.known_initial_values or unknown)
    rows, ranks, taken, regular = Echelon(len(names), field), [], [], False
    for step, (slope, gradients) in enumerate(_steps(part, point, periods * period, width, generator)):
        if step == 0:
            regular = generic and rank_of(slope, field) == len(part.states)
        measured = part.model.measured_at(step)
        if unknown:
            taken.append(gradients[measured])
            continue
        rows.add(gradients[measured])
        if (step + 1) % period:
            continue
        ranks.append(rows.rank)
        done = regular and len(ranks) > 1 and ranks[-1] == ranks[-2]
        if done or rows.rank == len(names):
            return ExactRank(names, tuple(ranks), rows.null_space(), True, field)
    if not unknown:
        return ExactRank(names, tuple(ranks), rows.null_space(), False, field)
    last = reduced_without_jets(np.concatenate(taken), len(names), field)
    rank = int(last.rank[0])
    return ExactRank(names, (rank,), null_vectors(last, len(names), field), rank == len(names), field)


def _steps(
    part: ReachedModel, point: DrawnPoint, count: int, width: int, generator: np.random.Generator
) -> Iterator[tuple[Num[np.ndarray, "n n"], Num[np.ndarray, "o m"]]]:
    """Gradients of the next states by the states at the first step (of use at this step), and of the outputs, step by step."""
    field, states = point.field, len(part.states)
    state, values = start_values(part, point, width), list(point.values)
    for step in range(count):
        if step:
            drawn = [drawn_values(part, part.groups[index], field, 1, generator, None) for index in (2, 3)]
            values[2:] = drawn
        found = function_values(part.tape, field, values, {})
        if not found.regular.all():
            raise _NoExactValueError
        series = Series(part.tape, BranchDecisions({}, found.values), field, (1, 1, width))
        series.put(0, 0, state)
        series.put(1, 0, with_tangents(part, part.groups[1], values[1].p, width))
        for index in (2, 3):
            p, names = values[index].p, part.groups[index]
            given = (
                later_inputs(part, index, step, p, width) if step else with_tangents(part, names, p, width)
            )
            series.put(index, 0, given)
        moved = series.advance(0)
        columns = [1 + part.unknowns.index(name) for name in part.states if name in part.unknowns]
        yield moved[:states, 0][:, columns], moved[states:, 0, 1:]
        state = moved[:states]
        values[0] = Residues(found.output.p[:states], found.output.q[:states])
