"""Pictures that are composed and not rendered, where a test is about something else."""

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO

import pytest
from matplotlib.figure import Figure
from PIL import Image


def _one_pixel() -> bytes:
    stream = BytesIO()
    Image.new("L", (1, 1)).save(stream, "PNG")
    return stream.getvalue()


EMPTY_PICTURE = _one_pixel()
"""A PNG of one pixel, which frames of an animation can be made of."""


@contextmanager
def unrendered_pictures() -> Iterator[None]:
    """Write an empty PNG in a picture's place: rendering takes most of a small run's time, and has its tests."""
    from spinfilters.plots import style  # behind the hook that checks its shapes

    with pytest.MonkeyPatch.context() as patch:
        for owner, name in ((Figure, "savefig"), (style, "_draw_png")):
            patch.setattr(owner, name, lambda _, target, **__: target.write(EMPTY_PICTURE))
        yield
