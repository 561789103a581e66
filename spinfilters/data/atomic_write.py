"""Atomic writing of files."""

import json
import math
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import tomli_w

from spinfilters.data.input_file import path_text, reason
from spinfilters.errors import InputError


@contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """Binary stream that becomes `path` when the block succeeds, else vanishes.

    The bytes go to a hidden name in the same folder, reach the disk (fsync), and then replace the target in
    one step, so a reader sees the old file or the new one.

    Raises
    ------
    InputError: disk full, no permission, no such folder, or a folder or device in the way; the target is untouched.
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
        raise InputError(
            f"{path_text(path)}: cannot be written ({reason(error)}); free disk space or choose another folder"
        ) from None
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


def write_json(path: Path, document: object) -> None:
    """Write a document as indented JSON, atomically.

    It holds dicts, lists, strings, numbers and None, with `null` for what is not finite.

    Raises
    ------
    InputError: as `atomic_file`, or a document that JSON cannot hold (an array).
    """
    try:
        text = json.dumps(_with_null(document), indent=2, allow_nan=False, ensure_ascii=False)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{path_text(path)}: JSON cannot hold this ({reason(error)}); pass plain Python values"
        ) from None
    write_text(path, text + "\n")


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
    InputError: as `atomic_file`, or a value that TOML cannot hold (None, an array).
    """
    try:
        text = tomli_w.dumps(document)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{path_text(path)}: TOML cannot hold this ({reason(error)}); pass plain Python values"
        ) from None
    write_text(path, text)


def make_folder(path: Path) -> None:
    """Create the folder and its parents; one that is there already is kept. InputError if refused."""
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
