"""Variables of a MATLAB .mat of version 4 to 7: of structures, of Simulink, of Modelica's results.

SciPy reads it, once its elements are known to be whole: at some that are not, SciPy's reader ends the process.
"""

import math
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import ignored_warnings, largest_unpacked, path_text

LARGEST: Final = 2 * 1024**3
"""Bytes of a file, and of the numbers in it."""
DEEPEST_GROUP: Final = 3
"""Structures or groups within one another whose names are read."""
_DEEPEST: Final = 20
"""Cells and structures of a .mat within one another."""
_MATRIX, _COMPRESSED = 14, 15
_DATA_TYPES: Final = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13, _MATRIX, 16, 17, 18})
_OPAQUE, _BYTES = 17, 9
"""Classes of an object, and of the array without a name in which MATLAB keeps what objects hold."""
_PART: Final = 1 << 14
"""Bytes that are unpacked at once, to a thousand times as many at most."""


def matlab_variables(path: Path, content: bytes) -> Mapping[str, Any]:
    """All that a .mat holds, by name, structures as mappings.

    Raises
    ------
    InputError
        Objects alone, or more numbers than are read.
    ValueError, or whatever SciPy raises
        Damaged content.
    """
    from scipy.io import loadmat, whosmat

    classes = _classes_of_mat(content)
    if _OPAQUE in classes and set(classes) <= {_OPAQUE, _BYTES}:
        raise InputError(
            f"{path_text(path)}: holds objects, such as timetables, which MATLAB alone reads; save a table there with "
            "writetimetable(tt, 'run.csv'), or the numbers as arrays"
        )
    with ignored_warnings(UserWarning):
        variables = whosmat(path)
        if any(min(shape, default=0) < 0 for _, shape, _ in variables):
            raise ValueError("an array states a negative number of rows")
        if len({name for name, _, _ in variables}) < len(variables):
            raise ValueError("a variable stands twice")
        require_size(path, sum(8 * math.prod(shape) for _, shape, _ in variables))
        return loadmat(path, simplify_cells=True)


def require_size(path: Path, size: int) -> None:
    """InputError: more bytes than are read, or than a file of its size can pack of measurements."""
    largest = min(LARGEST, largest_unpacked(path.stat().st_size))
    if size > largest:
        raise InputError(
            f"{path_text(path)}: unpacks to {size} bytes, at most {largest} are read; cut it into smaller files"
        )


def _classes_of_mat(data: bytes) -> list[int]:
    """Classes of the variables of a .mat.

    ValueError: elements that are cut off, unknown or nested too deep, at which SciPy's reader crashes.
    """
    if 0 in data[:4]:  # version 4 has no elements
        return []
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise ValueError("it begins otherwise")
    return _sound_elements(memoryview(data)[128:], order, 0)


def _sound_elements(data: memoryview, order: str, depth: int) -> list[int]:
    """Classes of the arrays among elements, each a type, a size and a body; small ones keep both in four bytes, the size first."""
    if depth > _DEEPEST:
        raise ValueError(f"more than {_DEEPEST} cells or structures lie within one another")
    place, classes = 0, []
    while place + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}2I", data, place)
        place += 8
        if kind >> 16:  # a small element, whose body is within these eight bytes
            kind, size, end = kind & 0xFFFF, kind >> 16, place
            if size > 4:
                raise ValueError(f"a small element states {size} bytes")
        else:
            end = place + size
            if end > len(data):
                raise ValueError("it is cut off")
        body = data[place:end]
        if kind == _COMPRESSED and depth == 0:
            classes += _sound_elements(_unpacked(body, order), order, depth)
        elif kind not in _DATA_TYPES:
            raise ValueError(f"an element has the unknown type {kind}")
        elif kind == _MATRIX:
            _sound_elements(body, order, depth + 1)
            if len(body) >= 12:  # behind the tag of its flags, whose lowest byte is the class
                classes.append(struct.unpack_from(f"{order}I", body, 8)[0] & 0xFF)
        place = end if kind == _COMPRESSED else end + (place - end) % 8
    return classes


