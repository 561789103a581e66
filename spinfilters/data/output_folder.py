"""Atomic output folders that overwrite no foreign files.

A list of the files that a command wrote, with their digests, lies among them. What is not in that list, or was changed since, is
somebody else's.
"""

import hashlib
import json
import os
import re
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from spinfilters.data.atomic_write import make_folder, write_json
from spinfilters.data.input_file import path_text, read_settings_text, reason
from spinfilters.errors import InputError

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
    InputError: as `refuse_foreign`; the folder cannot be made, or its files not be replaced.
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
    except InputError as error:  # what was to be written is told by the name that it was to have
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
    InputError: the text names the first such file.
    """
    if not os.path.isdir(folder):
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
