"""Hostile files of arrays, flight logs, references and settings: bombs, pickles, nesting, doubled names, impossible numbers.

python -m tests.hostile.containers --verbose
"""

import io
import json
import os
import pickle
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from .attacks import no_files
from .campaign import campaign, parser
from .case import COMPARE, Case
from .changes import Change, Data, both, bytes_of, content, instead

TIME = np.arange(20) * 0.1
RATES = np.column_stack([np.ones(20), 0.1 * TIME, np.full(20, 0.3)])
COLUMNS = {"time_s": TIME, "wx": RATES[:, 0], "wy": RATES[:, 1], "wz": RATES[:, 2]}


def container_cases() -> Iterator[Case]:
    """Files of arrays, PX4 logs, references, settings, and arguments of small commands."""
    kinds: dict[str, Mapping[str, Data]] = {
        "npz": _npzs(),
        "mat": _mats(),
        "parquet": _parquets(),
        "json": _jsons(),
        "ulg": _ulogs(),
    }
    for suffix, files in kinds.items():
        arguments = ("compare", "{in}/x." + suffix, *COMPARE[2:])
        for what, data in files.items():
            yield Case(f"{suffix}: {what}", "gyro", content(f"x.{suffix}", data), arguments)
        for what, build in no_files().items():
            yield Case(f"{suffix} is {what}", "gyro", instead(f"x.{suffix}", build), arguments)
    yield from _references()
    yield from _settings()
    yield from _small_commands()


# Arrays of NumPy


def _npz(members: Mapping[str, bytes], packing: int = zipfile.ZIP_STORED) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", packing) as archive:
        for name, data in members.items():
            archive.writestr(f"{name}.npy", data)
    return stream.getvalue()