def _unpacked(packed: memoryview, order: str) -> memoryview:
    """The one element that a compressed one holds, whose first eight bytes state its size before memory is taken for it."""
    unpacker, largest = zlib.decompressobj(), min(LARGEST, largest_unpacked(len(packed)))
    parts = (packed[place : place + _PART] for place in range(0, len(packed), _PART))
    first = b""
    while len(first) < 8 and (part := next(parts, None)) is not None:
        first += unpacker.decompress(part)
    if len(first) < 8:
        raise ValueError("it is cut off")
    kind, stated = struct.unpack_from(f"{order}2I", first)
    size = 8 if kind >> 16 else 8 + stated  # a small element is within these eight bytes
    if size > largest:
        raise ValueError(f"it unpacks to {size} bytes, at most {largest} are read")
    found = bytearray(size)
    place = min(len(first), size)
    found[:place] = first[:place]
    while place < size and (part := next(parts, None)) is not None:
        more = unpacker.decompress(part, size - place)
        found[place : place + len(more)] = more
        place += len(more)
    rest = (unpacker.unconsumed_tail, *parts)  # the checksum of the whole, which zlib compares
    if place < size or not (any(unpacker.decompress(part, 1) for part in rest) or unpacker.eof):
        raise ValueError("it is cut off")
    return memoryview(found)


def with_one_clock(arrays: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
    """Arrays, of timeseries that all have the same times one clock for all of them."""
    own = {name: array for name, array in arrays.items() if name.rpartition(".")[2] in ("Time", "time")}
    times = [np.ravel(array) for array in own.values()]
    if len(own) < 2 or not all(np.array_equal(each, times[0]) for each in times[1:]):
        return arrays
    return {"Time": times[0], **{name: array for name, array in arrays.items() if name not in own}}


def arrays_of_structures(held: Mapping[str, Any], before: str = "") -> dict[str, np.ndarray]:
    """Arrays of variables and of structures, by their names with dots."""
    found: dict[str, np.ndarray] = {}
    for name, value in held.items():
        if name.startswith("__"):
            continue
        if name == "signals" and (signals := _signals(value)):  # a structure with time of Simulink
            found |= {f"{before}{label}": values for label, values in signals.items()}
        elif isinstance(value, dict) and before.count(".") < DEEPEST_GROUP:
            found |= arrays_of_structures(value, f"{before}{name}.")
        elif (records := _fields_of_records(value)) and before.count(".") < DEEPEST_GROUP:
            found |= arrays_of_structures(records, f"{before}{name}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
            whole = f"{before}{name}".removesuffix(".signals.values")  # a structure with time of Simulink
            found[whole.removesuffix(".Data") if "Time" in held else whole] = (
                value  # a timeseries as a structure
            )
    return found


def _fields_of_records(value: Any) -> dict[str, Any]:
    """Fields of an array of structures as arrays, a row for each structure, of those with as many numbers in each."""
    rows = (
        list(value) if isinstance(value, list) or (isinstance(value, np.ndarray) and value.ndim == 1) else []
    )
    if len(rows) < 2 or not all(isinstance(row, dict) and row.keys() == rows[0].keys() for row in rows):
        return {}
    fields: dict[str, Any] = {}
    for name in rows[0]:
        held = [row[name] for row in rows]
        if all(isinstance(each, dict) for each in held):
            fields[name] = held
        elif len({np.shape(each) for each in held}) == 1 and np.ndim(held[0]) < 2:
            fields[name] = np.array(held)
    return fields


def _signals(value: Any) -> dict[str, np.ndarray]:
    """Values of the signals of Simulink by their labels, of those that have one."""
    signals = list(value) if isinstance(value, list | np.ndarray) else [value]
    return {
        each["label"].strip("<>"): np.asarray(each["values"])
        for each in signals
        if isinstance(each, dict)
        and isinstance(each.get("label"), str)
        and each["label"]
        and "values" in each
    }


def modelica_result(held: Mapping[str, Any]) -> dict[str, np.ndarray] | None:
    """Variables over time in a result of Modelica, by their names; None of another .mat.

    Column k of ``dataInfo`` says of variable k in which array it is, and in which row of that. Rows count from 1, and a minus
    says that the variable has the other sign. Array 2 holds what varies; its row 1 is the time.
    """
    if not {"Aclass", "name", "dataInfo", "data_2"} <= held.keys():
        return None
    names, info, data = held["name"], np.asarray(held["dataInfo"]), np.asarray(held["data_2"])
    if str(np.ravel(held["Aclass"])[-1]).strip() == "binNormal":  # all arrays are kept the other way round
        info, data = info.T, data.T
    else:
        width = max(map(len, names), default=0)  # letters of a name stand below one another
        names = ["".join(row[k] for row in names if k < len(row)) for k in range(width)]
    found = {}
    for k, name in enumerate(names):
        block, place = int(info[0, k]), int(info[1, k])
        if block in (0, 2) and 1 <= abs(place) <= len(data):
            found[name.strip()] = np.sign(place) * data[abs(place) - 1]
    return found
