"""Options that commands have in common: what is printed, and whether figures are drawn.

A command says which it takes (`spinfilters.cli.command.Command`); they hold while it runs, so that no function of it has
to pass them on. Nothing heavy is imported here, so that help is quick.
"""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from spinfilters.io.stated_values import Argument

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class PrintingOptions:
    """What a command prints."""

    quiet: Annotated[bool, Argument("print only errors", short="-q")] = False
    json: Annotated[bool, Argument("print the result as JSON instead of text")] = False


@dataclass(frozen=True, kw_only=True)
class FigureOptions(PrintingOptions):
    """What a command prints, and whether it draws."""

    no_figures: Annotated[bool, Argument("write numbers only, no figures")] = False


_NONE_GIVEN: Final = FigureOptions()
_CHOSEN: Final[ContextVar[FigureOptions]] = ContextVar("common_options", default=_NONE_GIVEN)


@contextmanager
def common_options(chosen: FigureOptions) -> Iterator[None]:
    """Let options hold for all that is printed and drawn within."""
    token = _CHOSEN.set(chosen)
    try:
        yield
    finally:
        _CHOSEN.reset(token)


def prints_text() -> bool:
    """Whether text is printed: neither ``--quiet`` nor ``--json`` is given."""
    return not (_CHOSEN.get().quiet or _CHOSEN.get().json)


def prints_document() -> bool:
    """Whether the result is printed as JSON."""
    return _CHOSEN.get().json


def shows_progress() -> bool:
    """Whether bars of progress are shown on a terminal."""
    return not _CHOSEN.get().quiet


def draws_figures() -> bool:
    """Whether figures are drawn."""
    return not _CHOSEN.get().no_figures


def print_document(document: Mapping[str, Any] | Sequence[Any]) -> None:
    """Print the result of a command where ``--json`` asks for it; what is not finite becomes null."""
    if prints_document():
        from spinfilters.io.output_files import json_text

        sys.stdout.write(json_text(document))


def print_json_file(path: Path) -> None:
    """Print a result that a command has written, where ``--json`` asks for it."""
    if prints_document():
        sys.stdout.write(path.read_text(encoding="utf-8"))


def draw(make: "Callable[[], Figure]", path: Path) -> None:
    """Draw a figure into a PNG file, unless figures are not wanted."""
    if draws_figures():
        from spinfilters.plots.style import save_figure

        save_figure(make(), path)
