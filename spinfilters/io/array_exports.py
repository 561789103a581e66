"""Recordings that programs save as arrays: NumPy .npy and .npz, MATLAB .mat, HDF5, NetCDF, Parquet, Feather, JSON and YAML."""

import math
import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any, Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.document import read_yaml_rows
from spinfilters.io.headings import is_clock, is_of_motion
from spinfilters.io.input_file import (
    MAX_TABLE_ROWS,
    path_text,
    printable,
    read_bytes,
    reason,
    require_file,
    value_text,
)
from spinfilters.io.json_tables import chosen_table, parsed_json
from spinfilters.io.matlab_file import (
    DEEPEST_GROUP,
    LARGEST,
    arrays_of_structures,
    matlab_variables,
    modelica_result,
    require_size,
    with_one_clock,
)
from spinfilters.io.memory_tables import array_columns
from spinfilters.io.motion_file import bare_quantity, motion_dataset
from spinfilters.io.motion_table import motion_of
from spinfilters.io.named_columns import ArrayColumns
from spinfilters.io.stated_values import ReadingOptions
from spinfilters.io.unnamed_columns import how_to_name

MATLAB_HDF5: Final = b"MATLAB 7.3 MAT-file"
"""First bytes of a .mat that is HDF5."""
YAML: Final = (".yaml", ".yml")
LARGEST_JSON: Final = 512 * 1024**2
_SENSORS: Final = ("gyroscope", "gyroscopeuncalibrated", "gyro", "imu")
"""Values of the key "sensor" in JSON whose rows are body rates, in the order in which they are taken."""


def read_array_export(path: Path, options: ReadingOptions) -> Dataset:
    """Data set of the arrays that describe a motion."""
    suffix, names = path.suffix.lower(), options.column_names
    is_json = suffix in (".json", ".jsonl", ".ndjson", *YAML)
    taken = ("unit", "clock", "rate", "columns", *(["topic"] if is_json else []))
    options.require_only(taken, "a file of arrays")
    require_file(path, LARGEST)
    columns = _json(path, options) if is_json else _READERS[suffix](path, names)
    bare = "rate" if is_json or names else bare_quantity(path)
    return motion_dataset(path, path.name, motion_of(columns, replace(options, topic=None), bare))


def _npy(path: Path, stated: Sequence[str]) -> ArrayColumns:
    """The array of an .npy, of records the columns of its fields. InputError: objects in it, more numbers than it holds."""
    with _refused_if_damaged(path, "is no .npy of plain numbers", "save it with numpy.save"):
        with open(path, "rb") as stream:
            _require_numbers(stream, path.stat().st_size)
        array = np.load(path, allow_pickle=False)
    if array.dtype.names is None:
        return _columns_of(path, {path.stem: array}, stated)
    return _columns_of(path, {name: array[name] for name in array.dtype.names}, stated)


def _npz(path: Path, stated: Sequence[str]) -> ArrayColumns:
    """Arrays of an .npz. InputError: objects in it, or more numbers than are read."""
    with _refused_if_damaged(path, "is no .npz of plain arrays", "save it with numpy.savez"):
        with zipfile.ZipFile(path) as archive:
            require_size(path, sum(member.file_size for member in archive.infolist()))
            for member in archive.infolist():
                if member.filename.endswith(".npy"):
                    _require_whole(archive, member)
        with np.load(path, allow_pickle=False) as members:
            arrays = {name: members[name] for name in members.files}
    return _columns_of(path, arrays, stated)


