"""Matrices of residues: elimination, rank, null space and product."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int, Num

from observability.exact_numbers import PrimeField

FIELD = PrimeField()


@dataclass(frozen=True)
class Reduced:
    """A batch of matrices of residues brought to reduced echelon form in their first ``columns`` columns.

    Attributes
    ----------
    rows : ndarray of shape (b, r, c)
        The matrices after elimination.
    pivots : ndarray of shape (b, p)
        (b, columns) the row that holds each column's pivot, scaled to 1, or -1.
    """

    rows: Num[np.ndarray, "b r c"]
    pivots: Int[np.ndarray, "b p"]

    @property
    def rank(self) -> Int[np.ndarray, " b"]:
        """Pivots of each matrix."""
        return (self.pivots >= 0).sum(axis=1)

    @property
    def rest(self) -> Num[np.ndarray, "b r c"]:
        """The rows without a pivot; those with one are set to 0."""
        rest = self.rows.copy()
        item, column = np.nonzero(self.pivots >= 0)
        rest[item, self.pivots[item, column]] = 0
        return rest


def reduce_columns(matrices: Num[np.ndarray, "b r c"], columns: int, field: PrimeField = FIELD) -> Reduced:
    """Gauss-Jordan elimination of the first columns, for every matrix of the batch at once."""
    rows, batch = matrices.copy(), np.arange(len(matrices))
    free: Bool[np.ndarray, "b r"] = np.ones(rows.shape[:2], dtype=bool)
    pivots = np.full((len(rows), columns), -1)
    for column in range(columns):
        candidates = (rows[:, :, column] != 0) & free
        pivot, found = candidates.argmax(axis=1), candidates.any(axis=1)
        if not found.any():
            continue
        at, item = pivot[found], batch[found]
        inverse = field.inverse(rows[item, at, column])
        scaled = field.product(rows[item, at], inverse[:, np.newaxis])
        factors = rows[item, :, column]
        factors[np.arange(len(item)), at] = 0
        taken = field.product(factors[:, :, np.newaxis], scaled[:, np.newaxis])
        rows[item] = field.difference(rows[item], taken)
        rows[item, at] = scaled
        free[item, at] = False
        pivots[item, column] = at
    return Reduced(rows, pivots)


def null_vectors(
    reduced: Reduced, columns: int, field: PrimeField = FIELD, item: int = 0
) -> Num[np.ndarray, "c d"]:
    """Basis of the null space of one matrix, by default the first: one vector for each column without a pivot."""
    pivots = reduced.pivots[item]
    bound = np.flatnonzero(pivots >= 0)
    return _solve_for_free(reduced.rows[item][pivots[bound]], bound, columns, field)


def _solve_for_free(
    rows: Num[np.ndarray, "r c"],
    bound: Sequence[int] | Int[np.ndarray, " r"],
    columns: int,
    field: PrimeField,
) -> Num[np.ndarray, "c d"]:
    """Null vectors of reduced rows with pivots in the ``bound`` columns: 1 at one of the free columns each, 0 at the others."""
    free = np.setdiff1d(np.arange(columns), bound)
    space = np.zeros((columns, len(free)), dtype=np.uint64)
    space[free, np.arange(len(free))] = 1
    space[bound] = field.negative(rows[:, free])
    return space


def rank_of(matrix: Num[np.ndarray, "r c"], field: PrimeField = FIELD) -> int:
    """Rank of a matrix of residues."""
    if matrix.size == 0:
        return 0
    return int(reduce_columns(matrix[np.newaxis], matrix.shape[1], field).rank[0])


def in_span(
    basis: Num[np.ndarray, "n d"], vectors: Num[np.ndarray, "n k"], field: PrimeField = FIELD
) -> Bool[np.ndarray, " k"]:
    """Whether each vector is a combination of the basis: elimination of the basis then leaves nothing of it."""
    count = basis.shape[1]
    rest = reduce_columns(np.concatenate([basis, vectors], axis=1)[np.newaxis], count, field).rest[0]
    return ~rest[:, count:].any(axis=0)


def product_of(
    a: Num[np.ndarray, "i j"], b: Num[np.ndarray, "j k"], field: PrimeField = FIELD
) -> Num[np.ndarray, "i k"]:
    """Matrix product of residues.

    Through halves of 16 bits so that sums of 2^15 products stay below 2^63.
    """
    low, high = a & np.uint64(0xFFFF), a >> np.uint64(16)
    upper = field.reduced(field.reduced(high @ b) * np.uint64(1 << 16))
    return (upper + field.reduced(low @ b)) % np.uint64(field.prime)


class Echelon:
    """Rows in reduced echelon form, to which others are added little by little.

    Parameters
    ----------
    columns : int
        Of every row.
    field : PrimeField
        Of the residues.
    """

    def __init__(self, columns: int, field: PrimeField = FIELD) -> None:
        self._field, self._columns = field, columns
        self.rows: Num[np.ndarray, "r c"] = np.zeros((0, columns), dtype=np.uint64)
        self.pivots: list[int] = []

    @property
    def rank(self) -> int:
        """Independent rows so far."""
        return len(self.pivots)

    def add(self, rows: Num[np.ndarray, "k c"]) -> None:
        """Reduce rows by those known, then take in what is independent of them."""
        field = self._field
        if self.pivots:
            taken = product_of(rows[:, self.pivots], self.rows, field)
            rows = field.difference(rows, taken)
        every = np.concatenate([self.rows, rows])  # known rows, then the new ones
        while (below := every[len(self.rows) :]).any():
            row = below[below.any(axis=1).argmax()]
            pivot = int((row != 0).argmax())
            row = field.product(row, field.inverse(row[pivot : pivot + 1]))
            every = field.difference(every, field.product(every[:, pivot : pivot + 1], row))
            every = np.concatenate([every[: len(self.rows)], row[np.newaxis], every[len(self.rows) :]])
            self.rows = every[: len(self.rows) + 1]
            self.pivots.append(pivot)

    def null_space(self) -> Num[np.ndarray, "c d"]:
        """Basis of the directions that no row sees: one vector for each column without a pivot."""
        return _solve_for_free(self.rows, self.pivots, self._columns, self._field)
