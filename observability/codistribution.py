"""Gradients of the outputs' Taylor coefficients along a motion, order by order, with their exact rank and null space.

This is the one engine of ranks, of a body before its sensors as of any equations. Landmarks are many and meet only in the unknowns
that all outputs have in common. So every item's own unknowns are eliminated first, all items of a family at once, and what remains
has as many columns as there are common unknowns.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from jaxtyping import Bool, Num

from observability.exact_numbers import Arithmetic, PrimeField
from observability.function_values import BranchDecisions
from observability.power_series import Series
from observability.residue_matrices import Echelon, product_of, reduce_columns
from observability.tape import Tape
from spinfilters.core.errors import InputError

Coefficients = Iterable[tuple[int, Num[np.ndarray, "n b m"]]]
"""Coefficients of a tape's inputs, each with the input's number."""


@dataclass(frozen=True)
class OutputFamily:
    """Like outputs: one expression of the states for many items, each with numbers of its own, such as landmarks.

    Attributes
    ----------
    tape : Tape
        (states, numbers of an item) -> values.
    decisions : BranchDecisions
        Of the tape, at time 0.
    numbers : ndarray of shape (k, l)
        Of every item.
    unknown : int
        How many of the leading numbers of each item are unknowns.
    """

    tape: Tape
    decisions: BranchDecisions
    numbers: Num[np.ndarray, "k l"]
    unknown: int

    @property
    def count(self) -> int:
        """Items."""
        return self.numbers.shape[1]


@dataclass(frozen=True)
class Flow:
    """A motion with its outputs, as it starts.

    Attributes
    ----------
    arithmetic : Arithmetic
        Of all numbers.
    tape : Tape
        (states, others) -> rates of the states, then outputs that are computed with them.
    decisions : BranchDecisions
        Of the tape, at time 0.
    state : ndarray of shape (n, b, 1 + m)
        At time 0 at b points, with tangents by the common unknowns and all others but those of items.
    others : Callable
        From an order to the coefficients of the other inputs; what is not given is 0.
    families : tuple[OutputFamily, ...]
        Further outputs, at a single point.
    """

    arithmetic: Arithmetic
    tape: Tape
    decisions: BranchDecisions
    state: Num[np.ndarray, "n b m"]
    others: Callable[[int], Coefficients]
    families: tuple[OutputFamily, ...] = ()


def motion_coefficients(
    flow: Flow, orders: int
) -> Iterator[tuple[Num[np.ndarray, "n b m"], Num[np.ndarray, "o b m"]]]:
    """Taylor coefficients of the states and of the tape's outputs, order by order, each value before its tangents.

    The k-th coefficient of an output is its k-th Lie derivative over k!, and the tangents are that derivative's gradient.
    """
    (states, points, width), state = flow.state.shape, flow.state
    series = Series(flow.tape, flow.decisions, flow.arithmetic, (orders, points, width))
    for order in range(orders):
        series.put(0, order, state)
        for index, values in flow.others(order):
            series.put(index, order, values)
        found = series.advance(order)
        yield state, found[states:]
        state = flow.arithmetic.product(found[:states], flow.arithmetic.numbers([Fraction(1, order + 1)]))


@dataclass(frozen=True)
class GradientRows:
    """Gradients of the outputs' Taylor coefficients of one order.

    Attributes
    ----------
    common : ndarray of shape (r, b, m)
        Of the tape's outputs at b points.
    families : tuple[ndarray, ...]
        Of every family (items, values, own + common unknowns).
    """

    common: Num[np.ndarray, "r b m"]
    families: tuple[Num[np.ndarray, "_ _ _"], ...] = ()


def gradient_rows(flow: Flow, orders: int) -> Iterator[GradientRows]:
    """Rows of orders 0 to orders - 1."""
    series = [_family_series(flow, family, orders) for family in flow.families]
    for order, (state, found) in enumerate(motion_coefficients(flow, orders)):
        rows = tuple(
            _family_rows(each, family, order, state)
            for each, family in zip(series, flow.families, strict=True)
        )
        yield GradientRows(found[..., 1:], rows)


def _family_series(flow: Flow, family: OutputFamily, orders: int) -> Series:
    width = flow.state.shape[2] + family.unknown
    series = Series(family.tape, family.decisions, flow.arithmetic, (orders, family.count, width))
    numbers = np.zeros((*family.numbers.shape, width), dtype=flow.arithmetic.dtype)
    numbers[..., 0] = family.numbers
    own = np.arange(family.unknown)
    numbers[own, :, 1 + own] = 1
    series.put(1, 0, numbers)
    return series


def _family_rows(
    series: Series, family: OutputFamily, order: int, state: Num[np.ndarray, "n b m"]
) -> Num[np.ndarray, "l v c"]:
    """Columns: value, own unknowns, common ones."""
    size, _, width = state.shape
    moved = np.zeros((size, family.count, width + family.unknown), dtype=state.dtype)
    moved[..., 0] = state[..., 0]
    moved[..., 1 + family.unknown :] = state[..., 1:]
    series.put(0, order, moved)
    return series.advance(order)[..., 1:].transpose(1, 0, 2)


class Codistribution:
    """Rows of gradients, eliminated as they come.

    Parameters
    ----------
    common : int
        Unknowns that all outputs may depend on.
    families : Sequence[tuple[int, int]]
        Items, and unknowns of each, of every family.
    field : PrimeField
        Of the residues.
    """

    def __init__(self, common: int, families: Sequence[tuple[int, int]], field: PrimeField) -> None:
        self._field, self._common = field, Echelon(common, field)
        # The pivot row of each item's own unknowns in its place, 0 where there is none.
        self._own = [np.zeros((items, own, own + common), dtype=np.uint64) for items, own in families]

    @property
    def rank(self) -> int:
        """Independent rows so far."""
        return self._common.rank + sum(int(self._has_pivots(k).sum()) for k in range(len(self._own)))

    def add(self, rows: GradientRows) -> None:
        """Take in the rows of one order, at the first point."""
        rest = [rows.common[:, 0]]
        for k, given in enumerate(rows.families):
            rest.append(self._without_own(k, given))
        every = np.concatenate(rest)
        self._common.add(every[every.any(axis=1)])

    def _without_own(self, k: int, given: Num[np.ndarray, "l v c"]) -> Num[np.ndarray, "r m"]:
        """What an elimination of each item's own unknowns leaves of its rows."""
        items, own, width = self._own[k].shape
        if own:
            reduced = reduce_columns(np.concatenate([self._own[k], given], axis=1), own, self._field)
            pivots = np.maximum(reduced.pivots, 0)
            kept = reduced.rows[np.arange(items)[:, np.newaxis], pivots]
            self._own[k] = np.where((reduced.pivots >= 0)[..., np.newaxis], kept, np.uint64(0))
            given = reduced.rest
        return given[..., own:].reshape(-1, width - own)

    def _has_pivots(self, k: int) -> Bool[np.ndarray, "l o"]:
        """Whether there is a pivot for each of the items' own unknowns."""
        own = np.arange(self._own[k].shape[1])
        return self._own[k][:, own, own] != 0

    def null_space(self) -> Num[np.ndarray, "n d"]:
        """Directions that no row sees, in the columns: common unknowns, then each item's own ones."""
        base = self._common.null_space()
        missing = [int((~self._has_pivots(k)).sum()) for k in range(len(self._own))]
        total = base.shape[1] + sum(missing)
        parts, start = [_pad_columns(base, 0, total)], base.shape[1]
        for k, free in enumerate(missing):
            parts.append(self._own_part(k, base, start, total))
            start += free
        return np.concatenate(parts)

    def _own_part(
        self, k: int, base: Num[np.ndarray, "n d"], start: int, total: int
    ) -> Num[np.ndarray, "o t"]:
        """Own unknowns of a family's items: what makes up for the common ones, and what is free among themselves."""
        _, own, width = self._own[k].shape
        rows, held = self._own[k], self._has_pivots(k)
        answers = product_of(rows[..., own:].reshape(-1, width - own), base, self._field)
        part = _pad_columns(self._field.negative(answers), 0, total)
        for column, (item, place) in enumerate(zip(*np.nonzero(~held), strict=True), start):
            at = slice(item * own, (item + 1) * own)
            part[at, column] = self._field.negative(rows[item, :, place])
            part[item * own + place, column] = 1
        return part