@contextmanager
def _refused_if_damaged(path: Path, what: str, cure: str) -> Iterator[None]:
    """Turn whatever a parser raises into one InputError: what it raises of damaged bytes is not documented."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{path_text(path)}: {what} ({reason(error)}); {cure}") from None


def _require_whole(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> None:
    """Raise ValueError where an array states more numbers than it holds, before memory is taken for them."""
    with archive.open(member) as stream:
        _require_numbers(stream, member.file_size)


def _require_numbers(stream: IO[bytes], size: int) -> None:
    """Raise ValueError where an array of a file of this size, in bytes, states more numbers than fit into it."""
    version = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, kind = read(stream)
    if min(shape, default=0) < 0 or math.prod(shape) * kind.itemsize > size:
        raise ValueError(f"an array states the shape {value_text(shape)}, more numbers than it holds")


def _mat(path: Path, stated: Sequence[str]) -> ArrayColumns:
    """Arrays of a .mat of any version, and those of its structures by name."""
    content = read_bytes(path, LARGEST)
    if content.startswith(MATLAB_HDF5):
        return _hdf5(path, stated)
    with _refused_if_damaged(path, "is no whole .mat", "save it in MATLAB with save(..., '-v7')"):
        held = matlab_variables(path, content)
        variables = modelica_result(held)
    if variables is not None:
        return array_columns(variables, path)
    return _columns_of(path, _by_last_name(with_one_clock(arrays_of_structures(held))), stated)


def _by_last_name(arrays: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
    """Arrays without the names of the structures that hold them, unless two structures have a field of one name."""
    last = [name.rsplit(".", 1)[-1] for name in arrays]
    return dict(zip(last, arrays.values(), strict=True)) if len(set(last)) == len(last) else arrays


def _hdf5(path: Path, stated: Sequence[str]) -> ArrayColumns:
    """Arrays of an HDF5 file, such as a .mat of version 7.3, and those of its groups by name.

    MATLAB keeps arrays column by column, so that HDF5 sees them transposed. Links to other files are not followed.
    """
    try:
        import h5py
    except ImportError:
        raise InputError(
            f"{path_text(path)}: HDF5 (a .mat of version 7.3 is one) needs the package h5py; install it with "
            "pip install 'spinfilters[hdf5]', or save it in MATLAB with save(..., '-v7')"
        ) from None
    is_matlab = path.suffix.lower() == ".mat"
    with _refused_if_damaged(path, "is no whole HDF5 file", "save it again"), h5py.File(path, "r") as file:
        sets = _number_sets(file)
        require_size(path, sum(8 * each.size for each in sets.values()))
        arrays = {
            f"{name}{_stated_order(each)}{_stated_unit(each)}": np.asarray(each[()])
            for name, each in sets.items()
        }
    arrays = _parted_records(arrays)
    if is_matlab:
        arrays = {name: array.T for name, array in arrays.items()}
    return _columns_of(path, _by_last_name(arrays), stated)


def _parted_records(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Arrays, those of records as the arrays of their fields of numbers."""
    found: dict[str, np.ndarray] = {}
    for name, array in arrays.items():
        fields = array.dtype.names
        own = {name: array} if fields is None else {f"{name}.{field}": array[field] for field in fields}
        found |= {each: held for each, held in own.items() if held.dtype.kind in "iuf"}
    return found


_NO_UNIT: Final = frozenset({"", "1", "-", "none", "unitless", "dimensionless", "n/a"})
_UNIT: Final = re.compile(r" \([^()]*\)$")
_LENGTH: Final = re.compile(r"(p|pos|position|loc|location|trans|translation)_([cm]?m)", re.IGNORECASE)
"""A position with its unit behind, which belongs behind the axis of a component."""


def _stated_unit(dataset: Any) -> str:
    """Unit of a data set in brackets, known here or not, as its attribute says; empty without one."""
    for name in ("Units", "units", "Unit", "unit"):
        unit = getattr(dataset, "attrs", dataset.__dict__).get(name)
        unit = unit.decode("utf-8", "replace") if isinstance(unit, bytes) else unit
        if isinstance(unit, str) and unit.lower() not in _NO_UNIT:
            return f" ({re.sub(r'[()]', '', unit.partition(' since ')[0])[:20]})"
    return ""


def _stated_order(dataset: Any) -> str:
    """Order of the components of a quaternion, behind a name, as an attribute of the data set says; empty without one."""
    for name in ("order", "convention", "components", "layout"):
        stated = dataset.attrs.get(name)
        stated = stated.decode("utf-8", "replace") if isinstance(stated, bytes) else stated
        letters = "".join(str(each) for each in stated) if isinstance(stated, np.ndarray) else stated
        if isinstance(letters, str) and (order := re.sub(r"[^a-z]", "", letters.lower())) in ("wxyz", "xyzw"):
            return f"_{order}"
    return ""


