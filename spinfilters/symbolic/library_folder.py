"""Private folder of compiled libraries.

Whoever can write there runs code as its user, so it is the user's alone or not used.

Nobody but the user (and root, who may do anything) can then put a file there or exchange one between a look at it and its use.
"""

import os
import shutil
import stat
import time
from pathlib import Path
from typing import Final

import platformdirs

OWN_FOLDER, OWN_FILE = 0o700, 0o600
"""Permissions given to what is made here, whatever the umask."""
OTHERS_WRITE: Final = stat.S_IWGRP | stat.S_IWOTH
LARGEST_LIBRARY: Final = 1 << 26
"""Bytes, a hundred times the largest that is built here: a larger file is not read into memory."""
UNFINISHED: Final = "building-"
"""How folders of builds in progress begin."""
ABANDONED: Final = 3600.0
"""Age from which a build in progress has been killed, s: none is allowed more than a few minutes."""


def cache_folder() -> Path | None:
    """Folder of compiled libraries.

    ``$SPINFILTERS_CACHE`` or the user's cache folder; None for a user without a home.
    """
    chosen = os.environ.get("SPINFILTERS_CACHE")
    if chosen:
        return Path(os.path.abspath(chosen))
    try:
        folder = Path(platformdirs.user_cache_dir("spinfilters"))
    except RuntimeError:
        return None
    return folder if folder.is_absolute() else None


def private_folder() -> Path:
    """The cache folder, made if need be, links above it followed.

    Raises
    ------
    OSError: there is none, it cannot be made, or others could write into it or put another in its place; the text says which.
    """
    wanted = cache_folder()
    if wanted is None:
        raise FileNotFoundError("this user has no home folder")
    folder = Path(os.path.realpath(wanted.parent)) / wanted.name
    _require_private(folder)
    for place in (*reversed(folder.parents), folder):
        if not place.exists():
            _make(place)
    _require_private(folder)
    return folder


def _make(folder: Path) -> None:
    try:
        folder.mkdir(mode=OWN_FOLDER)
    except FileExistsError:  # another process was quicker
        return
    folder.chmod(OWN_FOLDER)


def is_own_library(path: Path) -> bool:
    """Whether a file is regular, of one name, and writable by the user only."""
    found = path.lstat()
    return (
        stat.S_ISREG(found.st_mode)
        and found.st_uid == os.geteuid()
        and not found.st_mode & OTHERS_WRITE
        and found.st_nlink == 1
        and found.st_size <= LARGEST_LIBRARY
    )


def remove_abandoned_builds(folder: Path) -> None:
    """Delete what builds left behind that were killed."""
    for scratch in folder.glob(f"{UNFINISHED}*"):
        if time.time() - scratch.lstat().st_mtime > ABANDONED:
            shutil.rmtree(scratch, ignore_errors=True)


def _require_private(folder: Path) -> None:
    """Check the parts of the path that are there."""
    if os.name != "posix":
        raise PermissionError("who may write into a folder is not known on this system")
    for place in (folder, *folder.parents):
        try:
            found = place.lstat()
        except FileNotFoundError:
            continue
        why = _shared_folder(found) if place == folder else _exchangeable(found)
        if why is not None:
            raise PermissionError(f"{place} {why}")


def _shared_folder(found: os.stat_result) -> str | None:
    """Why others could have written into the cache folder, or None."""
    if not stat.S_ISDIR(found.st_mode):
        return "is a link" if stat.S_ISLNK(found.st_mode) else "is no folder"
    if found.st_uid != os.geteuid():
        return "belongs to another user"
    return "can be written by others" if found.st_mode & OTHERS_WRITE else None


def _exchangeable(found: os.stat_result) -> str | None:
    """Why others could rename what lies in a folder above the cache folder, or None."""
    if not stat.S_ISDIR(found.st_mode):
        return "is no folder"
    if found.st_uid not in {0, os.geteuid()}:
        return "belongs to another user"
    if found.st_mode & stat.S_ISVTX or not found.st_mode & OTHERS_WRITE:
        return None
    if found.st_mode & stat.S_IWOTH or not _has_one_member(found.st_gid):
        return "can be written by others"
    return None


def _has_one_member(group: int) -> bool:
    """Whether a group is the user's private one.

    Such groups usually come with a umask of 002, and with it folders that their group may write to.
    """
    import grp
    import pwd

    try:
        user, found = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return user.pw_gid == group and found.gr_name == user.pw_name and set(found.gr_mem) <= {user.pw_name}
