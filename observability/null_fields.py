"""Null vectors of a model at any points of a prime field, many at once, normalised at some unknowns."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from time import monotonic

import numpy as np
from jaxtyping import Bool, Num

from observability.exact_numbers import PrimeField
from observability.function_values import BranchDecisions, Residues, function_values
from observability.model_rank import DrawnPoint, ReachedModel, output_rows
from observability.monomials import Values
from observability.power_series import Series
from observability.residue_matrices import null_vectors, reduce_columns
from observability.tape import PIECEWISE, TRANSCENDENTAL

BATCH_NUMBERS = 4_000_000
"""Numbers of a batch's registers."""


class NotRationalError(ArithmeticError):
    """A field that is not found as a rational one: degrees, coefficients or time do not suffice."""


@dataclass
class NullFields:
    """Null vectors of a model at any points of a prime field.

    Attributes
    ----------
    part : ReachedModel
        Without functions other than roots of 1, and without unknown inputs.
    orders : int
        Orders of derivatives that reach the rank.
    dimension : int
        Of the null space.
    """

    part: ReachedModel
    orders: int
    dimension: int
    field: PrimeField
    random: np.random.Generator
    seconds: float
    names: tuple[str, ...] = dataclass_field(init=False)

    def __post_init__(self) -> None:
        self.names = (*self.part.states, *self.part.constants, *self.part.inputs)
        self._until = monotonic() + self.seconds

    def draw(self, count: int) -> dict[str, Num[np.ndarray, " b"]]:
        """Random points."""
        return self.field.draw(self.names, count, self.random)

    def at(self, values: Values) -> Num[np.ndarray, "b d n"]:
        """Bases of the null spaces, a row each; 0 where the point is singular or special.

        Raises
        ------
        NotRationalError
            When the time is over.
        """
        part, count = self.part, len(next(iter(values.values())))
        found = np.zeros((count, self.dimension, len(part.unknowns)), dtype=np.uint64)
        step = max(1, BATCH_NUMBERS // (self.orders * part.tape.size * (1 + len(part.unknowns))))
        for first in range(0, count, step):
            if monotonic() > self._until:
                raise NotRationalError
            chunk = {name: each[first : first + step] for name, each in values.items()}
            found[first : first + step] = self._chunk(chunk)
        return found

    def _chunk(self, values: Values) -> Num[np.ndarray, "b d n"]:
        part, field, count = self.part, self.field, len(next(iter(values.values())))
        result = np.zeros((count, self.dimension, len(part.unknowns)), dtype=np.uint64)
        point, good = point_at(part, values, field)
        if not good.any():
            return result
        rows = np.concatenate(list(output_rows(part, point, self.orders, self.random))).transpose(1, 0, 2)
        reduced = reduce_columns(rows, len(part.unknowns), field)
        full = reduced.rank == len(part.unknowns) - self.dimension
        spaces = np.zeros((len(rows), self.dimension, len(part.unknowns)), dtype=np.uint64)
        for item in np.flatnonzero(full).tolist():
            spaces[item] = null_vectors(reduced, len(part.unknowns), field, item).T
        result[good] = spaces
        return result

    def normalised(
        self, spaces: Num[np.ndarray, "b d n"], free: Sequence[int]
    ) -> tuple[Num[np.ndarray, "b d n"], Bool[np.ndarray, " b"]]:
        """Bases that are 1 and 0 at the free unknowns, and where they exist."""
        others = [k for k in range(spaces.shape[2]) if k not in set(free)]
        ordered = [*free, *others]
        reduced = reduce_columns(spaces[:, :, ordered], len(free), self.field)
        good = reduced.rank == self.dimension
        result = np.zeros_like(spaces)
        items = np.flatnonzero(good)
        rows = reduced.rows[items[:, np.newaxis], reduced.pivots[items]]
        # Columns back in the order of the unknowns.
        result[items] = rows[:, :, np.argsort(ordered)]
        return result, good

    def rates(self, values: Values) -> Num[np.ndarray, "r b m"]:
        """Rates of all states, value first, then their gradient by the unknowns."""
        part = self.part
        count, width = len(next(iter(values.values()))), 1 + len(part.unknowns)
        series = Series(part.tape, BranchDecisions({}, {}), self.field, (1, count, width))
        for index, group in enumerate(part.groups):
            given = np.zeros((len(group), count, width), dtype=np.uint64)
            for k, name in enumerate(group):
                given[k, :, 0] = values[name]
                if name in part.unknowns:
                    given[k, :, 1 + part.unknowns.index(name)] = 1
            series.put(index, 0, given)
        return series.advance(0)[: len(part.states)]


def point_at(
    part: ReachedModel, values: Values, field: PrimeField
) -> tuple[DrawnPoint, Bool[np.ndarray, " b"]]:
    """Given values of all symbols as points of a model without functions other than roots of 1, and which of them are regular."""
    count = len(next(iter(values.values())))
    groups = []
    for names in part.groups:
        rows = np.array([values[name] for name in names], dtype=np.uint64).reshape(len(names), count)
        groups.append(Residues(rows, np.ones_like(rows)))
    good = function_values(part.tape, field, groups, {}).regular
    kept = tuple(Residues(each.p[:, good], each.q[:, good]) for each in groups)
    nothing = BranchDecisions({}, {})
    return DrawnPoint(field, kept, nothing, nothing), good


def is_rational(part: ReachedModel) -> bool:
    """Whether null vectors of a model can be computed at any point."""
    foreign = (TRANSCENDENTAL | PIECEWISE | {"sqrt"}) & set(part.tape.operations)
    return not foreign and part.model.is_generic