def _npy(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def _npy_stating(shape: str, kind: str = "'<f8'", body: bytes = bytes(160)) -> bytes:
    """An array whose header states something."""
    head = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    head += b" " * (63 - (len(head) + 10) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + body


class _Shell:
    """Makes a file when it is unpickled."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.system, ("touch ../in/broken-into",)


def _npzs() -> dict[str, Data]:
    table = {name: _npy(column) for name, column in COLUMNS.items()}
    packed = bytearray(_npz(table, zipfile.ZIP_DEFLATED))
    place = packed.index(b"time_s.npy") + 40
    packed[place : place + 20] = bytes(255 - byte for byte in packed[place : place + 20])
    objects = io.BytesIO()
    np.save(objects, np.array([_Shell()] * 20, dtype=object), allow_pickle=True)
    return {
        "an array of objects": _npz(table | {"wz": objects.getvalue()}),
        "a pickle": pickle.dumps(_Shell()),
        "an array alone": _npy(TIME),
        "truncated": _npz(table)[:-100],
        "corrupt deflate": bytes(packed),
        "an array of 1e15 numbers": _npz(table | {"wx": _npy_stating("(1000000000000000,)")}),
        "an array of -20 numbers": _npz(table | {"wx": _npy_stating("(-20,)")}),
        "an array of 2^70 numbers": _npz(table | {"wx": _npy_stating(f"({2**70},)")}),
        "an array of a shape of code": _npz(table | {"wx": _npy_stating("(__import__('os').getpid(),)")}),
        "an array of a shape nested without end": _npz(table | {"wx": _npy_stating("(" * 5000)}),
        "an array of a kind that is none": _npz(table | {"wx": _npy_stating("(20,)", "'<q99'")}),
        "an array of records": _npz(table | {"wx": _npy_stating("(20,)", "[('a', '<f8')]")}),
        "an array of texts": _npz(table | {"wx": _npy(np.array(["x"] * 20))}),
        "an array of complex numbers": _npz(table | {"wx": _npy(RATES[:, 0] + 1j)}),
        "an array without axes": _npz(table | {"wx": _npy(np.array(3.0))}),
        "an array of eight axes": _npz(table | {"wx": _npy(np.ones((20,) + (1,) * 7))}),
        "an empty array": _npz(table | {"wx": _npy(np.empty(0))}),
        "a bomb of 1.9 GB": lambda: _npz(
            table | {"other": _npy_stating("(237500000,)", body=bytes(1_900_000_000))}, zipfile.ZIP_DEFLATED
        ),
        "NaN in the clock": _npz(table | {"time_s": _npy(np.where(TIME[5] == TIME, np.nan, TIME))}),
        "infinite rates": _npz(table | {"wy": _npy(np.full(20, np.inf))}),
        "rates of 1e308": _npz(table | {"wy": _npy(np.full(20, 1e308))}),
        "a clock that stands": _npz(table | {"time_s": _npy(np.zeros(20))}),
        "a clock of 2^63": _npz(table | {"time_s": _npy(np.arange(20, dtype=np.int64) + 2**62)}),
        "dates that are none": _npz(table | {"time_s": _npy(np.full(20, "NaT", dtype="M8[ns]"))}),
        "dates of the year 1e9": _npz(table | {"time_s": _npy(np.arange(20).astype("M8[Y]") + 10**9)}),
        "a member with ..": _npz(table | {"../../x": _npy(TIME)}),
        "a member with an escape": _npz(table | {"\x1b[2J": _npy(TIME)}),
        "10000 members": lambda: _npz({f"a{k}": b"" for k in range(10_000)}),
        "encrypted": _npz(table).replace(b"\x14\0\0\0\0\0", b"\x14\0\x01\0\0\0"),
    }


# MATLAB


def _element(kind: int, body: bytes) -> bytes:
    return struct.pack("<II", kind, len(body)) + body + bytes(-len(body) % 8)


def _matrix(name: str, kind: int, shape: tuple[int, ...], *parts: bytes) -> bytes:
    """A variable of a .mat of version 5."""
    head = _element(6, struct.pack("<II", kind, 0)) + _element(5, struct.pack(f"<{len(shape)}i", *shape))
    return _element(14, head + _element(1, name.encode()) + b"".join(parts))


def _mat(*variables: bytes) -> bytes:
    return b"MATLAB 5.0".ljust(116) + bytes(8) + struct.pack("<H", 0x0100) + b"IM" + b"".join(variables)


def _mats() -> dict[str, Data]:
    def column(name: str, values: np.ndarray, shape: tuple[int, ...] = (20, 1), kind: int = 9) -> bytes:
        return _matrix(name, 6, shape, _element(kind, values.astype("<f8").tobytes()))

    columns = [column(name, values) for name, values in COLUMNS.items()]
    inside = _matrix("", 6, (1, 1), _element(9, bytes(8)))
    cell = _element(6, struct.pack("<II", 1, 0)) + _element(5, struct.pack("<2i", 1, 1)) + _element(1, b"")
    sizes = [len(inside) + 8 * (k + 1) + len(cell) * (k + 1) - 8 for k in reversed(range(50_000))]
    nested = b"".join(struct.pack("<II", 14, size) + cell for size in sizes) + inside
    packed = zlib.compress(columns[0])

    def bomb() -> bytes:
        big = zlib.compress(_matrix("big", 6, (237_500_000, 1), _element(9, bytes(1_900_000_000))), 1)
        return _mat(*columns, struct.pack("<II", 15, len(big)) + big)

    return {
        "whole": _mat(*columns),
        "truncated": _mat(*columns)[:-90],
        "a header alone": _mat(),
        "text": b"x" * 300,
        "version 7.3": b"MATLAB 7.3".ljust(116) + bytes(8) + struct.pack("<H", 0x0200) + b"IM" + bytes(400),
        "a shape of -1": _mat(*columns, column("a", TIME, (-1, -20))),
        "a shape of 2^31": _mat(*columns, column("a", TIME, (2**31 - 1, 2**31 - 1))),
        "more numbers than there are": _mat(*columns, column("a", TIME, (2000, 1))),
        "numbers of a type that is none": _mat(*columns, column("a", TIME, kind=99)),
        "an element of 4 GB": _mat(*columns, struct.pack("<II", 14, 2**32 - 1) + bytes(100)),
        "an element of a type that is none": _mat(*columns, _element(77, bytes(80))),
        "no shape": _mat(*columns, column("a", TIME, ())),
        "a class that is none": _mat(*columns, _matrix("a", 60, (20, 1), _element(9, bytes(160)))),
        "an object": _mat(*columns, _matrix("a", 3, (1, 1), _element(1, b"inline"), _element(9, bytes(8)))),
        "cells within one another": _mat(*columns, nested),
        "a compressed element cut off": _mat(*columns[1:], _element(15, packed[:-6])),
        "a compressed element that is corrupt": _mat(
            *columns[1:], _element(15, packed[:9] + b"\xff" * 9 + packed[18:])
        ),
        "a bomb of 1.9 GB": bomb,
        "a structure of -1 letters": _mat(
            *columns, _matrix("s", 2, (1, 1), _element(5, struct.pack("<i", -1)), _element(1, b"ab"))
        ),
        "a structure of 0 letters": _mat(
            *columns, _matrix("s", 2, (1, 1), _element(5, struct.pack("<i", 0)), _element(1, b"ab"))
        ),
        "a variable twice": _mat(*columns, columns[1]),
        "version 4 of 2^31 rows": struct.pack("<5i", 0, 2**31 - 1, 2**31 - 1, 0, 2) + b"a\0" + bytes(80),
        "version 4 with a name of 2^31": struct.pack("<5i", 0, 20, 1, 0, 2**31 - 1) + b"a\0" + bytes(80),
        "version 4 with a name of -1": struct.pack("<5i", 0, 20, 1, 0, -1) + b"a\0" + bytes(80),
    }


# Parquet


def _parquets() -> dict[str, Data]:
    import pyarrow as pa
    from pyarrow import parquet

    def table(columns: dict[str, object], **options: object) -> bytes:
        stream = io.BytesIO()
        parquet.write_table(pa.table(columns), stream, **options)  # pyright: ignore[reportArgumentType]
        return stream.getvalue()

    usual = {name: pa.array(column) for name, column in COLUMNS.items()}
    whole = table(usual)
    twice = io.BytesIO()
    doubled = pa.Table.from_arrays([*usual.values(), usual["wx"]], names=[*usual, "wx"])
    parquet.write_table(doubled, twice)
    middle = len(whole) // 3

    def texts() -> bytes:
        long = pa.DictionaryArray.from_arrays(pa.array(np.zeros(2000, np.int32)), pa.array(["x" * 1_000_000]))
        return table({name: pa.array(np.arange(2000) * 0.1) for name in usual} | {"note": long})

    def zeros() -> bytes:
        column = pa.array(np.zeros(25_000_000))
        return table({f"a{k}": column for k in range(8)})

    return {
        "truncated": whole[:-20],
        "cut in the middle": whole[:middle],
        "a footer of 4 GB": whole[:-8] + b"\xff\xff\xff\xff" + whole[-4:],
        "a footer of zeros": whole[:-200] + bytes(192) + whole[-8:],
        "zeros in the middle": whole[:middle] + bytes(40) + whole[middle + 40 :],
        "a column twice": twice.getvalue(),
        "a column of nothing": table(usual | {"wx": pa.nulls(20)}),
        "a column of texts": table(usual | {"wx": pa.array(["1.0"] * 20)}),
        "a column of words": table(usual | {"wx": pa.array(["one"] * 20)}),
        "a column of lists": table(usual | {"wx": pa.array([[1.0]] * 20)}),
        "a column of structures": table(usual | {"wx": pa.array([{"a": 1.0}] * 20)}),
        "a column of decimals": table(usual | {"wx": pa.array([1] * 20).cast(pa.decimal128(30, 2))}),
        "a column of dates": table(usual | {"wx": pa.array(TIME.astype("M8[ns]"))}),
        "a clock of the year 1e5": table(
            usual | {"time_s": pa.array(np.arange(20) + 3 * 10**18, pa.timestamp("us"))}
        ),
        "a clock of dates far apart": table(
            usual | {"time_s": pa.array(np.arange(20) * 9 * 10**17, pa.timestamp("us"))}
        ),
        "no row": table({name: column[:0] for name, column in usual.items()}),
        "no column": table({}),
        "a name with an escape": table(usual | {"\x1b[2J\n": usual["wx"]}),
        "texts of 2 GB in 1 MB": texts,
        "8 columns of 2.5e7 zeros": zeros,
    }


# JSON


def _jsons() -> dict[str, str]:
    rows = [dict(zip(COLUMNS, row, strict=True)) for row in np.column_stack([TIME, RATES]).tolist()]
    lists = {name: column.tolist() for name, column in COLUMNS.items()}
    return {
        "nested without end": "[" * 200_000,
        "objects nested without end": '{"a":' * 200_000,
        "truncated": json.dumps(rows)[:-20],
        "no rows": "[]",
        "nothing": "{}",
        "a number": "3",
        "a text": '"time_s"',
        "NaN": json.dumps(rows).replace("0.3", "NaN", 1),
        "1e400": json.dumps(rows).replace("0.3", "1e400", 1),
        "a number of 4000 digits": json.dumps(rows).replace("0.3", "9" * 4000, 1),
        "a number of 5000 digits": json.dumps(rows).replace("0.3", "9" * 5000, 1),
        "a text for a number": json.dumps(rows).replace("0.3", '"x"', 1),
        "a list for a number": json.dumps(rows).replace("0.3", "[1]", 1),
        "an object for a number": json.dumps(rows).replace("0.3", '{"a": 1}', 1),
        "null for a number": json.dumps(rows).replace("0.3", "null", 1),
        "true for a number": json.dumps(rows).replace("0.3", "true", 1),
        "rows that are lists": json.dumps([[0, 1, 2, 3]] * 20),
        "rows of other names": json.dumps([*rows[:10], *({"a": 1} for _ in range(10))]),
        "names twice": json.dumps(rows).replace('"wy"', '"wx"'),
        "a name of half a surrogate": json.dumps(rows).replace('"wy"', '"\\ud800"'),
        "a sensor that is a list": json.dumps([row | {"sensor": [1]} for row in rows]),
        "a sensor of a million letters": json.dumps([row | {"sensor": "x" * 1_000_000} for row in rows[:3]]),
        "columns of lists that differ": json.dumps(lists | {"wx": [1, [2], [[3]], *[1] * 17]}),
        "columns of other lengths": json.dumps(lists | {"wx": [1, 2]}),
        "columns of objects": json.dumps(lists | {"wx": [{"a": 1}] * 20}),
        "columns of texts": json.dumps(lists | {"wx": ["1"] * 20}),
        "columns nested without end": json.dumps(lists)[:-1] + ', "b": ' + "[" * 900 + "]" * 900 + "}",
        "columns of 4000 digits": json.dumps(lists | {"wx": [10**4000] * 20}),
        "not UTF-8": '[{"a": "\udcff"}]',
    }


# Logs of PX4


def _message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def _ulog(
    fields: str = "uint64_t timestamp;float[3] xyz;",
    name: str = "vehicle_angular_velocity",
    rows: Sequence[bytes] | None = None,
    more: bytes = b"",
) -> bytes:
    if rows is None:
        rows = [struct.pack("<Q3f", 100_000 * k, *rate) for k, rate in enumerate(RATES.tolist())]
    head = b"ULog\x01\x12\x35\x01" + bytes(8) + _message("F", f"{name}:{fields}".encode())
    head += _message("A", struct.pack("<BH", 0, 7) + name.encode())
    return head + more + b"".join(_message("D", struct.pack("<H", 7) + row) for row in rows)


def _ulogs() -> dict[str, bytes]:
    whole = _ulog()
    clock = [struct.pack("<Q3f", 2**64 - 1 - k, 1, 2, 3) for k in range(20)]
    wild = [struct.pack("<Q3f", 100_000 * k, np.nan, np.inf, 1e38) for k in range(20)]
    many = "".join(f"float[9999] a{k};" for k in range(3000))
    return {
        "whole": whole,
        "a magic alone": whole[:7],
        "a header alone": whole[:16],
        "cut within a message": whole[:-5],
        "another magic": b"ULoG" + whole[4:],
        "zeros": whole[:16] + bytes(100_000),
        "messages of 65535": whole[:16] + b"\xff" * 100_000,
        "no format": _ulog(name="vehicle_angular_velocity", fields=""),
        "a format of itself": _ulog(fields="vehicle_angular_velocity a;"),
        "a format without a clock": _ulog(fields="float[3] xyz;"),
        "fields of 3e7 numbers": _ulog(fields=many),
        "a field of 0 numbers": _ulog(fields="uint64_t timestamp;float[0] a;float[3] xyz;"),
        "a field twice": _ulog(fields="uint64_t timestamp;float[3] xyz;float[3] xyz;"),
        "a clock of texts": _ulog(fields="char[8] timestamp;float[3] xyz;"),
        "a clock at 2^64": _ulog(rows=clock),
        "rates that are no numbers": _ulog(rows=wild),
        "rows too short": _ulog(rows=[b"abc"] * 20),
        "no rows": _ulog(rows=[]),
        "one row": _ulog(rows=[struct.pack("<Q3f", 0, 1, 2, 3)]),
        "a topic twice": _ulog(more=_message("A", struct.pack("<BH", 0, 7) + b"other")),
        "a topic with an escape": _ulog(name="\x1b[2J\n"),
        "a topic that is not ASCII": _ulog(more=_message("A", struct.pack("<BH", 0, 9) + b"\xff\xfe")),
    }


# References


def _references() -> Iterator[Case]:
    arguments = (*COMPARE, "--reference", "{in}/r.csv")
    header = "time_s,qx,qy,qz,qw,wx,wy,wz"
    row = "{},0,0,0,1,1,0.1,0.3"
    rows = [row.format(0.1 * k) for k in range(40)]
    texts = {
        "a header alone": header,
        "three rows": "\n".join([header, *rows[:3]]),
        "no clock": "\n".join([header.replace("time_s", "a"), *rows]),
        "a column twice": "\n".join([header.replace("qy", "qx"), *rows]),
        "a clock that stands": "\n".join([header, *[row.format(1)] * 40]),
        "a clock that runs back": "\n".join([header, *rows[::-1]]),
        "a clock of 1e300": "\n".join([header, *(row.format(1e300 * (k + 1)) for k in range(40))]),
        "a clock of 1e18": "\n".join([header, *(row.format(10**18 + k) for k in range(40))]),
        "a clock of 1e-300": "\n".join([header, *(row.format(1e-300 * k) for k in range(40))]),
        "NaN alone": "\n".join([header, *[",".join(["nan"] * 8)] * 40]),
        "rates of 1e308": "\n".join([header, *(each.replace("0.3", "1e308") for each in rows)]),
        "rates of 1e20": "\n".join([header, *(each.replace("0.3", "1e20") for each in rows)]),
        "quaternions of 0": "\n".join([header, *(each.replace(",1,", ",0,", 1) for each in rows)]),
        "words": "\n".join([header, *(each.replace("0.3", "fast") for each in rows)]),
        "rows of other lengths": "\n".join([header, *(each + ",1" * k for k, each in enumerate(rows))]),
        "an open quote": "\n".join([header, *rows, '"']),
        "a cell of 200 kB": "\n".join([header, *rows, "9" * 200_000]),
        "a number of 5000 digits": "\n".join([header, *rows, row.format("9" * 5000)]),
        "a body that rests": "\n".join([header, *(f"{0.1 * k},0,0,0,1,0,0,0" for k in range(40))]),
        "another motion": "\n".join([header, *(f"{0.1 * k},0,0,0,1,-3,2,1" for k in range(40))]),
        "zeros": "\0" * 400,
        "Motive alone": "Format Version,1.23\n",
        "Motive without a body": "Format Version,1.23,Length Units,Meters\n\n,Type\n,Name\n,ID\n,,\nFrame,Time\n0,0\n",
        "Motive of other units": "Format Version,1.23,Length Units,Parsecs\n\n,Type,Rigid Body\n"
        ",Name,a\n,ID,1\n,,Rotation\nFrame,Time,X\n0,0,0\n",
        "TUM with words": "\n".join(["0 0 0 0 0 0 0 1"] * 10 + ["x"]),
    }
    for what, text in texts.items():
        yield Case(f"reference: {what}", "gyro", content("r.csv", text + "\n"), arguments)
    yield Case(
        "reference: a million rows",
        "gyro",
        content("r.csv", lambda: "\n".join([header, *(row.format(1e-4 * k) for k in range(1_000_000))])),
        arguments,
    )
    for what, build in no_files().items():
        yield Case(f"reference is {what}", "gyro", instead("r.csv", build), arguments)
    for more in (
        "--reference {in}/gyro.csv",
        "--reference {in}",
        "--reference-shares frame",
        "--reference {in}/truth.csv --reference-shares frame,frame,origin",
        "--reference {in}/truth.csv --reference-shares x",
        "--reference {in}/truth.csv --reference-inspector {in}/truth.csv",
        "--reference {in}/truth.csv --reference-inspector {in}/gyro.csv",
        "--reference-inspector {in}/truth.csv",
    ):
        yield Case(f"reference: {more}", "gyro", _twin, (*COMPARE, *more.split()))


def _twin(folder: object) -> None:
    """Nothing: the data set holds a truth and rates."""


# Settings


def _settings() -> Iterator[Case]:
    for text in (
        "",
        "=",
        "a",
        "seed",
        "seed=",
        "=1",
        "seed=1=2",
        "seed=x",
        "seed=1e400",
        "seed=" + "9" * 5000,
        "seed=true",
        "seed=[1]",
        "seed={}",
        "seed=nan",
        "estimators=mekf",
        "estimators=[]",
        'estimators=["x"]',
        "estimators=[1, [2]]",
        "estimators=" + "[" * 50_000,
        "sensors.gyro_noise_std=-1",
        "sensors.gyro_noise_std=0",
        "sensors.gyro_noise_std=nan",
        "sensors.gyro_noise_std=1e300",
        "sensors.gyro_noise_std=1e-300",
        "sensors.gyro_noise_std='__import__(1)'",
        "sensors=1",
        "sensors.=1",
        ".sensors=1",
        "sensors..gyro_noise_std=1",
        "sensors.gyro_noise_std.x=1",
        "a" + ".a" * 40_000 + "=1",
        "sensors.gyro_noise_std=2020-01-01",
        "process.torque_psd=1e300",
        "process.torque_psd=1e-300",
        "process.rotor=3",
        "process.drag=4",
        "calibration.clock_scale_std=1e300",
        "verdict=none",
        "initialisation.mean=[1,2]",
        "initialisation.std={x=1}",
        "__class__=1",
        "seed\x1b[2J=1",
        "seed\n=1",
        "seed=1\nestimators=['x']",
        "\udcff=1",
    ):
        yield Case(f"set {text[:60]!r}", "gyro", lambda _: None, (*COMPARE, "--set", text))
    for what, text in {
        "that is not TOML": "\0",
        "nested without end": "a = " + "[" * 50_000,
        "with an unknown key": "mode = 3\n",
        "with a key of a million letters": "x" * 1_000_000 + " = 1\n",
        "with tables for values": "[estimators]\nx = 1\n",
        "with values for tables": "sensors = 1\n",
        "with a sensor's noise of NaN": "[sensors]\ngyro_noise_std = nan\n",
        "with an escape": '"\\u001b[2J" = 1\n',
        "not UTF-8": "\udcff = 1\n",
        "of 2 MB": "# x\n" * 500_000,
    }.items():
        yield Case(f"spinfilters.toml {what}", "gyro", content("../out/spinfilters.toml", text), COMPARE)
    for what, build in no_files().items():
        change: Change = instead("../out/spinfilters.toml", build)
        yield Case(f"spinfilters.toml is {what}", "gyro", change, COMPARE)


# Small commands


def _small_commands() -> Iterator[Case]:
    for words in (
        "polhode --moments 1 1 3",
        "polhode --moments 0 0 0",
        "polhode --moments -1 -1 -1",
        "polhode --moments 1 1 1",
        "polhode --moments 1 1 1e-300",
        "polhode --moments 1e308 1e308 1e308",
        "polhode --moments 1e-308 1e-308 1e-308",
        "polhode --moments nan 1 1",
        "polhode --moments inf inf inf",
        "polhode --moments 1 0.5 0.5",
        "polhode --moments 1 1 2",
        "polhode --moments 1 1.0000000000000002 1",
        "polhode --moments 3 2 1 --rate-rpm 0 0 0",
        "polhode --moments 3 2 1 --rate-rpm 1e300 0 0",
        "polhode --moments 3 2 1 --rate-rpm 1e-300 1e-300 1e-300",
        "polhode --moments 3 2 1 --rate-rpm nan 0 0",
        "polhode --moments 3 2 1 --rate-rpm 0 10 0",
        "polhode --moments 3 2 1 --rate-rpm 0 10 1e-300",
        "polhode --moments 3 2 1 --duration 1e300",
        "polhode --moments 3 2 1 --duration 1e-300",
        "polhode --moments 3 2 1 --duration 0",
        "polhode --moments 3 2 1 --duration -1",
        "polhode --moments 3 2 1 --duration nan",
        "polhode --moments 3 2 1 --rate-rpm 1e6 1e6 1e6 --duration 1e6",
        "polhode --moments 1e-9 1 1 --rate-rpm 1000 0 1000",
        "threshold --mass 0",
        "threshold --mass -1",
        "threshold --mass nan",
        "threshold --mass 1e300 --force 1e-300",
        "threshold --force 1e300",
        "threshold --radius 1e-300",
        "threshold --radius 1e300",
        "threshold --mass-fraction 0",
        "threshold --mass-fraction 1",
        "threshold --mass-fraction 1e-300",
        "threshold --mass-fraction 2",
        "threshold --specific-impulse 1e300",
        "threshold --duration 1e-300",
        "threshold --duration 1e300 --mass-fraction 1e-9",
        "threshold --rate-rpm 1e300",
        "threshold --rate-rpm 0",
        "threshold --mission moon",
        "reproduce nothing",
        "reproduce",
        "reproduce list -o /dev/null",
        "reproduce ../../etc/passwd",
    ):
        name, *rest = words.split()
        output = () if "-o" in rest else ("-o", "{out}/made")
        yield Case(words, "gyro", lambda _: None, (name, *rest, *output))
    yield Case(
        "reproduce: damaged results",
        "gyro",
        both(content("../out/made/results.json", "["), content("../out/made/x", "y")),
        ("reproduce", "tweddle-table-1.1", "-o", "{out}/made"),
    )
    yield Case(
        "columns without end",
        "gyro",
        bytes_of("gyro.csv", lambda data: data.split(b"\n", 1)[1]),
        ("compare", "{in}/gyro.csv", *COMPARE[2:], "--columns", "t," * 50_000),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Try them all; exit code 1 where one did what it must not."""
    assert __doc__ is not None
    return campaign(
        "tests.hostile.containers", list(container_cases()), parser(__doc__).parse_args(arguments)
    )


if __name__ == "__main__":
    raise SystemExit(main())
