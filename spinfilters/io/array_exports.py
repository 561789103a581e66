"""Recordings that programs save as arrays: NumPy .npz, MATLAB .mat, Parquet, and JSON as Sensor Logger exports it."""

import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_reader import StatedReader
from spinfilters.io.input_file import path_text, printable, read_bytes, reason, require_file, value_text
from spinfilters.io.memory_tables import array_columns
from spinfilters.io.motion_file import bare_quantity, motion_dataset
from spinfilters.io.motion_table import motion_of
from spinfilters.io.named_columns import ArrayColumns

LARGEST: Final = 2 * 1024**3
"""Bytes of a file, and of the numbers in it."""
LARGEST_JSON: Final = 512 * 1024**2
_SENSORS: Final = ("gyroscope", "gyroscopeuncalibrated", "gyro", "imu")
"""Values of the key "sensor" in JSON whose rows are body rates, in the order in which they are taken."""


class ArrayExportReader(StatedReader):
    """A file of named arrays; its columns are known by their names as those of a text table."""

    name, order = "array-export", 45
    words = "a .npz, .mat, .parquet or .json of arrays"

    def recognises(self, path: Path) -> bool:
        """Whether a file is named as one of them."""
        return path.suffix.lower() in _READERS and not path.is_dir()

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Data set of the arrays that tell a motion."""
        self.options.require_only(("unit", "clock", "rate"), "a file of arrays")
        require_file(path, LARGEST)
        columns, bare = _READERS[path.suffix.lower()](path), bare_quantity(path)
        if path.suffix.lower() == ".json":
            bare = "rate"
        return motion_dataset(path, path.name, motion_of(columns, self.options, bare))


def _npz(path: Path) -> ArrayColumns:
    """Arrays of an .npz. InputError: objects in it, or more numbers than are read."""
    try:
        with zipfile.ZipFile(path) as archive:
            _require_size(path, sum(member.file_size for member in archive.infolist()))
        with np.load(path, allow_pickle=False) as members:
            return _columns_of(path, {name: members[name] for name in members.files})
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, NotImplementedError) as error:
        raise InputError(
            f"{path_text(path)}: is no .npz of plain arrays ({reason(error)}); save it with numpy.savez"
        ) from None


def _mat(path: Path) -> ArrayColumns:
    """Arrays of a .mat up to version 7, and those of its structures by name."""
    from scipy.io import loadmat, whosmat
    from scipy.io.matlab import MatReadError

    try:
        _require_size(path, sum(8 * int(np.prod(shape, dtype=np.float64)) for _, shape, _ in whosmat(path)))
        held = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise InputError(
            f"{path_text(path)}: is a .mat of version 7.3; save it in MATLAB with save(..., '-v7')"
        ) from None
    except (MatReadError, OSError, ValueError, TypeError, IndexError, EOFError, KeyError) as error:
        raise InputError(
            f"{path_text(path)}: is no whole .mat ({reason(error)}); save it in MATLAB with save(..., '-v7')"
        ) from None
    flat = _flat(held)
    last = [name.rsplit(".", 1)[-1] for name in flat]
    if len(set(last)) == len(last):  # no two structures have a field of one name
        flat = dict(zip(last, flat.values(), strict=True))
    return _columns_of(path, flat)


def _flat(held: Mapping[str, Any], before: str = "") -> dict[str, np.ndarray]:
    """Arrays of variables and of structures, by their names with dots."""
    found: dict[str, np.ndarray] = {}
    for name, value in held.items():
        if name.startswith("__"):
            continue
        if isinstance(value, dict) and before.count(".") < 3:
            found |= _flat(value, f"{before}{name}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
            found[f"{before}{name}"] = value
    return found


def _parquet(path: Path) -> ArrayColumns:
    """Columns of a Parquet file. InputError: without pyarrow, or another file."""
    try:
        from pyarrow import ArrowException, parquet
    except ImportError:
        raise InputError(
            f"{path_text(path)}: a Parquet file needs the package pyarrow; install it with pip install 'spinfilters[campaign]'"
        ) from None
    try:
        with parquet.ParquetFile(path) as file:
            _require_size(path, 8 * file.metadata.num_rows * file.metadata.num_columns)
            table = file.read()
        return _columns_of(path, {name: table[name].to_numpy() for name in table.column_names})
    except (ArrowException, OSError, ValueError) as error:
        raise InputError(
            f"{path_text(path)}: is no whole Parquet file ({reason(error)}); write it again"
        ) from None


def _json(path: Path) -> ArrayColumns:
    """Rows of a JSON list of objects, those of the gyro where they say which sensor they are of; or columns by name."""
    try:
        document = json.loads(read_bytes(path, LARGEST_JSON))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path_text(path)}: is not JSON ({reason(error)}); export it again") from None
    if isinstance(document, dict):
        return _columns_of(path, {name: v for name, v in document.items() if isinstance(v, list)})
    if not isinstance(document, list) or not all(isinstance(row, dict) for row in document):
        raise InputError(f"{path_text(path)}: is no list of rows with names; export a table")
    kinds = [printable(str(row.get("sensor", ""))).lower() for row in document]
    chosen = next((name for name in _SENSORS if name in kinds), None)
    if chosen is None and any(kinds):
        seen = ", ".join(sorted({kind for kind in kinds if kind})[:6])
        raise InputError(f"{path_text(path)}: holds {value_text(seen)} and no Gyroscope; export that sensor")
    rows = [row for row, kind in zip(document, kinds, strict=True) if chosen in (None, kind)]
    names = [name for name in (rows[0] if rows else {}) if name != "sensor"]
    has_seconds = "seconds_elapsed" in names
    names = [name for name in names if not (has_seconds and name == "time")]
    columns = {name: np.array([row.get(name) for row in rows], dtype=object) for name in names}
    return array_columns(columns, path)


def _columns_of(path: Path, arrays: Mapping[str, Any]) -> ArrayColumns:
    """Named columns of the arrays that are as long as the commonest; three columns of one array are its x, y, z.

    Raises
    ------
    InputError
        No array of numbers.
    """
    columns: dict[str, np.ndarray] = {}
    for name, held in arrays.items():
        array: np.ndarray = np.asarray(held)
        if array.ndim == 2 and 1 in array.shape:
            array = array.reshape(-1)
        if array.ndim == 2 and array.shape[1] not in (3, 4) and array.shape[0] in (3, 4):
            array = array.T  # a column for each sample, as MATLAB users keep them
        if array.ndim == 1 and array.dtype.kind in "iufmM":
            columns[name] = array
        elif array.dtype.kind in "iuf" and array.shape[1:] == (3,):
            columns |= {f"{name}_{axis}": column for axis, column in zip("xyz", array.T, strict=True)}
        elif array.dtype.kind in "iuf" and array.shape[1:] == (4,):
            columns |= {f"{name}[{k}]": column for k, column in enumerate(array.T)}
    lengths = [len(column) for column in columns.values()]
    if not lengths:
        raise InputError(
            f"{path_text(path)}: holds no arrays of numbers; save a clock and body rates, or poses"
        )
    commonest = max(set(lengths), key=lambda n: (lengths.count(n), n))
    return array_columns({k: column for k, column in columns.items() if len(column) == commonest}, path)


def _require_size(path: Path, size: int) -> None:
    """InputError: more bytes than are read."""
    if size > LARGEST:
        raise InputError(
            f"{path_text(path)}: unpacks to {size} bytes, at most {LARGEST} are read; cut it into smaller files"
        )


_READERS: Final = {".npz": _npz, ".mat": _mat, ".parquet": _parquet, ".pq": _parquet, ".json": _json}
"""By suffix."""
