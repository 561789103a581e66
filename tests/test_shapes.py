"""The shape checks of the whole suite (`shape_checks`) are on, and can fail."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from jaxtyping import Float
from shape_checks import WrongShapeError, check_class, checked

from spinfilters.core import attitude_conversions as conversions
from spinfilters.core.errors import ShapeError
from spinfilters.models.state_layout import StateLayout

Vectors = Float[np.ndarray, "*batch 3"]


def unwrapped(function: Any) -> Any:
    """What a checked function wraps, or None."""
    return getattr(function, "__wrapped__", None)


def test_the_package_under_test_is_checked() -> None:
    assert unwrapped(conversions.multiply) is not None
    assert unwrapped(StateLayout.retract) is not None


def test_a_result_of_another_shape_than_stated_is_found() -> None:
    @checked
    def halves(v: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        return v[::2]

    with pytest.raises(WrongShapeError, match=r"halves: return .* \{'v': \(4,\), 'return': \(2,\)\}"):
        halves(np.zeros(4))


def test_an_argument_of_another_shape_that_is_silently_accepted_is_found() -> None:
    @checked
    def total(v: Float[np.ndarray, " 3"]) -> float:
        return float(v.sum())

    assert total(np.ones(3)) == 3.0
    with pytest.raises(WrongShapeError, match="total: v is not"):
        total(np.ones(4))


def test_a_wrong_shape_is_found_after_right_ones_and_every_time() -> None:
    @checked
    def last(v: Float[np.ndarray, " 3"], *, of: Float[np.ndarray, " 2"] | None = None) -> float:
        return float(v[-1]) + (0.0 if of is None else float(of[-1]))

    for _ in range(2):
        assert last(np.ones(3), of=np.ones(2)) == last(np.ones(3)) + 1
        for wrong, of in ((np.ones(4), None), (np.ones(3), np.ones(3))):
            with pytest.raises(WrongShapeError, match="last: "):
                last(wrong, of=of)
        with pytest.raises(WrongShapeError, match="last: v is not"):
            last([1.0, 2.0, 3.0, 4.0])  # pyright: ignore[reportArgumentType]


def test_an_axis_name_has_one_meaning_within_a_call() -> None:
    @checked
    def both(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> int:
        return len(a) + len(b)

    with pytest.raises(WrongShapeError, match="both: b is not"):
        both(np.zeros(2), np.zeros(3))


def test_a_refused_call_keeps_its_own_error() -> None:
    with pytest.raises(ShapeError, match="q must end in shape"):
        conversions.matrix_from_quaternion(np.zeros(3))


def test_batch_axes_of_arguments_broadcast_and_the_result_has_all_of_them() -> None:
    @checked
    def first(a: Vectors, b: Vectors) -> Vectors:
        return np.broadcast_arrays(a, b)[0] if len(a) > 1 else a

    first(np.zeros((5, 1, 3)), np.zeros((4, 3)))
    with pytest.raises(WrongShapeError, match="first: return"):
        first(np.zeros((1, 3)), np.zeros((4, 3)))


def test_members_of_a_tuple_and_of_a_union_are_checked() -> None:
    @checked
    def pair(wide: bool) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, "2 2"] | None]:
        return np.zeros(2), np.zeros((2, 3)) if wide else None

    pair(wide=False)
    with pytest.raises(WrongShapeError, match="pair: return"):
        pair(wide=True)


def test_the_fields_of_a_dataclass_are_checked_when_it_is_made() -> None:
    @dataclass(frozen=True)
    class Track:
        time: Float[np.ndarray, " n"]
        points: Float[np.ndarray, "n 3"]

    check_class(Track)
    Track(np.zeros(2), np.zeros((2, 3)))
    with pytest.raises(WrongShapeError, match="points is not"):
        Track(np.zeros(2), np.zeros((3, 3)))
