"""Exclusive lock of a run folder, released when its process ends."""

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text, reason

LOCK_FILE: Final[str] = ".lock"
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL)
"""What a file system without locks (some network ones) says: the run goes on without."""


@contextmanager
def locked_run(folder: Path) -> Iterator[None]:
    """Hold a run folder, which exists, while the block runs; for all that writes into it.

    Raises
    ------
    InputError
        Another process holds it, or the lock cannot be written.
    """
    path = folder / LOCK_FILE
    try:
        held = _locked(path)
        while held is not None and not _is_at(path, held):  # its last holder removed it meanwhile
            os.close(held)
            held = _locked(path)
    except BlockingIOError:
        raise InputError(
            f"{path_text(folder)}: another run is writing into it; wait until it ends, or choose another folder with -o"
        ) from None
    except OSError as error:
        raise InputError(
            f"{path_text(path)}: cannot be written ({reason(error)}); free disk space or choose another folder"
        ) from None
    try:
        yield
    finally:
        with suppress(OSError):
            path.unlink()
        if held is not None:
            os.close(held)


def _locked(path: Path) -> int | None:
    """Descriptor of the file, locked; None where the file system has no locks."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(descriptor)
        if error.errno not in _NO_LOCKS:
            raise
        return None
    return descriptor


def _is_at(path: Path, descriptor: int) -> bool:
    """Whether this very file is still there."""
    with suppress(FileNotFoundError):
        return os.path.samestat(os.stat(path, follow_symlinks=False), os.fstat(descriptor))
    return False
