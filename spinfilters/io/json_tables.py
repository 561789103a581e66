"""Tables within a JSON document: rows with names, columns by name, packets of samples, at any depth.

Programs nest the same table in many ways. A document is walked once; what looks like a table becomes named columns, and the names
decide which of them describes a motion.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, TypeGuard

from spinfilters.core.errors import InputError
from spinfilters.io.headings import heading_of, is_clock
from spinfilters.io.input_file import path_text, reason, value_text
from spinfilters.io.logger_names import GOPRO_ORDER, understood_names
from spinfilters.io.stated_values import SAMPLING_RATE, ReadingOptions, to_state

_DEEPEST: Final = 8
"""Levels of a document that are looked into."""
_WIDEST: Final = 16
"""Numbers of a list that are components of one value."""
_MATRICES: Final = ((3, 3), (3, 4), (4, 4))
"""Rows and columns of a rotation R, and of [R t], whose fourth row is 0 0 0 1."""
_DIGITS: Final = 1e-3
"""Of R R', which the digits of a text cause at most."""
_KINDS: Final = ("type", "mavpackettype", "sensor", "topic", "stream", "message")
"""Keys of a row that say what it is of."""
_VALUES: Final = ("value", "values", "data", "v")
"""Keys of a value whose quantity and unit stand beside its rows."""
_NAMES: Final = ("columns", "fields", "header", "names", "labels")
"""Keys of the names of rows without names."""
_RECORD3D: Final = ("qx", "qy", "qz", "qw", "px", "py", "pz")
"""Numbers of its poses."""
_RATES: Final = (
    "fps",
    "samplerate",
    "samplingrate",
    "samplefrequency",
    "samplingfrequency",
    "frequency",
    "fs",
    "hz",
    "odr",
)
_ORDER: Final = re.compile(r"\s*\(([xyz]),([xyz]),([xyz])\)\s*$", re.IGNORECASE)
"""Order of the components behind the name of a stream, as GoPro cameras state it."""


@dataclass(frozen=True)
class JsonTable:
    """Columns of equal length within a document.

    Attributes
    ----------
    place : str
        Keys that lead to it, with dots.
    columns : dict[str, list]
        Values by name.
    rate : float | None
        Samples a second, Hz, as a key beside it says; None of others.
    """

    place: str
    columns: dict[str, list[Any]]
    rate: float | None = None

    @property
    def is_motion(self) -> bool:
        """Whether its names are those of a rate or of an attitude."""
        quantities = {
            (h.quantity, h.axis) for n in understood_names(list(self.columns)) if (h := heading_of(n))
        }
        rates = {("rate", axis) for axis in "xyz"}
        return (
            rates <= quantities
            or any(
                name.endswith(("qw", "orientation.w", "rotation.w", "quaternion.w")) for name in self.columns
            )
            or (("quaternion", "w") in quantities)
            or ("mrp", "x") in quantities
            or ("matrix", "xx") in quantities
        )


def parsed_json(path: Path, data: bytes) -> Any:
    """Document of a JSON file, or the list of those on its lines. InputError: neither, with the line that is none."""
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        first = error
    lines = [(k, line) for k, line in enumerate(data.splitlines(), start=1) if line.strip()]
    found = []
    for number, line in lines:
        try:
            found.append(json.loads(line))
        except (ValueError, RecursionError) as error:
            if not found:
                raise InputError(
                    f"{path_text(path)}: is not JSON ({reason(first)}); export it again"
                ) from None
            if number == lines[-1][0]:
                break  # the power went while the last line was written
            raise InputError(
                f"{path_text(path)}: line {number}: is not JSON ({reason(error)}); correct or delete the line"
            ) from None
    return found


def chosen_table(path: Path, document: Any, options: ReadingOptions) -> JsonTable:
    """The table of a document that describes a motion, or the one that the user names by its place.

    Raises
    ------
    InputError
        No table; several that describe a motion.
    """
    found = [table for table in _tables(document, (), {}) if table.columns]
    if options.topic is not None:
        named = [t for t in found if options.topic in (t.place, t.place.rpartition(".")[2])]
        found = named or found
    if not found:
        raise InputError(
            f"{path_text(path)}: holds no table of numbers; save a clock and body rates, or poses"
        )
    rates = set(_rates_within(document, 0))
    if len(rates) == 1:  # that of all tables without one of their own
        found = [table if table.rate is not None else replace(table, rate=min(rates)) for table in found]
    moving = [table for table in found if table.is_motion]
    if len(moving) > 1:
        listed = ", ".join(value_text(table.place) for table in moving[:6])
        raise InputError(
            f"{path_text(path)}: {listed} each describe a motion; give {to_state('topic', 'ONE OF THEM')}"
        )
    return moving[0] if moving else max(found, key=lambda table: len(next(iter(table.columns.values()))))