def _component(name: str, axis: str) -> str:
    """Name of a component, in front of the unit of the vector."""
    if (length := _LENGTH.fullmatch(name)) is not None:
        return f"{length[1]}{axis} ({length[2]})"
    unit = _UNIT.search(name)
    return f"{name}{axis}" if unit is None else f"{name[: unit.start()]}{axis}{unit[0]}"


def _number_sets(group: Any, before: str = "") -> dict[str, Any]:
    """Data sets of numbers within a group and its groups, by their names with dots; neither links nor data in other files."""
    import h5py

    found: dict[str, Any] = {}
    for name in group:
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue  # "#refs#" holds the cells of MATLAB
        held, kind = group[name], group.get(name, getclass=True)
        if kind is h5py.Group and before.count(".") < DEEPEST_GROUP:
            found |= _number_sets(held, f"{before}{name}.")
        elif kind is h5py.Dataset and (held.dtype.kind in "iuf" or held.dtype.names) and held.shape:
            is_text = bytes(held.attrs.get("MATLAB_class", b"")) == b"char"
            found |= {} if held.is_virtual or held.external or is_text else {f"{before}{name}": held}
    return found


def _netcdf(path: Path, stated: Sequence[str]) -> ArrayColumns:
    """Variables of a NetCDF file, of version 4 as of the HDF5 that it is."""
    from scipy.io import netcdf_file

    content = read_bytes(path, LARGEST)
    if content.startswith(b"\x89HDF"):
        return _hdf5(path, stated)
    with (
        _refused_if_damaged(path, "is no whole NetCDF file", "save it again"),
        netcdf_file(path, mmap=False) as file,
    ):
        require_size(path, sum(8 * math.prod(each.shape) for each in file.variables.values()))
        arrays = {f"{name}{_stated_unit(each)}": np.array(each.data) for name, each in file.variables.items()}
    arrays = {name: array.astype(array.dtype.newbyteorder("=")) for name, array in arrays.items()}
    return _columns_of(
        path, {name: each for name, each in arrays.items() if each.dtype.kind in "iuf"}, stated
    )


def _feather(path: Path, stated: Sequence[str]) -> ArrayColumns:
    """Columns of numbers of a Feather or Arrow file, which have names."""
    try:
        from pyarrow import ipc
    except ImportError:
        raise InputError(
            f"{path_text(path)}: Feather needs the package pyarrow; install it with pip install 'spinfilters[campaign]'"
        ) from None
    with _refused_if_damaged(path, "is no whole Feather file", "write it again"), ipc.open_file(path) as file:
        kept = [k for k, field in enumerate(file.schema) if _is_number(str(field.type))]
        table = file.read_all().select(kept)
        require_size(path, 8 * table.num_rows * len(kept))
        arrays = {
            name: _numbers_of_column(column)
            for name, column in zip(table.column_names, table.columns, strict=True)
        }
    return _columns_of(path, arrays, stated)


def _parquet(path: Path, stated: Sequence[str]) -> ArrayColumns:
    """Columns of a Parquet file. InputError: without pyarrow, or another file."""
    try:
        from pyarrow import ArrowException, parquet
    except ImportError:
        raise InputError(
            f"{path_text(path)}: a Parquet file needs the package pyarrow; install it with pip install 'spinfilters[campaign]'"
        ) from None
    try:
        with parquet.ParquetFile(path) as file:
            names = list(_number_fields(file.schema_arrow))
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice is not None:
                raise InputError(
                    f"{path_text(path)}: has two columns {value_text(twice)}; leave out or rename one of them"
                )
            if file.metadata.num_rows > MAX_TABLE_ROWS:
                raise InputError(
                    f"{path_text(path)}: has {file.metadata.num_rows} rows, at most {MAX_TABLE_ROWS} are read; "
                    "cut it into smaller files"
                )
            require_size(path, 8 * file.metadata.num_rows * len(names))
            table = file.read(columns=names)
        while any(str(field.type).startswith("struct<") for field in table.schema):
            table = table.flatten()
        arrays = {name: _numbers_of_column(table[name]) for name in names}
    except (ArrowException, OSError, ValueError, TypeError, OverflowError, MemoryError) as error:
        raise InputError(
            f"{path_text(path)}: is no whole Parquet file ({reason(error)}); write it again"
        ) from None
    return _columns_of(path, arrays, stated)


