"""Validated reading of untrusted files: texts, bounds of tables, and TOML.

Every error of the readers is one line that names the file, the line or value, and the cure; `path_text` and
`value_text` keep it one printable line whatever a file name or a cell contains.

Python's list of filters belongs to the whole process. Two threads that exchange it and put it back in turn would leave the wrong
one after, so only one of them does so at a time.
"""

import math
import os
import re
import reprlib
import stat
import threading
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final

from spinfilters.core.errors import InputError

MAX_TABLE_BYTES: Final[int] = 2 * 1024**3
"""Largest table that is read (2 GiB): an hour of stereo tracks is a tenth of it."""
MAX_TABLE_ROWS: Final[int] = 20_000_000
"""Most lines of a table that are read: above it the numbers alone would take gigabytes."""
MAX_SETTINGS_BYTES: Final[int] = 1024**2
"""Largest TOML, YAML or segment file that is read (1 MiB)."""
MAX_LINE_BYTES: Final[int] = 1024**2
"""A table whose line is longer is no table of measurements."""

_MOST_DOTS = 64  # on a TOML line: tomllib takes memory as the square of the parts of a dotted key

_QUOTED = re.compile(r'"(?:[^"\\]|\\.)*"|\'[^\']*\'')

_REPR = reprlib.Repr()
_REPR.maxstring = _REPR.maxother = _REPR.maxlong = 60
_REPR.maxlevel = 3


def path_text(path: Path) -> str:
    """The path as one printable line: control characters and undecodable bytes are escaped."""
    return printable(str(path))


