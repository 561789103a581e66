"""The folder of this user in which a run keeps what a later one need not make again."""

import os
from pathlib import Path

import platformdirs


def cache_folder() -> Path | None:
    """Folder of compiled libraries and unpacked bags.

    It is ``$SPINFILTERS_CACHE`` or the user's cache folder; None for a user without a home.
    """
    chosen = os.environ.get("SPINFILTERS_CACHE")
    if chosen:
        return Path(os.path.abspath(chosen))
    try:
        folder = Path(platformdirs.user_cache_dir("spinfilters"))
    except RuntimeError:
        return None
    return folder if folder.is_absolute() else None
