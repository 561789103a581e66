"""Folder of reproduced items: a folder an item, resumed where it was ended, and one page over all of them.

    OUTPUT/reproduce.html            all items: printed, ours, bound, why they differ, pictures
    OUTPUT/reproduce.csv             the same rows
    OUTPUT/ITEM/item.json            rows, note, seconds, version
    OUTPUT/ITEM/rows.csv, *.csv, *.png   rows, tables and pictures

An item is written as a whole or not at all; one that was made by this version is not made again, unless asked.
"""

import csv
import io
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, Final

from spinfilters.core.errors import InputError, SpinfiltersError
from spinfilters.io.input_file import path_text, read_settings_text
from spinfilters.io.output_files import made_folder, output_folder, write_json, write_text
from spinfilters.plots.page import image, note, page, table
from spinfilters.plots.style import save_figure
from spinfilters.reproduction.item import Agreement, ComparedNumber, Item, ItemResult
from spinfilters.reproduction.items import ITEMS
from spinfilters.version import __version__

COMMAND: Final = "reproduce"
ITEM_FILE, ROWS_FILE, PAGE_FILE, TABLE_FILE = "item.json", "rows.csv", "reproduce.html", "reproduce.csv"
FAILED: Final = "failed"
SCHEMA: Final = 1
HEAD: Final = ("item", "number", "what", "unit", "printed", "ours", "bound", "result", "why")


@dataclass(frozen=True)
class Finished:
    """What is known of an item after it was made.

    Parameters
    ----------
    name : str
        Of the item.
    agreement : str
        ``agrees``, ``better``, ``differs`` or ``failed``.
    document : mapping
        The content of its ``item.json``.
    kept : bool
        Whether it was there already.
    """

    name: str
    agreement: str
    document: Mapping[str, Any]
    kept: bool


def reproduce(
    items: Sequence[Item],
    folder: Path,
    again: bool = False,
    report: Callable[[Item, Finished | None], None] = lambda *_: None,
) -> list[Finished]:
    """Make items into a folder, and the page over all that the folder holds.

    Parameters
    ----------
    items : sequence of Item
        What to make, in this order.
    folder : Path
        Results of an earlier call in it are kept where this version made them.
    again : bool
        Make also what is there already.
    report : callable
        Called with an item before it is made, and with the item and its result behind it.

    Raises
    ------
    InputError
        A folder that cannot be written, or in which somebody else's files stand.
    """
    found = []
    with made_folder(folder):
        try:
            for item in items:
                report(item, None)
                kept = None if again else _read_current(folder / item.name)
                done = (
                    Finished(item.name, str(kept["result"]), kept, True)
                    if kept
                    else _make(item, folder / item.name)
                )
                found.append(done)
                report(item, done)
        finally:
            write_pages(folder)
    return found


def write_pages(folder: Path) -> None:
    """The page and the table over all items in a folder."""
    documents = list(_documents(folder))
    if not documents:
        return
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(HEAD)
    lines.writerows(cells for document in documents for cells in _cells(document))
    write_text(folder / TABLE_FILE, text.getvalue())
    counts = {
        word: sum(d["result"] == word for d in documents) for word in ("agrees", "better", "differs", FAILED)
    }
    counted = ", ".join(f"{count} {word}" for word, count in counts.items() if count)
    parts = {"Result": note(f"{counted}, of {len(documents)} items")}
    parts["Result"] += table(("item", "what", "result"), [_summary(d) for d in documents], 3)
    parts |= {
        f"{d['source']}, {d['number']}: {d['title']}": _section(folder / d["name"], d) for d in documents
    }
    write_text(folder / PAGE_FILE, page(parts, "The sources' tables and figures: printed, ours, bound"))


