"""Pictures that are composed and not rendered, where a test is about something else."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from matplotlib.figure import Figure

EMPTY_PICTURE = b"\x89PNG\r\n\x1a\n"
"""What every PNG begins with."""


@contextmanager
def unrendered_pictures() -> Iterator[None]:
    """Write an empty PNG in a picture's place: rendering takes most of a small run's time, and has its tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", lambda _, target, **__: target.write(EMPTY_PICTURE))
        yield
