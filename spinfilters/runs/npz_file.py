"""Named arrays of numbers and words as one .npz file, read without trusting it."""

import io
import lzma
import math
import tokenize
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import IO
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile

import numpy as np

from spinfilters.data.atomic_write import atomic_file
from spinfilters.data.ignored_warnings import ignored_warnings
from spinfilters.data.input_file import path_text, reason, require_file
from spinfilters.errors import InputError

LARGEST_FILE = 2 << 30
"""Bytes, of the file and of everything in it together."""
MOST_ARRAYS, LARGEST_RATIO, SMALL = 10_000, 50, 1 << 20
"""Bounds of what a file unpacks to: histories shrink to a third when packed, a bomb to a thousandth."""
PIECE = 1 << 17
"""Elements of an array that are written at a time."""
KINDS = "biufU"
"""Kinds of elements that a file may hold: truth values, numbers and words, never objects."""

DAMAGED = (
    OSError,
    ValueError,
    TypeError,
    KeyError,
    IndexError,
    EOFError,
    RuntimeError,  # an encrypted member; NotImplementedError and RecursionError too
    OverflowError,
    MemoryError,
    SyntaxError,
    tokenize.TokenError,
    BadZipFile,
    zlib.error,
    lzma.LZMAError,
    InputError,
)
"""What reading and interpreting a damaged or hostile file may raise; every reader makes one line of it."""


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray], compression: int = ZIP_STORED) -> None:
    """Write arrays as an .npz, atomically; an array in Fortran's order keeps it.

    Parameters
    ----------
    compression: `zipfile.ZIP_STORED`, or `zipfile.ZIP_DEFLATED` for a file that is written once.
    """
    with atomic_file(path) as stream, ZipFile(stream, "w", compression) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                _write_array(member, array)


def _write_array(member: IO[bytes], array: np.ndarray) -> None:
    """Write an array as `numpy.lib.format.write_array`, in smaller pieces."""
    header = np.lib.format.header_data_from_array_1_0(array)
    np.lib.format.write_array_header_1_0(member, header)
    flat = array.reshape(-1, order="F" if header["fortran_order"] else "C")
    for start in range(0, len(flat), PIECE):
        member.write(flat[start : start + PIECE].tobytes())


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """Arrays of a file of `write_arrays`, of limited size, nothing evaluated.

    Raises
    ------
    one of DAMAGED: missing, too large packed or unpacked, cut off, changed, of objects. Callers make `unusable` of it.
    """
    allowed = min(LARGEST_FILE, SMALL + LARGEST_RATIO * require_file(path, LARGEST_FILE))
    with ZipFile(path) as archive:
        members = archive.infolist()
        unpacked = sum(member.file_size for member in members)
        if unpacked > allowed or len(members) > MOST_ARRAYS:
            raise ValueError(f"{len(members)} arrays of {unpacked} bytes is more than such a file holds")
        if any(member.compress_type not in (ZIP_STORED, ZIP_DEFLATED) for member in members):
            raise ValueError("packed in a way that is not written here")
        return {member.filename.removesuffix(".npy"): _array(archive.read(member)) for member in members}


def unusable(path: Path, expected: str, error: Exception, cure: str) -> InputError:
    """InputError for one of `DAMAGED`."""
    own = f"{path_text(path)}: "
    if isinstance(error, InputError) and str(error).startswith(own):
        error = InputError(str(error).removeprefix(own).partition("; ")[0])
    return InputError(f"{own}is no {expected} ({reason(error)}); {cure}")


def _array(data: bytes) -> np.ndarray:
    """The array of a .npy file whose header and size agree."""
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"arrays of format {version} are not written here")
    with ignored_warnings(Warning):  # of the format of Python 2: a second line to the user
        read = (
            np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        )
        shape, fortran, dtype = read(stream)
    held = len(data) - stream.tell()
    if dtype.kind not in KINDS or any(n < 0 for n in shape) or math.prod(shape) * dtype.itemsize != held:
        raise ValueError(f"{held} bytes are no array of {shape} {dtype}")
    return np.ndarray(shape, dtype, data, stream.tell(), order="F" if fortran else "C").copy("K")