def _number_fields(fields: Any, before: str = "") -> Iterator[str]:
    """Names of the columns of numbers, and of the fields of numbers within columns of structures, with dots."""
    for field in fields:
        if str(field.type).startswith("struct<") and before.count(".") < DEEPEST_GROUP:
            yield from _number_fields(
                [field.type.field(k) for k in range(field.type.num_fields)], f"{before}{field.name}."
            )
        elif _is_number(str(field.type)):
            yield f"{before}{field.name}"


_IN_LISTS: Final = re.compile(r"(?:fixed_size_|large_)?list<\w+: (.*?)>(?:\[\d+\])?")
"""Arrow's name of a column of lists."""


def _numbers_of_column(column: Any) -> np.ndarray:
    """Numbers of a column of Arrow, a row for each list of a column of lists. ValueError: lists that differ in length."""
    if _IN_LISTS.fullmatch(str(column.type)) is None:
        return column.to_numpy()
    numbers = column.combine_chunks().flatten().to_numpy(zero_copy_only=False)
    if (
        not len(column)
        or len(numbers) % len(column)
        or {len(each) for each in column.to_pylist()} != {len(numbers) // len(column)}
    ):
        raise ValueError("its lists differ in length")
    return numbers.reshape(len(column), -1)


def _is_number(kind: str) -> bool:
    """Whether columns of an Arrow type are numbers or instants: of others, such as texts, a small file may unpack to any size."""
    if matched := _IN_LISTS.fullmatch(kind):
        kind = matched[1]
    return kind.startswith(("int", "uint", "float", "halffloat", "double", "timestamp", "date", "duration"))


def _json(path: Path, options: ReadingOptions) -> ArrayColumns:
    """Columns of a document in JSON or YAML, of rows of several sensors those of the gyro."""
    is_yaml = path.suffix.lower() in YAML
    document = read_yaml_rows(path) if is_yaml else parsed_json(path, read_bytes(path, LARGEST_JSON))
    if isinstance(document, dict) and isinstance(document.get("payload"), dict):
        return _edge_impulse(path, document["payload"])
    document = _of_gyro(path, document)
    table = chosen_table(path, document, options)
    names = options.column_names
    if names:
        if len(names) != len(table.columns):
            raise InputError(
                f"{path_text(path)}: its table has {len(table.columns)} columns, and the stated columns are {len(names)}; name "
                "every column, with - for those to leave out"
            )
        held = zip(names, table.columns.values(), strict=True)
        stated = {name: np.array(values, dtype=object) for name, values in held if name != "-"}
        return replace(array_columns(stated, path), rate=table.rate)
    has_seconds = "seconds_elapsed" in table.columns
    columns = {
        name: np.array(values, dtype=object)
        for name, values in table.columns.items()
        if not (has_seconds and name == "time")
    }
    return replace(array_columns(columns, path), rate=table.rate, takes_names=True)


def _of_gyro(path: Path, document: Any) -> Any:
    """A document, of a list of rows that name their sensor those of the gyro. InputError: rows of other sensors alone."""
    if not isinstance(document, list) or not all(isinstance(row, dict) for row in document):
        return document
    kinds = [printable(str(row.get("sensor", ""))).lower() for row in document]
    chosen = next((name for name in _SENSORS if name in kinds), None)
    if chosen is None and any(kinds):
        seen = ", ".join(sorted({kind for kind in kinds if kind})[:6])
        raise InputError(f"{path_text(path)}: holds {value_text(seen)} and no Gyroscope; export that sensor")
    return [row for row, kind in zip(document, kinds, strict=True) if chosen in (None, kind)]


def _edge_impulse(path: Path, payload: Mapping[str, Any]) -> ArrayColumns:
    """Columns of Edge Impulse: names and units of its sensors, a row of values every interval. InputError: other contents."""
    try:
        names = [f"{each['name']} ({each['units']})" for each in payload["sensors"]]
        values = np.array(payload["values"], dtype=np.float64).reshape(-1, len(names))
        time = 1e-3 * float(payload["interval_ms"]) * np.arange(len(values))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"{path_text(path)}: lacks sensors, values or interval_ms ({reason(error)}); export it again"
        ) from None
    return array_columns({"time (s)": time, **dict(zip(names, values.T, strict=True))}, path)


