"""Which errors of libraries numbers may have caused, and which are defects."""

from collections.abc import Callable

import numpy as np
import pytest
import scipy.linalg

from spinfilters.core.errors import NUMERICAL_ERRORS, numerical

ONES = np.ones((2, 3))


def unpacked(rows: np.ndarray) -> np.ndarray:
    """The first of two rows."""
    one, _ = rows
    return one


DEFECTS: dict[str, Callable[[], object]] = {
    "broadcast": lambda: ONES + np.ones(4),
    "product": lambda: ONES @ np.ones(4),
    "reshape": lambda: ONES.reshape(4),
    "assignment": lambda: ONES.__setitem__(0, np.ones(2)),
    "concatenation": lambda: np.concatenate([ONES, np.ones((2, 4))]),
    "stack": lambda: np.stack([np.ones(2), np.ones(3)]),
    "sum of products": lambda: np.einsum("ij,jk->ik", ONES, ONES),
    "index": lambda: ONES[5],
    "unpacking": lambda: unpacked(ONES.T),
    "lengths": lambda: list(zip([1], [1, 2], strict=True)),
}


@pytest.mark.parametrize("name", DEFECTS)
def test_what_does_not_fit_together_is_no_numerical_trouble(name: str) -> None:
    with pytest.raises((ValueError, IndexError)) as met:
        DEFECTS[name]()
    assert isinstance(met.value, NUMERICAL_ERRORS)
    with pytest.raises(type(met.value)):
        numerical(met.value)


@pytest.mark.parametrize(
    "compute",
    [
        lambda: np.linalg.cholesky(-np.eye(2)),
        lambda: scipy.linalg.cholesky(np.full((2, 2), np.nan)),
        lambda: int(np.nan),
        lambda: 1 / 0,
    ],
)
def test_what_numbers_cause_is_numerical_trouble(compute: Callable[[], object]) -> None:
    with pytest.raises(NUMERICAL_ERRORS) as met:
        compute()
    assert numerical(met.value) is met.value