def _make(item: Item, place: Path) -> Finished:
    """Make an item and write its folder; an item that cannot be made says why."""
    begin = time.process_time()
    document: dict[str, Any] = {
        "name": item.name,
        "source": item.source,
        "number": item.number,
        "title": item.title,
    }
    document |= {"schema": SCHEMA, "version": __version__}
    outcome: ItemResult | None = None
    try:
        outcome = item.make()
    except SpinfiltersError as error:
        document |= {"result": FAILED, "rows": [], "note": str(error), "pictures": []}
    else:
        document |= {
            "result": outcome.agreement.value,
            "rows": [_row_document(row) for row in outcome.rows],
            "note": outcome.note,
            "pictures": [f"{name}.png" for name in outcome.figures],
        }
    document["processor_s"] = round(time.process_time() - begin, 2)
    with output_folder(place, COMMAND) as stage:
        if outcome is not None:
            for name, figure in outcome.figures.items():
                save_figure(figure, stage / f"{name}.png")
            for name, rows in outcome.tables.items():
                write_text(stage / f"{name}.csv", _csv(rows))
            write_text(stage / ROWS_FILE, _csv(document["rows"]))
        write_json(stage / ITEM_FILE, document)
    return Finished(item.name, document["result"], document, False)


def _row_document(row: ComparedNumber) -> dict[str, Any]:
    return {
        "what": row.what,
        "unit": row.unit,
        "printed": row.printed,
        "shown": None
        if row.expected is None
        else [None if math.isinf(each) else each for each in row.expected],
        "ours": float(row.ours),
        "bound": row.bound,
        "result": row.agreement.value,
        "why": row.why if row.agreement is Agreement.DIFFERS else "",
    }


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    if rows:
        lines = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
        lines.writeheader()
        lines.writerows(rows)
    return text.getvalue()


def _read_current(place: Path) -> Mapping[str, Any] | None:
    """The document that an earlier call of this version wrote for an item; None without one, or where it failed."""
    document = _read_document(place)
    if document is None or (document.get("schema"), document.get("version")) != (SCHEMA, __version__):
        return None
    return None if document["result"] == FAILED else document


def _read_document(place: Path) -> dict[str, Any] | None:
    try:
        document = json.loads(read_settings_text(place / ITEM_FILE))
    except (InputError, ValueError, RecursionError):
        return None
    needed = {
        "name": str,
        "source": str,
        "number": str,
        "title": str,
        "result": str,
        "note": str,
        "rows": list,
        "pictures": list,
    }
    sound = isinstance(document, dict) and all(
        isinstance(document.get(key), kind) for key, kind in needed.items()
    )
    if not sound or document["name"] != place.name:
        return None
    parts = [
        *(isinstance(row, dict) for row in document["rows"]),
        *(isinstance(name, str) for name in document["pictures"]),
    ]
    return document if all(parts) else None


def _documents(folder: Path) -> Iterator[dict[str, Any]]:
    """Documents of all items in a folder, in the order of the sources."""
    for item in ITEMS:
        document = _read_document(folder / item.name)
        if document is not None:
            yield document


def _summary(document: Mapping[str, Any]) -> tuple[str, str, str]:
    word = str(document["result"])
    mark = f'<span class="bad">{word}</span>' if word in (FAILED, Agreement.DIFFERS.value) else word
    return escape(f"{document['source']}, {document['number']}"), escape(document["title"]), mark


def _cells(document: Mapping[str, Any]) -> Iterator[list[str]]:
    """Cells of the table, a list a row."""
    for row in document["rows"]:
        printed = row.get("printed")
        shown = f"{_number(printed)}" if printed is not None else _interval(row.get("shown"))
        numbers = [shown, _number(row.get("ours")), _number(row.get("bound"))]
        words = [str(row.get(key) or "") for key in ("what", "unit", "result", "why")]
        yield [document["name"], document["number"], words[0], words[1], *numbers, words[2], words[3]]


def _section(place: Path, document: Mapping[str, Any]) -> str:
    """HTML of an item."""
    rows = [[escape(cell) for cell in cells[2:]] for cells in _cells(document)]
    text = table(HEAD[2:], rows, 2) if rows else ""
    if document["note"]:
        text += note(document["note"])
    for name in document["pictures"]:
        path = place / str(name)
        if path.parent == place and path.is_file():
            text += image(path.read_bytes(), f"{document['title']}, {path_text(path)}")
    return text


def _number(value: object) -> str:
    return f"{value:.5g}" if isinstance(value, int | float) and not isinstance(value, bool) else ""


def _interval(shown: object) -> str:
    """An interval that a picture shows; an end without a limit is left out."""
    if not (isinstance(shown, list) and len(shown) == 2):
        return ""
    low, high = (_number(each) for each in shown)
    if not low or not high:
        return f"at most {high}" if high else f"at least {low}"
    return f"{low} to {high}"
