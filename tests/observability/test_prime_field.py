"""Residues compute what fractions compute, and elimination finds the rank and the null space of fractions."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observability.codistribution import Codistribution, GradientRows
from observability.exact_numbers import ORDER, PRIME, NotRegularError, PrimeField, residue
from observability.residue_matrices import product_of, rank_of, reduce_columns

FIELD = PrimeField()
FRACTIONS = st.fractions(min_value=-1000, max_value=1000, max_denominator=10**6)


def of(*values: Fraction) -> np.ndarray:
    """Residues of fractions."""
    return FIELD.numbers(values)


@given(a=FRACTIONS, b=FRACTIONS)
def test_sum_product_and_quotient_of_residues_are_those_of_fractions(a: Fraction, b: Fraction) -> None:
    assert FIELD.reduced(of(a) + of(b)) == of(a + b)
    assert FIELD.reduced(of(a) + FIELD.negative(of(b))) == of(a - b)
    assert FIELD.product(of(a), of(b)) == of(a * b)
    if b:
        assert FIELD.product(of(a), FIELD.inverse(of(b))) == of(a / b)


def test_prime_and_order_are_prime() -> None:
    for number in (PRIME, ORDER):
        assert all(pow(base, number - 1, number) == 1 for base in (2, 3, 5, 7, 11, 13))
        assert all(number % small for small in range(2, 50_000))


@pytest.mark.parametrize("operation", ["inverse", "root", "logarithm"])
def test_what_has_no_residue_is_refused(operation: str) -> None:
    with pytest.raises(NotRegularError):
        getattr(FIELD, operation)(of(Fraction(0)))
    with pytest.raises(NotRegularError):
        residue(Fraction(1, PRIME), PRIME)


@pytest.mark.parametrize(("rows", "columns", "rank"), [(5, 5, 3), (12, 7, 7), (3, 8, 2), (6, 6, 0)])
def test_elimination_finds_the_rank_of_a_product_of_thin_matrices(rows: int, columns: int, rank: int) -> None:
    generator = np.random.default_rng(0)
    left = generator.integers(0, PRIME, (rows, rank), dtype=np.uint64)
    right = generator.integers(0, PRIME, (rank, columns), dtype=np.uint64)
    assert rank_of(product_of(left, right)) == rank


def test_the_matrix_product_of_large_residues_does_not_overflow() -> None:
    largest = np.full((1, 400), PRIME - 1, dtype=np.uint64)
    assert product_of(largest, largest.T) == 400
    assert product_of(largest, np.full((400, 1), PRIME - 2, dtype=np.uint64)) == 800


def test_pivot_columns_are_the_first_independent_ones() -> None:
    matrix = of(*map(Fraction, (1, 2, 0, 3, 2, 4, 1, 7, 0, 0, 0, 0))).reshape(1, 3, 4)
    assert (reduce_columns(matrix, 4).pivots[0] >= 0).tolist() == [True, False, True, False]


@pytest.mark.parametrize("own", [0, 1, 3])
@pytest.mark.parametrize("deficient", [False, True])
def test_eliminating_item_by_item_gives_rank_and_null_space_of_the_whole(own: int, deficient: bool) -> None:
    generator = np.random.default_rng(own)
    items, rows, common = 4, 3, 6
    blocks = generator.integers(0, PRIME, (items, 1, rows, common), dtype=np.uint64)
    unknown = generator.integers(0, PRIME, (items, 1, rows, own), dtype=np.uint64)
    if deficient and own:
        unknown[1, :, :, 0] = 0
    whole = np.zeros((items * rows, common + items * own), dtype=np.uint64)
    for item in range(items):
        at = slice(item * rows, (item + 1) * rows)
        whole[at, :common] = blocks[item, 0]
        whole[at, common + item * own : common + (item + 1) * own] = unknown[item, 0]
    found = Codistribution(common, [(items, own)], FIELD)
    for row in range(rows):  # order by order
        at = slice(row, row + 1)
        given = np.concatenate([unknown[:, 0, at], blocks[:, 0, at]], axis=2)
        found.add(GradientRows(np.zeros((0, 1, common), dtype=np.uint64), (given,)))
    space = found.null_space()
    assert found.rank == rank_of(whole)
    assert space.shape == (whole.shape[1], whole.shape[1] - found.rank)
    assert rank_of(space) == space.shape[1]
    assert not product_of(whole, space).any()