def _pad_columns(matrix: Num[np.ndarray, "n d"], start: int, total: int) -> Num[np.ndarray, "n t"]:
    """Columns at a place among so many."""
    wide = np.zeros((len(matrix), total), dtype=np.uint64)
    wide[:, start : start + matrix.shape[1]] = matrix
    return wide


@dataclass(frozen=True)
class ExactRank:
    """Rank of all orders that were taken.

    Attributes
    ----------
    names : tuple[str, ...]
        Unknowns that outputs depend on.
    ranks : tuple[int, ...]
        With orders 0, 0 to 1, and so on.
    null_space : ndarray of shape (n, d)
        Residues, one vector in each column.
    complete : bool
        Whether no higher order can add to it.
    field : PrimeField
        Of the residues.
    """

    names: tuple[str, ...]
    ranks: tuple[int, ...]
    null_space: Num[np.ndarray, "n d"]
    complete: bool
    field: PrimeField

    @property
    def rank(self) -> int:
        """Of all orders."""
        return len(self.names) - self.null_space.shape[1]

    @property
    def order(self) -> int:
        """The first with the last rank."""
        return self.ranks.index(self.ranks[-1]) if self.ranks else 0


def rank_by_orders(
    names: Sequence[str], experiments: Sequence[Flow], field: PrimeField, orders: int, stops: bool
) -> ExactRank:
    """Rank of the outputs of all experiments together, whose unknowns are the same.

    Parameters
    ----------
    names : Sequence[str]
        Common unknowns, then those of each family's items.
    experiments : Sequence[Flow]
        At a single point each, of the same families.
    orders : int
        Taken at most.
    stops : bool
        Whether the first order that adds nothing is the last, as at a generic point with generic inputs.
    """
    if orders < 1:
        raise InputError(f"{orders} orders leave no rows; take at least 1")
    sizes = [(each.count, each.unknown) for each in experiments[0].families]
    common = len(names) - sum(items * own for items, own in sizes)
    rows, ranks = Codistribution(common, sizes, field), []
    for together in zip(*[gradient_rows(each, orders) for each in experiments], strict=True):
        for each in together:
            rows.add(each)
        ranks.append(rows.rank)
        full = rows.rank == len(names)
        if full or (stops and len(ranks) > 1 and ranks[-1] == ranks[-2]):
            return ExactRank(tuple(names), tuple(ranks), rows.null_space(), True, field)
    return ExactRank(tuple(names), tuple(ranks), rows.null_space(), False, field)
