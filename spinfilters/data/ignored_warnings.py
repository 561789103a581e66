"""Warnings that are ignored while a file is read.

Python's list of filters belongs to the whole process. Two threads that exchange it and put it back in turn would leave the wrong
one behind, so only one of them does so at a time.
"""

import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

_LOCK: Final = threading.RLock()


@contextmanager
def ignored_warnings(category: type[Warning]) -> Iterator[None]:
    """Within it warnings of this kind are ignored."""
    with _LOCK, warnings.catch_warnings():
        warnings.simplefilter("ignore", category)
        yield
