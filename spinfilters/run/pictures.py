"""Pictures of a run by the names of their files, to be drawn as they are or printed for a paper."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Pictures: TypeAlias = "Mapping[str, Callable[[], Figure]]"
"""What draws each picture, by its PNG file within the run folder."""


def draw_pictures(folder: Path, pictures: Pictures) -> list[str]:
    """Draw and save pictures; the names of their files. InputError: one cannot be written."""
    # Matplotlib is slow to import: a run without pictures does not wait for it.
    from spinfilters.plots.style import draw_figure

    for name, draw in pictures.items():
        draw_figure(draw, folder / name)
    return list(pictures)
