"""Folder of reproduced items: a folder an item, resumed where it was ended, and one page over all of them.

    OUTPUT/reproduce.html            all items: printed, ours, bound, why they differ, pictures
    OUTPUT/reproduce.csv             the same rows
    OUTPUT/ITEM/item.json            rows, note, seconds, version, hash of the code
    OUTPUT/ITEM/rows.csv, *.csv, *.png   rows, tables and pictures
    OUTPUT/ITEM/*.pdf or *.svg           pictures for a paper, where they are asked for

An item is written as a whole or not at all; one that was made by this version and by the same code of this package is not made
again, unless asked. `record_of` sums all up.
"""

import csv
import io
import json
import math
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from html import escape
from pathlib import Path
from typing import Any, Final

from spinfilters.core.errors import InputError, SpinfiltersError
from spinfilters.io.input_file import path_text, read_settings_text
from spinfilters.io.output_files import made_folder, output_folder, write_bytes, write_json, write_text
from spinfilters.plots.page import image, note, page, table
from spinfilters.plots.printing import PrintStyle, printed_figure
from spinfilters.plots.style import save_figure
from spinfilters.reproduction.item import RANKED, Agreement, ComparedNumber, Item, ItemResult
from spinfilters.reproduction.items import ITEMS
from spinfilters.version import __version__

COMMAND: Final = "reproduce"
ITEM_FILE, ROWS_FILE, PAGE_FILE, TABLE_FILE = "item.json", "rows.csv", "reproduce.html", "reproduce.csv"
FAILED: Final = "failed"
RESULTS: Final = (*(word.value for word in RANKED[::-1]), FAILED)
MEANING: Final = (
    "Compared with a printed number: agrees, better, differs. Not compared: consistent with a picture or with words; input, "
    "a printed "
    "number that was put in."
)
SCHEMA: Final = 2
HEAD: Final = ("item", "number", "what", "unit", "printed", "ours", "bound", "result", "why")


@dataclass(frozen=True)
class Finished:
    """What is known of an item after it was made.

    Parameters
    ----------
    name : str
        Of the item.
    agreement : str
        ``agrees``, ``better``, ``differs``, ``consistent``, ``input`` or ``failed``.
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
    style: PrintStyle | None = None,
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
        Called with an item before it is made, and with the item and its result after it.
    style : PrintStyle or None
        Of figures that are printed too; an item is made again where it has none in this format.

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
                is_printed = style is None or any((folder / item.name).glob(f"*.{style.form}"))
                kept = None if again or not is_printed else _read_current(folder / item.name)
                done = (
                    Finished(item.name, str(kept["result"]), kept, True)
                    if kept
                    else _make(item, folder / item.name, style)
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
    rows = [row for document in documents for row in document["rows"]]
    parts = {"Result": note(f"{counted(documents)}, of {len(documents)} items")}
    parts["Result"] += note(f"{counted(rows)}, of {len(rows)} rows. {MEANING}")
    parts["Result"] += table(("item", "what", "result"), [_summary(d) for d in documents], 3)
    parts |= {
        f"{d['source']}, {d['number']}: {d['title']}": _section(folder / d["name"], d) for d in documents
    }
    write_text(folder / PAGE_FILE, page(parts, "The sources' tables and figures: printed, ours, bound"))


def counted(found: Iterable[Mapping[str, Any]]) -> str:
    """How many items or rows end with each word, in words.

    Parameters
    ----------
    found : iterable of mapping
        With the key ``result``.
    """
    return ", ".join(f"{count} {word}" for word, count in _counts(found).items())


def _counts(found: Iterable[Mapping[str, Any]]) -> dict[str, int]:
    counts = Counter(str(each.get("result")) for each in found)
    return {word: counts[word] for word in RESULTS if counts[word]}


@cache
def code_hash() -> str:
    """SHA-256 of the modules of this package, their names included."""
    folder, found = Path(__file__).parent, sha256()
    for path in sorted(folder.rglob("*.py")):
        found.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()


def record_of(found: Sequence[Finished], date: str) -> dict[str, Any]:
    """Summary of made items: which code made them, when, and how each compares.

    Parameters
    ----------
    found : sequence of Finished
        What `reproduce` returned.
    date : str
        ISO 8601.
    """
    rows = [row for each in found for row in each.document["rows"]]
    return {
        "schema": SCHEMA,
        "version": __version__,
        "date": date,
        "code": code_hash(),
        "counts": {"items": _counts(each.document for each in found), "rows": _counts(rows)},
        "items": {
            each.name: {
                "result": each.agreement,
                "rows": _counts(each.document["rows"]),
                "processor_s": each.document.get("processor_s"),
            }
            for each in found
        },
    }


def _make(item: Item, place: Path, style: PrintStyle | None = None) -> Finished:
    """Make an item and write its folder; an item that cannot be made says why."""
    begin = time.process_time()
    document: dict[str, Any] = {
        "name": item.name,
        "source": item.source,
        "number": item.number,
        "title": item.title,
    }
    document |= {"schema": SCHEMA, "version": __version__, "code": code_hash()}
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
                printed = {} if style is None else printed_figure(figure, name, style)
                for file, content in printed.items():
                    write_bytes(stage / file, content)
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
        "bound": None if isinstance(row.bound, str) else row.bound,
        "no_bound": row.bound if isinstance(row.bound, str) else "",
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
    """The document that an earlier call of the same code wrote for an item; None without one, or where it failed."""
    document = _read_document(place)
    if document is None:
        return None
    made_by = tuple(document.get(key) for key in ("schema", "version", "code"))
    if made_by != (SCHEMA, __version__, code_hash()):
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
        numbers = [
            shown,
            _number(row.get("ours")),
            _number(row.get("bound")) or str(row.get("no_bound") or ""),
        ]
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
