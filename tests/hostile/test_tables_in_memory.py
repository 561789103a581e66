"""Hostile arrays, data frames and mappings given to ``load``: one clear InputError, or a data set of finite numbers."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pytest

import spinfilters
from spinfilters import InputError

TIME = np.arange(20) * 0.1
RATES = np.column_stack([np.ones(20), 0.1 * TIME, np.full(20, 0.3)])
COLUMNS: dict[str, Any] = {"time_s": TIME, "wx": RATES[:, 0], "wy": RATES[:, 1], "wz": RATES[:, 2]}
ARRAY = np.column_stack([TIME, RATES])
FRAME = pd.DataFrame(COLUMNS)


class _Raising:
    """Has columns, and raises whatever is asked of it."""

    columns = ("time_s", "wx", "wy", "wz")

    def __getitem__(self, name: str) -> np.ndarray:
        raise RuntimeError(f"no {name}")


class _Array:
    """Says that it is an array, and is none."""

    def __array__(self, *_: Any, **__: Any) -> np.ndarray:
        raise RuntimeError("no array")


def _nested(depth: int) -> list[Any]:
    found: list[Any] = [1.0]
    for _ in range(depth):
        found = [found]
    return found


def _itself() -> list[Any]:
    found: list[Any] = []
    found.append(found)
    return found


def _read_only() -> np.ndarray:
    array = ARRAY.copy()
    array.flags.writeable = False
    return array


READ: dict[str, Callable[[], Any]] = {
    "whole": lambda: COLUMNS,
    "read-only": _read_only,
    "of Fortran's order": lambda: np.asfortranarray(ARRAY),
    "of negative strides": lambda: ARRAY[::-1].copy()[::-1],
    "of every other row": lambda: np.repeat(ARRAY, 2, axis=0)[::2],
    "of big-endian numbers": lambda: ARRAY.astype(">f8"),
    "of single precision": lambda: ARRAY.astype(np.float32),
    "of objects": lambda: ARRAY.astype(object),
    "a frame of objects": lambda: FRAME.astype(object),
    "a frame of nullable numbers": lambda: FRAME.convert_dtypes(),
    "a frame with a time zone": lambda: FRAME.drop(columns="time_s").assign(
        time=pd.to_datetime(TIME, unit="s", origin="2024-01-01").tz_localize("Europe/Berlin")
    ),
    "a frame with an index of two levels": lambda: FRAME.set_index(
        pd.MultiIndex.from_product([range(4), range(5)])
    ),
    "records": lambda: FRAME.to_records(index=False),
    "a frame of times with a time zone": lambda: FRAME.drop(columns="time_s").set_index(
        pd.to_datetime(TIME, unit="s", origin="2024-01-01").tz_localize("Asia/Tokyo")
    ),
    "nothing masked": lambda: np.ma.masked_array(ARRAY, mask=False),
    "a pair of times and values": lambda: (TIME, RATES),
    "texts of numbers": lambda: COLUMNS | {"wx": ["1.0"] * 20},
    "with a column that nobody needs": lambda: COLUMNS | {"note": ["x"] * 20},
}
REFUSED: dict[str, Callable[[], Any]] = {
    "no column": lambda: {"a": []},
    "empty columns": lambda: {name: [] for name in COLUMNS},
    "an empty array": lambda: np.empty((0, 4)),
    "an array without axes": lambda: np.float64(3.0),
    "a number": lambda: 3.0,
    "one row": lambda: ARRAY[:1],
    "three axes": lambda: ARRAY[None],
    "a column too few": lambda: ARRAY[:, :3],
    "a column too many": lambda: np.hstack([ARRAY, ARRAY]),
    "complex numbers": lambda: ARRAY + 1j,
    "a complex column": lambda: COLUMNS | {"wx": RATES[:, 0] + 1j},
    "truth values": lambda: COLUMNS | {"wx": np.ones(20, bool)},
    "words": lambda: COLUMNS | {"wx": ["fast"] * 20},
    "bytes": lambda: COLUMNS | {"wx": [b"x"] * 20},
    "objects without numbers": lambda: COLUMNS | {"wx": [object()] * 20},
    "dicts for numbers": lambda: COLUMNS | {"wx": [{}] * 20},
    "numbers of 400 digits": lambda: COLUMNS | {"wx": [10**400] * 20},
    "numbers of 5000 digits": lambda: COLUMNS | {"wx": [10**5000] * 20},
    "lists that differ": lambda: COLUMNS | {"wx": [1, [2], *[1] * 18]},
    "columns of other lengths": lambda: COLUMNS | {"wx": [1, 2]},
    "a list within itself": lambda: COLUMNS | {"wx": _itself()},
    "lists within one another": lambda: COLUMNS | {"wx": _nested(40)},
    "lists within one another without end": lambda: COLUMNS | {"wx": _nested(5000)},
    "NaN in the clock": lambda: COLUMNS | {"time_s": np.where(TIME < 0.1, np.nan, TIME)},
    "NaN in one rate": lambda: COLUMNS | {"wx": np.where(TIME < 0.1, np.nan, 1.0)},
    "infinite rates": lambda: COLUMNS | {"wx": np.full(20, np.inf)},
    "rates of 1e308": lambda: COLUMNS | {"wx": np.full(20, 1e308)},
    "a clock that runs back": lambda: COLUMNS | {"time_s": TIME[::-1]},
    "a clock that stands": lambda: COLUMNS | {"time_s": np.zeros(20)},
    "a clock of 1e300": lambda: COLUMNS | {"time_s": TIME * 1e300},
    "a clock of unsigned numbers that overflow": lambda: (
        COLUMNS | {"time_s": np.arange(20, dtype=np.uint64) + np.uint64(2**64 - 25)}
    ),
    "dates that are none": lambda: COLUMNS | {"time_s": np.full(20, "NaT", dtype="M8[ns]")},
    "one date that is none": lambda: (
        COLUMNS | {"time_s": np.array(["NaT", *["2024-01-01"] * 19], dtype="M8[ns]")}
    ),
    "dates of the year 1e9": lambda: COLUMNS | {"time_s": np.arange(20).astype("M8[Y]") + 10**9},
    "masked rows": lambda: np.ma.masked_array(ARRAY, mask=np.arange(80).reshape(20, 4) % 7 == 0),
    "a masked column": lambda: COLUMNS | {"wx": np.ma.masked_array(RATES[:, 0], mask=TIME < 0.5)},
    "names that are no texts": lambda: {None: TIME, 1: TIME, (2, 3): TIME, b"wz": TIME},
    "names twice": lambda: pd.DataFrame(ARRAY, columns=["time_s", "wx", "wx", "wz"]),
    "names in levels": lambda: pd.DataFrame(
        ARRAY, columns=pd.MultiIndex.from_product([["a", "b"], ["x", "y"]])
    ),
    "names with an escape": lambda: {f"{name}\x1b[2J\n": column for name, column in COLUMNS.items()},
    "a sparse clock": lambda: FRAME.assign(time_s=pd.arrays.SparseArray(np.where(TIME < 1, np.nan, TIME))),
    "categories": lambda: FRAME.assign(wx=pd.Categorical(["a", "b"] * 10)),
    "intervals": lambda: FRAME.assign(wx=pd.interval_range(0, 20)),
    "missing values": lambda: FRAME.assign(wx=pd.array([None] * 5 + [1.0] * 15, dtype="Float64")),
    "a frame that raises": _Raising,
    "a column that raises": lambda: COLUMNS | {"wx": _Array()},
    "generators": lambda: {name: (x for x in column) for name, column in COLUMNS.items()},
    "texts for columns": lambda: dict.fromkeys(COLUMNS, "abc"),
    "sets": lambda: {name: set(column.tolist()) for name, column in COLUMNS.items()},
    "a class": lambda: pd.DataFrame,
    "pairs of other lengths": lambda: (TIME[:5], RATES),
    "a pair of words": lambda: ("a", "b"),
    "huge": lambda: np.broadcast_to(np.float64(1.0), (10**12, 4)),
    "a huge column": lambda: dict.fromkeys(COLUMNS, np.broadcast_to(np.float64(1.0), 10**12)),
    "a million columns": lambda: np.broadcast_to(np.float64(1.0), (4, 10**6)),
}


def _load(table: Any) -> spinfilters.Dataset:
    kind = None if isinstance(table, dict | pd.DataFrame | _Raising) else "gyro"
    return spinfilters.load(table) if kind is None else spinfilters.load(table, kind=kind)


@pytest.mark.parametrize("name", READ)
def test_a_table_of_any_layout_is_read_as_its_numbers(name: str) -> None:
    table = READ[name]()
    stream = _load(table).log.streams[0]
    np.testing.assert_allclose(stream.values, RATES, rtol=1e-6)
    np.testing.assert_allclose(stream.time - stream.time[0], TIME, atol=1e-6)


@pytest.mark.parametrize("name", REFUSED)
def test_a_hostile_table_is_refused_in_one_line(name: str) -> None:
    table = REFUSED[name]()
    with pytest.raises(InputError) as refused:
        _load(table)
    text = str(refused.value)
    assert text.isprintable()
    assert len(text) < 400
