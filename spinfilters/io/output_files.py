"""Files and folders written atomically, which overwrite nothing that somebody else wrote.

A list of the files that a command wrote, with their digests, lies among them. What is not in that list, or was changed since, is
somebody else's.
"""

import hashlib
import json
import math
import os
import re
import secrets
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, Final

import tomli_w

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text, read_settings_text, reason


@contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """Binary stream that becomes `path` when the block succeeds, else vanishes.

    The bytes go to a hidden name in the same folder, reach the disk (fsync), and then replace the target in
    one step, so a reader sees the old file or the new one.

    Raises
    ------
    InputError
        Disk full, no permission, no such folder, or a folder or device in the way; the target is untouched.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):  # a file would take the place of the device
        raise InputError(f"{path_text(path)}: is a device or a pipe, not a file; choose a file in a folder")
    temporary = path.with_name(f".{secrets.token_hex(8)}.part")
    try:
        with open(temporary, "xb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, path)
    except OSError as error:
        if error.filename not in (None, os.fspath(temporary)):
            raise  # the caller's block failed on a file of its own
        cure = "free disk space or choose another folder"
        if not os.path.lexists(path.parent):
            cure = f"make the folder {path_text(path.parent)} first"
        raise InputError(f"{path_text(path)}: cannot be written ({reason(error)}); {cure}") from None
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_bytes(path: Path, data: bytes) -> None:
    """Write the bytes (a PNG, for instance) atomically; errors as `atomic_file`."""
    with atomic_file(path) as stream:
        stream.write(data)


def write_text(path: Path, text: str) -> None:
    """Write the text as UTF-8 with line feeds, atomically; errors as `atomic_file`."""
    write_bytes(path, text.encode("utf-8"))


def write_or_print(text: str, arguments: list[str]) -> int:
    """Write a text to the file that the arguments of a command name, or print it without any; the exit code."""
    if arguments:
        write_text(Path(arguments[0]), text)
    else:
        sys.stdout.write(text)
    return 0


def write_json(path: Path, document: object) -> None:
    """Write a document as indented JSON, atomically; numbers that are not finite are written as `null`.

    Parameters
    ----------
    path : Path
        The file.
    document : object
        Dicts, lists, strings, numbers and None.

    Raises
    ------
    InputError
        As `atomic_file`, or a document that JSON cannot hold (an array).
    """
    try:
        text = json_text(document)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{path_text(path)}: JSON cannot hold this ({reason(error)}); pass plain Python values"
        ) from None
    write_text(path, text)


def json_text(document: object) -> str:
    """A document as indented JSON with a final line break; a number that is not finite becomes `null`.

    Parameters
    ----------
    document : object
        Dicts, lists, strings, numbers and None.

    Raises
    ------
    TypeError, ValueError
        A document that JSON cannot hold (an array).
    """
    return json.dumps(_with_null(document), indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _with_null(document: object) -> object:
    """The document with None for every number that is not finite."""
    if isinstance(document, dict):
        return {key: _with_null(value) for key, value in document.items()}
    if isinstance(document, list | tuple):
        return [_with_null(value) for value in document]
    return None if isinstance(document, float) and not math.isfinite(document) else document


def write_toml(path: Path, document: dict[str, Any]) -> None:
    """Write a document of tables, lists, strings, numbers and booleans as TOML, atomically.

    Raises
    ------
    InputError
        As `atomic_file`, or a value that TOML cannot hold (None, an array).
    """
    try:
        text = tomli_w.dumps(document)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{path_text(path)}: TOML cannot hold this ({reason(error)}); pass plain Python values"
        ) from None
    write_text(path, text)


FILE_SUFFIX: Final = re.compile(
    r"\.(bag|csv|h5|html|jpg|json|mat|mcap|md|npy|npz|parquet|pdf|png|rrd|svg|toml|txt|xlsx|yaml|yml|zip)",
    re.IGNORECASE,
)
"""End of the name of a file; no new folder is made by such a name, which asks for a file."""


def refuse_file_name(folder: Path) -> None:
    """Refuse the name of a file, such as ``errors.csv``, for a new folder."""
    if FILE_SUFFIX.fullmatch(folder.suffix) and not folder.exists():
        raise InputError(
            f"{path_text(folder)}: a folder is written, and this is the name of a {folder.suffix} file; give a folder, "
            f"such as {path_text(folder.with_suffix(''))}"
        )


def make_folder(path: Path) -> None:
    """Create the folder and its parents; one that is there already is kept. InputError if refused, or the name of a file."""
    refuse_file_name(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path_text(path)}: cannot be made a folder ({reason(error)}); choose another folder"
        ) from None


@contextmanager
def made_folder(path: Path) -> Iterator[None]:
    """Create the folder for a block; new ones that stay empty are removed. InputError: as `make_folder`."""
    new = [each for each in (path, *path.parents) if not each.exists()]
    make_folder(path)
    try:
        yield
    finally:
        with suppress(OSError):  # something is in it
            for each in new:
                each.rmdir()


LIST_FILE: Final[str] = ".written.json"
"""The list of the files that a command wrote into a folder."""
SCHEMA: Final[int] = 1
_NEW, _OLD = "new", "old"
_UNPUBLISHED = re.compile(rf"\.[0-9a-f]{{16}}\.part/{_NEW}/")


@contextmanager
def output_folder(folder: Path, command: str) -> Iterator[Path]:
    """Staging folder whose files replace the command's earlier ones on success.

    Until then, and when the block ends otherwise (disk full, Ctrl-C), the folder stays as it was.

    Raises
    ------
    InputError
        As `refuse_foreign`; the folder cannot be made, or its files not be replaced.
    """
    refuse_foreign(folder, command)
    target = Path(os.path.realpath(folder))
    stage = (target if target.is_dir() else target.parent) / f".{secrets.token_hex(8)}.part"
    try:
        make_folder(stage / _NEW)
        yield stage / _NEW
        digests = {name: _digest(stage / _NEW / name) for name in _files(stage / _NEW)}
        write_json(stage / _NEW / LIST_FILE, {"schema": SCHEMA, "command": command, "files": digests})
        refuse_foreign(folder, command)
        _publish(stage, target)
    except InputError as error:  # the message names the file that was to be written
        raise InputError(str(error).replace(path_text(stage / _NEW), path_text(folder))) from None
    except OSError as error:
        raise InputError(
            f"{path_text(folder)}: cannot be written ({reason(error)}); choose another folder"
        ) from None
    finally:
        shutil.rmtree(stage / _NEW, ignore_errors=True)
        with suppress(OSError):
            stage.rmdir()


def refuse_foreign(folder: Path, command: str) -> None:
    """Refuse a folder with anything in it that the command did not write.

    Raises
    ------
    InputError
        The text names the first such file.
    """
    if not os.path.isdir(folder):
        refuse_file_name(folder)
        if os.path.exists(folder):
            make_folder(folder)  # says what is in the way
        return
    digests = _written_by(folder, command)
    for name in _files(folder):
        if name != LIST_FILE and not _is_same(folder / name, digests.get(name)):
            raise InputError(
                f"{path_text(folder)}: is not empty and no result of {command} ({path_text(Path(name))} was not written by it, "
                "or was "
                "changed since); choose another folder with -o"
            )


def _written_by(folder: Path, command: str) -> Mapping[str, object]:
    """Digests, by name, of the files that a command wrote into a folder, if any."""
    try:
        document = json.loads(read_settings_text(folder / LIST_FILE))
    except (InputError, ValueError, RecursionError):
        return {}
    own = isinstance(document, dict) and (document.get("schema"), document.get("command")) == (
        SCHEMA,
        command,
    )
    files = document.get("files") if own else None
    return files if isinstance(files, dict) else {}


def _files(folder: Path) -> list[str]:
    """Names of all files and links below a folder, unfinished ones excepted."""
    found = []
    for place, folders, files in os.walk(folder):
        links = [name for name in folders if os.path.islink(os.path.join(place, name))]
        found += [os.path.relpath(os.path.join(place, name), folder) for name in (*files, *links)]
    return sorted(name for name in found if not _UNPUBLISHED.match(name))


def _is_same(path: Path, digest: object) -> bool:
    try:
        return not path.is_symlink() and path.is_file() and _digest(path) == digest
    except OSError:
        return False


def _digest(path: Path) -> str:
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _publish(stage: Path, target: Path) -> None:
    """Replace the old files by the new ones, or restore them."""
    if not target.exists():
        os.rename(stage / _NEW, target)
        return
    old = [(target / name, stage / _OLD / name) for name in _files(target)]
    new = [(stage / _NEW / name, target / name) for name in _files(stage / _NEW)]
    try:
        for source, place in (*old, *new):
            make_folder(place.parent)
            os.rename(source, place)
    except BaseException:
        for source, place in reversed([*old, *new]):
            if not os.path.lexists(source):
                make_folder(source.parent)
                os.rename(place, source)
        raise
    finally:
        _remove_empty(stage / _OLD)
    shutil.rmtree(stage / _OLD, ignore_errors=True)
    _remove_empty(target)


def _remove_empty(folder: Path) -> None:
    """Remove folders without files, from the bottom up."""
    for place, _, _ in os.walk(folder, topdown=False):
        with suppress(OSError):
            os.rmdir(place)
