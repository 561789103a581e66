"""The pictures of a run."""

import gc
from collections.abc import Callable, Container, Iterator
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from spinfilters.data.input_file import value_text
from spinfilters.errors import InputError
from spinfilters.pipeline.figure_data import FigureData
from spinfilters.pipeline.figure_entry import figure_entries
from spinfilters.plots.style import draw_figure, drawn


def draw_run(
    figure_data: FigureData,
    folder: Path,
    progress: Callable[[int, int], None],
    wanted: Container[str] | None = None,
) -> list[str]:
    """Draw all or the wanted figures of a run as PNG files; returns names."""
    every = {f"{name}.png": draw for name, draw in _figures(figure_data)}
    figures = {name: draw for name, draw in every.items() if wanted is None or name in wanted}
    for index, (name, draw) in enumerate(figures.items()):
        progress(index, len(figures))
        draw_figure(draw, folder / name)
        gc.collect()  # a figure is a knot of references that would wait for the next ones
    progress(len(figures), len(figures))
    return list(figures)


def drawn_figure(figure_data: FigureData, name: str) -> Figure:
    """One figure of a run; a note where its numbers cannot be drawn.

    Raises
    ------
    InputError: no such figure, or one that needs what the run does not have.
    """
    figures = dict(_figures(figure_data))
    if name not in figures:
        missing = {entry.name: entry.lacks(figure_data) for entry in figure_entries()}.get(name)
        why = "is unknown" if missing is None else f"needs {missing}"
        raise InputError(f"figure {value_text(name)} {why}; choose from {', '.join(figures)}")
    return drawn(figures[name], name)


def _figures(figure_data: FigureData) -> Iterator[tuple[str, Callable[[], Figure]]]:
    """Every figure of the table that the run has what it needs for."""
    estimators = [evaluation.name for evaluation in figure_data.evaluations]
    for entry in figure_entries():
        if entry.lacks(figure_data) is None:
            for name in entry.names(estimators):
                yield name, partial(entry.draw, figure_data, name)