def printable(text: str) -> str:
    """A text as one line that every terminal and file can hold."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def value_text(value: object) -> str:
    """The value as one line of at most about 60 characters."""
    try:
        return "".join(c if c.isprintable() else " " for c in _REPR.repr(value))
    except ValueError:  # an integer of more digits than Python prints
        return "a number too long to show"


def reason(error: Exception) -> str:
    """One-line message of a system's or parser's error, such as 'Permission denied', of at most 200 characters."""
    text = (error.strerror if isinstance(error, OSError) else None) or str(error)
    return "".join(c if c.isprintable() else " " for c in " ".join(text.split())[:200])


def require_file(path: Path, max_bytes: int) -> int:
    """Size of a regular, readable, non-empty file in bytes.

    Raises
    ------
    InputError
        Missing, a directory, a device or pipe, not readable, empty, or larger than `max_bytes`.
    """
    try:
        status = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{path_text(path)}: no such file; check the path") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path_text(path)}: cannot be opened ({reason(error)}); check the path") from None
    if stat.S_ISDIR(status.st_mode):
        raise InputError(f"{path_text(path)}: is a directory, expected a file; give the file inside it")
    if not stat.S_ISREG(status.st_mode):
        raise _no_file(path)
    if not os.access(path, os.R_OK):
        raise InputError(f"{path_text(path)}: permission denied; make the file readable (chmod u+r)")
    if status.st_size == 0:
        raise InputError(f"{path_text(path)}: is empty (0 bytes); export or copy it again")
    if status.st_size > max_bytes:
        raise InputError(
            f"{path_text(path)}: has {status.st_size} bytes, at most {max_bytes} are read; "
            "cut it into smaller files"
        )
    return status.st_size


def largest_unpacked(packed: int) -> int:
    """Bytes that a packed file of so many bytes may unpack to: measurements shrink to a third, bombs to a thousandth."""
    return (64 << 20) + 100 * packed


def read_bytes(path: Path, max_bytes: int, may_be_empty: bool = False) -> bytes:
    """Content of a regular file of at most so many bytes.

    It never blocks: a pipe, socket or device is refused, even one that replaces the file after it was examined.

    Raises
    ------
    InputError
        As `require_file`; it cannot be read.
    """
    if not (may_be_empty and os.path.isfile(path) and os.path.getsize(path) == 0):
        require_file(path, max_bytes)
    try:
        with open(os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK), "rb") as stream:
            status = os.fstat(stream.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise _no_file(path)
            # Python takes memory for as many bytes as it is asked for, not for those that are there
            data = stream.read(min(status.st_size, max_bytes) + 1)
            if len(data) > status.st_size:
                data += stream.read(max_bytes + 1 - len(data))
    except OSError as error:
        raise InputError(f"{path_text(path)}: cannot be read ({reason(error)}); copy it again") from None
    if len(data) > max_bytes:
        raise InputError(f"{path_text(path)}: grows while it is read; give a file that is finished")
    return data


def first_bytes(path: Path, count: int) -> bytes:
    """Begin of a regular file, of at most so many bytes; none of anything else or of what cannot be read. It never blocks."""
    try:
        with open(os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK), "rb") as stream:
            return stream.read(count) if stat.S_ISREG(os.fstat(stream.fileno()).st_mode) else b""
    except (OSError, ValueError):  # a path with a NUL
        return b""


def _no_file(path: Path) -> InputError:
    return InputError(f"{path_text(path)}: is a device or pipe, expected a file; copy its content to a file")


def parse_number(text: str | bytes) -> float:
    """Number of a text of any length, nearest float64. ValueError: no number, or one in Python's own notation (1_0).

    Arrays of fixed-width text cut long numbers off in silence, so that readers take this instead.
    """
    odd = "_" in text if isinstance(text, str) else b"_" in text
    if odd or not text.isascii():
        raise ValueError(f"{value_text(text)} is no number")
    try:
        return float(text)
    except ValueError:
        if isinstance(text, str) and _FORTRAN.fullmatch(text.strip()):
            return float(text.lower().replace("d", "e"))
        raise ValueError(f"{value_text(text)} is no number") from None


_FORTRAN: Final = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)[dD][-+]?\d{1,3}")
"""A number of double precision as Fortran writes it: 0.25D+01."""


def is_number(text: str) -> bool:
    """Whether a text is a number, see `parse_number`."""
    try:
        parse_number(text)
    except ValueError:
        return False
    return True


def finite_numbers(cells: Iterable[str]) -> list[float]:
    """Numbers of cells; none of them where one is no finite number."""
    try:
        numbers = [parse_number(cell) for cell in cells]
    except ValueError:
        return []
    return numbers if all(map(math.isfinite, numbers)) else []


def first_text(path: Path, size: int) -> str:
    """Text of the first bytes of a file, by which a reader recognises it; empty of one that cannot be opened, or a device."""
    return first_bytes(path, size).decode("utf-8", "replace")


def require_folder(path: Path) -> None:
    """Raise InputError unless the path is a directory whose files can be listed and opened."""
    if not os.path.isdir(path):
        raise InputError(f"{path_text(path)}: no such folder; check the path")
    if not os.access(path, os.R_OK | os.X_OK):
        raise InputError(f"{path_text(path)}: permission denied; make the folder readable (chmod u+rx)")


def require_text_table(path: Path, encoding: str = "utf-8") -> None:
    """Require a file that can be a table of text, whose rows and lines are bounded, before memory is taken for it.

    Raises
    ------
    InputError
        As `require_file`; a NUL byte, unless the encoding has them; too many rows; an endless line.
    """
    require_file(path, MAX_TABLE_BYTES)
    rows = 0
    try:
        with open(path, "rb") as stream:
            while chunk := stream.read(MAX_LINE_BYTES):
                if b"\0" in chunk and encoding.startswith("utf-8"):
                    line = rows + chunk[: chunk.index(b"\0")].count(b"\n") + 1
                    raise InputError(
                        f"{path_text(path)}: line {line}: holds NUL bytes, so it is not UTF-8 text; export it as UTF-8 text"
                    )
                breaks = max(chunk.count(b"\n"), chunk.count(b"\r"))
                if breaks == 0 and len(chunk) == MAX_LINE_BYTES:
                    raise InputError(
                        f"{path_text(path)}: has a line of more than {MAX_LINE_BYTES} bytes; give a table of numbers"
                    )
                rows += breaks
                if rows > MAX_TABLE_ROWS:
                    raise InputError(
                        f"{path_text(path)}: has more than {MAX_TABLE_ROWS} rows; cut it into smaller files"
                    )
    except OSError as error:
        raise InputError(f"{path_text(path)}: cannot be read ({reason(error)}); copy it again") from None


def read_settings_text(path: Path) -> str:
    """Text of a small settings file (TOML, YAML, segments), UTF-8 with or without byte order mark.

    Raises
    ------
    InputError
        As `require_file` with 1 MiB, or a file that is not UTF-8 text.
    """
    raw = read_bytes(path, MAX_SETTINGS_BYTES)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        byte, line = error.object[error.start], error.object.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{path_text(path)}: line {line}: byte 0x{byte:02x} is not UTF-8; save it as UTF-8 text"
        ) from None


def read_toml(path: Path) -> dict[str, Any]:
    """Document of a TOML file of at most 1 MiB, and of at most 64 dots outside quotes in a line.

    Raises
    ------
    InputError
        An unreadable file, or text that is not TOML.
    """
    import tomllib  # slow to import, and every command has this module

    text = read_settings_text(path)
    for number, line in enumerate(text.split("\n"), start=1):
        if line.count(".") > _MOST_DOTS < _QUOTED.sub("", line).count("."):
            raise InputError(
                f"{path_text(path)}: line {number}: has more than {_MOST_DOTS} dots; break that line into several"
            )
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path_text(path)}: is not TOML ({reason(error)}); correct that line") from None


_LOCK: Final = threading.RLock()


@contextmanager
def ignored_warnings(category: type[Warning]) -> Iterator[None]:
    """Within it warnings of this kind are ignored."""
    with _LOCK, warnings.catch_warnings():
        warnings.simplefilter("ignore", category)
        yield


def nearest_text(word: str, known: Iterable[str]) -> str:
    """A hint at the known word that is nearest to another, such as "did you mean mekf"; empty where none is near."""
    words = list(known)
    begun = [each for each in words if each.startswith(word) and len(word) > 2]
    near = begun if len(begun) == 1 else get_close_matches(word, words, n=1, cutoff=0.7)
    return f"did you mean {near[0]}" if near else ""


def unknown_key(shown: str, key: str, known: Iterable[str]) -> str:
    """Complaint about a key, as it is shown, with the known ones and the nearest of them."""
    names = list(known)
    meant = nearest_text(key, names)
    return f"unknown key {shown}; known are {', '.join(names)}" + (f"; {meant}" if meant else "")