def _columns_of(path: Path, arrays: Mapping[str, Any], stated: Sequence[str] = ()) -> ArrayColumns:
    """Named columns of the arrays that are as long as the commonest; three columns of one array are its x, y, z.

    Parameters
    ----------
    stated : Sequence[str]
        Names of the columns of the one array that has as many; empty where the arrays have names.

    Raises
    ------
    InputError
        No array of numbers; none or several that have the stated columns; one array whose columns have no names.
    """
    tables = {name: np.asarray(held) for name, held in arrays.items() if np.ndim(held) == 2} if stated else {}
    if stated and any(len(stated) in array.shape for array in tables.values()):
        return _stated_columns(path, tables, stated, _clocks_of(arrays))
    if (
        not stated
        and len(arrays) == 1
        and (shape := np.shape(next(iter(arrays.values()))))
        and len(shape) == 2
        and min(shape) > 3
    ):
        rows = _rows_of(next(iter(arrays.values())))
        raise InputError(
            f"{path_text(path)}: holds one array of {shape[0]} x {shape[1]} numbers without names; {how_to_name(rows)}"
        )
    columns: dict[str, np.ndarray] = _of_matrices(path, arrays)
    for name, held in arrays.items():
        try:
            array: np.ndarray = np.asarray(held)
        except ValueError:
            continue  # lists that differ in length
        if array.ndim == 2 and 1 in array.shape:
            array = array.reshape(-1)
        if array.ndim == 2 and array.shape[1] not in (3, 4) and array.shape[0] in (3, 4):
            array = array.T  # a column for each sample, as MATLAB users keep them
        if array.ndim == 1 and array.dtype.kind in "iufmM":
            columns[name] = array
        elif array.dtype.kind in "iuf" and array.shape[1:] == (3,):
            columns |= {
                _component(name, f"_{axis}"): column for axis, column in zip("xyz", array.T, strict=True)
            }
        elif array.dtype.kind in "iuf" and array.shape[1:] == (4,):
            columns |= {_component(name, f"[{k}]"): column for k, column in enumerate(array.T)}
        elif name == "qpos" and array.shape[1:] == (7,) and np.shape(arrays.get("qvel", ()))[1:] == (6,):
            # MuJoCo's state of one free body; the rate in qvel is left out beside the pose
            columns |= dict(zip(("px", "py", "pz", "qw", "qx", "qy", "qz"), array.T, strict=True))
        elif array.dtype.kind in "iuf" and array.ndim == 2 and array.shape[1] <= _WIDEST:
            columns |= {_component(name, f" part {k}"): column for k, column in enumerate(array.T)}
    lengths = [len(column) for column in columns.values()]
    if not lengths:
        raise InputError(
            f"{path_text(path)}: holds no arrays of numbers; save a clock and body rates, or poses"
        )
    unnamed = next((held for held in arrays.values() if np.ndim(held) == 2 and min(np.shape(held)) > 4), None)
    are_clocks = all(is_clock(name) for name in columns if " part " not in name)
    if unnamed is not None and are_clocks and not stated:
        raise InputError(
            f"{path_text(path)}: does not say what the {min(np.shape(unnamed))} numbers of each sample are; "
            f"{how_to_name(_rows_of(unnamed))}"
        )
    commonest = max(set(lengths), key=lambda n: (lengths.count(n), n))
    columns = {k: column for k, column in columns.items() if len(column) == commonest}
    if not stated:
        return replace(array_columns(columns, path), takes_names=True)
    if len(stated) != len(columns):
        raise InputError(
            f"{path_text(path)}: the stated columns are {len(stated)}, its arrays have {len(columns)}, and none has as many as are "
            "stated; name every column, with - for those to leave out"
        )
    kept = {name: column for name, column in zip(stated, columns.values(), strict=True) if name != "-"}
    return array_columns(kept, path)