def _tables(node: Any, place: tuple[str, ...], above: Mapping[str, Any]) -> Iterator[JsonTable]:
    """Tables within a node; ``above`` are the keys beside it."""
    if len(place) > _DEEPEST:
        return
    if isinstance(node, list):
        rows = [each for each in node if isinstance(each, dict)]
        if len(rows) > 1 and len(rows) == len(node):
            yield from _of_rows(rows, place, above)
        elif len(rows) == 1 and len(node) == 1:
            yield from _tables(rows[0], place, above)
        elif (width := _width(node)) > 1:
            names = _names_beside(above, width) or [f"{'.'.join(place)}[{k}]" for k in range(width)]
            columns = {name: [row[k] for row in node] for k, name in enumerate(names)}
            yield JsonTable(".".join(place), columns, _rate_beside(above))
        return
    if not isinstance(node, dict):
        return
    if (rows := _rows_by_index(node)) is not None:
        yield from _of_rows(rows, place, above)
        return
    own = _columns_by_name(node)
    yield JsonTable(".".join(place), own, _rate_beside(node))
    beside = {**above, **{key: value for key, value in node.items() if not isinstance(value, dict)}}
    for key, value in node.items():
        is_column = any(name == key or name.startswith((f"{key}.", f"{key}_")) for name in own)
        if not is_column:
            yield from _tables(value, (*place, str(key)), beside)


def _rows_by_index(node: Mapping[str, Any]) -> list[dict[str, Any]] | None:
    """Rows of pandas, which are keyed by their index, or columns of which each value is; None of other objects."""
    values = list(node.values())
    if len(values) < 2 or not all(isinstance(each, dict) for each in values):
        return None
    keys = list(values[0])
    if not keys or any(list(each) != keys for each in values[1:]):
        return None
    if len(keys) > 1 and all(key.isdigit() for key in keys):  # columns, whose values are keyed by the row
        return [{name: column[key] for name, column in node.items()} for key in keys]
    return values if all(key.isdigit() for key in node) else None


