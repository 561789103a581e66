"""Tables of a run: plain text, HTML, data frames."""

import shutil
import sys
from collections.abc import Iterator, Mapping
from html import escape
from importlib import import_module
from io import StringIO
from typing import Any

from rich.console import Console, RenderableType

from spinfilters.evaluation.comparison import ComparisonCells

WIDTH = 150
"""Characters of a table where the terminal does not tell its own."""


def plain_text(table: RenderableType) -> str:
    """A table without colours, as wide as the terminal, or `WIDTH` where there is none."""
    width = shutil.get_terminal_size((WIDTH, 24)).columns if sys.stdout.isatty() else WIDTH
    stream = StringIO()
    console = Console(file=stream, width=width, markup=False, emoji=False, color_system=None)
    console.print(table)
    return stream.getvalue().rstrip("\n")


def html_table(cells: ComparisonCells, remarks: list[str]) -> str:
    """The table for a notebook, its texts escaped; ``remarks`` are sentences below it."""
    head = "".join(f"<th>{escape(text)}</th>" for text in ("", *cells.headings))
    bodies = ("".join(_html_row(row) for row in section) for section in cells.sections if section)
    below = [*cells.captions, *remarks]
    return (
        f"<table><caption>{_html_lines(cells.title)}</caption><thead><tr>{head}</tr></thead>"
        f"{''.join(f'<tbody>{rows}</tbody>' for rows in bodies)}</table>"
        f"<p>{_html_lines(below)}</p>"
    )


def data_frame(columns: Mapping[str, Any], index: str) -> Any:
    """pandas.DataFrame of columns of equal length, one of which is its index.

    Raises
    ------
    ImportError: pandas is not installed.
    """
    try:
        pandas = import_module("pandas")
    except ImportError:
        raise ImportError(
            "to_dataframe needs pandas, which is not installed; install it with 'pip install pandas'"
        ) from None
    return pandas.DataFrame(dict(columns)).set_index(index)


def flattened(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Flat names and values of a document's numbers and words.

    ``a.b`` of tables, ``a_1`` of lists; a list of sentences is one text.
    """
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from flattened(inner, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list) and all(isinstance(each, str) for each in value):
        yield name, "; ".join(value)
    elif isinstance(value, list):
        for number, inner in enumerate(value, start=1):
            yield from flattened(inner, f"{name}_{number}")
    else:
        yield name, value


def _html_row(row: tuple[str, ...]) -> str:
    name, *cells = row
    indent = "&nbsp;" * (len(name) - len(name.lstrip()))
    numbers = "".join(f'<td style="text-align:right">{escape(cell)}</td>' for cell in cells)
    return f'<tr><th style="text-align:left">{indent}{escape(name.strip())}</th>{numbers}</tr>'


def _html_lines(lines: list[str] | tuple[str, ...]) -> str:
    return "<br>".join(map(escape, lines))