_WIDEST: Final = 16
"""Numbers of a row of an array that may have names of their own."""
_MATRICES: Final = ((3, 3), (3, 4), (4, 4))
_TO_BODY: Final = re.compile(
    r"dcm|inv|view|extrinsic|(?<![a-z])[bc]_?(?:n|i|w|wi|eci|world)(?![a-z])|(?:body|cam(?:era)?)_?(?:from|world|inertial|n)",
    re.IGNORECASE,
)
"""Within the name of a matrix that maps to the body, or may do so."""
_DIGITS: Final = 1e-3
"""Of R R', which the digits of a text cause at most."""


def _of_matrices(path: Path, arrays: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Elements by name of the only array of rotations, or of rigid transformations, from body to inertial axes; none of others.

    InputError: a matrix that may map to the body, and no other array of a motion.
    """
    found: dict[str, np.ndarray] = {}
    for name, held in arrays.items():
        if np.ndim(held) != 3 or np.asarray(held).dtype.kind != "f":
            continue
        array: Any = np.asarray(held)
        if array.shape[1:] not in _MATRICES and array.shape[:2] in _MATRICES:
            array = np.moveaxis(array, -1, 0)  # as MATLAB users keep them
        R = array[:, :3, :3]
        if (
            array.shape[1:] not in _MATRICES
            or not (np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)) < _DIGITS).all()
        ):
            continue
        if _TO_BODY.search(name) and not any(map(_is_rate_or_quaternion, arrays)):
            raise InputError(
                f"{path_text(path)}: array {value_text(name)} may map from inertial to body axes; save its transposes as R_IB, or "
                "its inverses as T_IB, which map from body to inertial axes"
            )
        if found or _TO_BODY.search(name) or (np.linalg.det(R) < 0).any():
            return {}
        _, rows, columns = array.shape
        found = {f"T_{i}{j}": array[:, i, j] for i in range(rows) for j in range(columns)}
    return found


def _is_rate_or_quaternion(name: str) -> bool:
    """Whether an array is called as a vector of rates or a quaternion."""
    named = [name, *(f"{name}_{axis}" for axis in "xw")]
    return any(map(is_of_motion, named))


def _rows_of(array: Any) -> np.ndarray:
    """A row of an array for each sample, of which there are more than numbers in one."""
    rows = np.asarray(array)
    return (rows.T if rows.shape[1] > rows.shape[0] else rows).astype(np.float64)


def _clocks_of(arrays: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Arrays of one column that are called as clocks are."""
    return {
        name: np.ravel(held)
        for name, held in arrays.items()
        if is_clock(name) and np.size(held) == max(np.shape(held), default=0)
    }


def _stated_columns(
    path: Path,
    tables: Mapping[str, np.ndarray],
    stated: Sequence[str],
    clocks: Mapping[str, np.ndarray] = MappingProxyType({}),
) -> ArrayColumns:
    """The columns, or rows, of the one array that has as many as names are stated, with a clock of as many rows beside it.

    Raises
    ------
    InputError
        No array, or several, have as many columns or rows.
    """
    fitting = {
        name: array if array.shape[1] == len(stated) else array.T
        for name, array in tables.items()
        if array.dtype.kind in "iuf" and len(stated) in array.shape
    }
    if len(fitting) != 1:
        raise InputError(
            f"{path_text(path)}: the stated columns are {len(stated)}, and {len(fitting) or 'none'} of its arrays have as many; "
            "name every column, with - for those to leave out, or save one array"
        )
    (array,) = fitting.values()
    kept = {name: column for name, column in zip(stated, array.T, strict=True) if name != "-"}
    if not any(map(is_clock, kept)):
        kept |= {name: clock for name, clock in clocks.items() if len(clock) == len(array)}
    return array_columns(kept, path)


_READERS: Final = {
    ".npy": _npy,
    ".npz": _npz,
    ".nc": _netcdf,
    ".feather": _feather,
    ".arrow": _feather,
    ".mat": _mat,
    ".h5": _hdf5,
    ".hdf5": _hdf5,
    ".parquet": _parquet,
    ".pq": _parquet,
}
"""By suffix."""