def _columns_by_name(node: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Lists of numbers of one length in an object and in its objects, the commonest length of several."""
    lists: dict[str, list[Any]] = {}
    for name, value in _lists(node, ""):
        width = _width(value)
        if _is_numbers(value):
            lists[name] = value
        elif width > 1 and len(value) > 1:
            axes = dict(enumerate(["_x", "_y", "_z"])) if width == 3 else {k: f"[{k}]" for k in range(width)}
            lists |= {f"{name}{axes[k]}": [row[k] for row in value] for k in range(width)}
    lengths = [len(each) for each in lists.values() if len(each) > 1]
    if not lengths:
        return {}
    commonest = max(set(lengths), key=lambda n: (lengths.count(n), n))
    found = {name: each for name, each in lists.items() if len(each) == commonest}
    return _by_last_name(found) if len(found) > 1 else {}


def _lists(node: Mapping[str, Any], before: str) -> Iterator[tuple[str, list[Any]]]:
    """Lists in an object and its objects, by their names with dots."""
    for key, value in node.items():
        if isinstance(value, list) and value:
            yield f"{before}{key}", value
        elif isinstance(value, dict) and before.count(".") < 3:
            yield from _lists(value, f"{before}{key}.")


def _is_numbers(values: Sequence[Any]) -> bool:
    """Whether a list holds numbers, or texts, and neither lists nor objects."""
    return not any(isinstance(each, list | dict) for each in values)


def _width(rows: Sequence[Any]) -> int:
    """Numbers of each list in a list of lists, which are alike; 0 of any other."""
    if not rows or not isinstance(rows[0], list):
        return 0
    width = len(rows[0])
    alike = all(isinstance(row, list) and len(row) == width and _is_numbers(row) for row in rows)
    return width if alike and width <= _WIDEST else 0


def _names_beside(above: Mapping[str, Any], width: int) -> list[str]:
    """Names of as many columns in a list beside the rows; empty without one."""
    if {"poses", "fps", "dw"} <= above.keys() and width == len(_RECORD3D):
        return list(_RECORD3D)
    lists = (above[key] for key in _NAMES if isinstance(above.get(key), list))
    return next(
        (
            [str(n) for n in each]
            for each in lists
            if len(each) == width and all(isinstance(n, str) for n in each)
        ),
        [],
    )


def _rate_beside(above: Mapping[str, Any]) -> float | None:
    """Rate that a key states, Hz."""
    for key, value in above.items():
        is_rate = re.sub(r"[^a-z]", "", str(key).lower()) in _RATES
        if is_rate and isinstance(value, int | float) and value in SAMPLING_RATE:
            return float(value)
    return None


def _rates_within(node: Any, depth: int) -> Iterator[float]:
    """Rates that a document states at any depth outside of its rows, Hz."""
    if isinstance(node, dict) and depth <= _DEEPEST:
        if (rate := _rate_beside(node)) is not None:
            yield rate
        for value in node.values():
            yield from _rates_within(value, depth + 1)


def _of_rows(
    rows: Sequence[Mapping[str, Any]], place: tuple[str, ...], above: Mapping[str, Any]
) -> Iterator[JsonTable]:
    """Tables of a list of objects, one for each kind of row."""
    samples = _samples(rows)
    flat = [_flat(row, "") for row in samples]
    kind = next(
        (name for name in flat[0] if name.rpartition(".")[2] in _KINDS and isinstance(flat[0][name], str)),
        None,
    )
    kinds = list(dict.fromkeys(str(row.get(kind, "")) for row in flat)) if kind is not None else [""]
    for called in kinds if len(kinds) <= 1000 else kinds[:1]:
        own = [row for row in flat if kind is None or str(row.get(kind, "")) == called]
        names = [name for name in own[0] if name != kind]
        columns = _by_last_name(_with_units({name: [row.get(name) for row in own] for name in names}))
        where = ".".join((*place, *([called] if len(kinds) > 1 else [])))
        yield JsonTable(where, _with_quantity(columns, place, above), _rate_beside(above))


def _with_units(columns: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """Columns of which those beside a text that is called unit, the same in all rows, have this unit in their names."""
    units = {
        name.rpartition(".")[0]: values[0]
        for name, values in columns.items()
        if name.rpartition(".")[2] in ("unit", "units")
        and isinstance(values[0], str)
        and values.count(values[0]) == len(values)
    }
    return {
        f"{name} ({units[name.rpartition('.')[0]]})"
        if _is_axis(name) and name.rpartition(".")[0] in units
        else name: values
        for name, values in columns.items()
    }


def _is_axis(name: str) -> bool:
    """Whether a column is a component."""
    heading = heading_of(name)
    return (
        heading is not None
        and bool(heading.axis)
        and heading.quantity in ("rate", "acceleration", "position")
    )


def _with_quantity(
    columns: dict[str, list[Any]], place: tuple[str, ...], above: Mapping[str, Any]
) -> dict[str, list[Any]]:
    """Columns, those of a bare value called by the name and unit that stand beside the rows."""
    quantity = str(
        above.get("name") or next((part for part in reversed(place) if part not in ("samples", "data")), "")
    )
    unit = next((above[key] for key in ("units", "unit") if isinstance(above.get(key), str)), "")
    order = _ORDER.search(quantity)
    axes = (
        [axis.lower() for axis in order.groups()]
        if order is not None
        else list(GOPRO_ORDER if "GYRO" in place else "xyz")
    )
    quantity = quantity[: order.start()] if order is not None else quantity
    found = {}
    for name, values in columns.items():
        stem, _, axis = name.rpartition("_")
        is_bare = stem in _VALUES and axis in ("x", "y", "z") and bool(quantity)
        called = f"{quantity}_{axes['xyz'.index(axis)]}" if is_bare else name
        found[f"{called} ({unit})" if is_bare and unit else called] = values
    return found


def _flat(row: Mapping[str, Any], before: str) -> dict[str, Any]:
    """A row whose objects and lists are values by name: position.x, gyro_x, orientation[0], pose.box.orientation.w."""
    flat: dict[str, Any] = {}
    for key, value in row.items():
        name = f"{before}{key}"
        if isinstance(value, list) and len(value) == 1 and isinstance(value[0], dict):
            value = {str(value[0]["name"]): value[0]} if isinstance(value[0].get("name"), str) else value[0]
        if isinstance(value, dict) and before.count(".") < _DEEPEST:
            flat |= _flat(value, f"{name}.")
        elif (
            isinstance(value, list)
            and value
            and all(isinstance(each, dict) and isinstance(each.get("name"), str) for each in value)
        ):
            for each in value:
                flat |= _flat(each, f"{name}.{each['name']}.")
        elif _is_matrix(value):
            flat |= {f"{name}.r{i}{j}": value[i][j] for i in range(3) for j in range(3)}
            if len(value[0]) == 4:
                flat |= {f"{name}.t{axis}": value[k][3] for k, axis in enumerate("xyz")}
        elif isinstance(value, list) and len(value) <= _WIDEST and _is_numbers(value):
            axes = ["_x", "_y", "_z"] if len(value) == 3 else [f"[{k}]" for k in range(len(value))]
            flat |= {f"{name}{axis}": each for axis, each in zip(axes, value, strict=True)}
        elif not isinstance(value, list):
            flat[name] = value
    return flat


def _samples(rows: Sequence[Mapping[str, Any]]) -> Sequence[Mapping[str, Any]]:
    """Rows, those that hold several samples each as so many: the first of them has the time of the row."""
    plain = [_unnested(row) for row in rows]
    packed = [name for name, value in plain[0].items() if _is_packet(name, value)]
    clock = next((name for name in plain[0] if is_clock(name)), None)
    if not packed or clock is None:
        return rows
    counts = [len(row.get(packed[0]) or ()) for row in plain]
    try:
        times = [float(row[clock]) for row in plain]
    except (KeyError, TypeError, ValueError, OverflowError):
        return rows
    found: list[dict[str, Any]] = []
    for k, (row, count) in enumerate(zip(plain, counts, strict=True)):
        last = min(k, len(times) - 2)
        step = (times[last + 1] - times[last]) / max(counts[last], 1) if len(times) > 1 else 0.0
        own = [name for name in packed if len(row.get(name) or ()) == count]
        found += [{clock: times[k] + step * j, **{name: row[name][j] for name in own}} for j in range(count)]
    return found or rows


def _unnested(row: Mapping[str, Any], depth: int = 0) -> dict[str, Any]:
    """A row with the values of the objects in it by their own names."""
    flat: dict[str, Any] = {}
    for key, value in row.items():
        is_object = isinstance(value, dict) and depth < _DEEPEST
        flat |= _unnested(value, depth + 1) if is_object else {key: value}
    return flat


def _is_matrix(value: Any) -> TypeGuard[list[list[Any]]]:
    """Whether a value is the matrix of a rotation or of a rigid transformation, row by row."""
    if not isinstance(value, list) or (len(value), _width(value)) not in _MATRICES:
        return False
    try:
        rows = [[float(each) for each in row] for row in value]
    except (TypeError, ValueError, OverflowError):
        return False
    products = [
        abs(sum(a * b for a, b in zip(rows[i][:3], rows[j][:3], strict=True)) - (i == j))
        for i in range(3)
        for j in range(3)
    ]
    return max(products) < _DIGITS and rows[3:] in ([], [[0.0, 0.0, 0.0, 1.0]])


def _is_packet(name: str, value: Any) -> bool:
    """Whether a value is a list of samples: of objects, of lists, or of numbers about one axis."""
    if not isinstance(value, list) or not value:
        return False
    if isinstance(value[0], dict):
        return "name" not in value[0] and all(isinstance(each, dict) for each in value)
    if isinstance(value[0], list):
        return _width(value) in (3, 4) and not _is_matrix(value)
    heading = heading_of(name)
    return heading is not None and bool(heading.axis) and _is_numbers(value)


def _by_last_name(columns: dict[str, Any]) -> dict[str, Any]:
    """Columns without the names of what holds them, unless two are called alike."""
    last = [name.rsplit(".", 1)[-1] for name in columns]
    is_short = any(len(name) == 1 and name in "xyzw" for name in last)  # their quantity stands in front
    return (
        columns if is_short or len(set(last)) < len(last) else dict(zip(last, columns.values(), strict=True))
    )
