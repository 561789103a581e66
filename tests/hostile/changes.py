"""Changes of a folder of valid files, from which hostile inputs are made."""

import os
from collections.abc import Callable
from pathlib import Path

Change = Callable[[Path], object]
"""Alters the files below a folder."""
Data = bytes | str | Callable[[], bytes | str]
"""What a file holds, or what makes it where that takes time: only of cases that are tried."""


def unchanged(_: Path) -> None:
    """Leave everything as it is: the arguments are the fault."""


def content(name: str, data: Data) -> Change:
    """Write a file, its folders included."""

    def change(folder: Path) -> None:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        made = data() if callable(data) else data
        path.write_bytes(made if isinstance(made, bytes) else made.encode("utf-8", "surrogateescape"))

    return change


def bytes_of(name: str, edit: Callable[[bytes], bytes]) -> Change:
    """Edit the bytes of a file."""
    return lambda folder: (folder / name).write_bytes(edit((folder / name).read_bytes()))


def lines_of(name: str, edit: Callable[[list[str]], list[str]]) -> Change:
    """Edit the lines of a text file."""
    return bytes_of(
        name,
        lambda data: ("\n".join(edit(data.decode().splitlines())) + "\n").encode("utf-8", "surrogatepass"),
    )


def cell(name: str, line: int, column: int, text: str) -> Change:
    """Replace one cell of a table, line and column counted from 0; blanks separate cells where there is no comma."""

    def edit(lines: list[str]) -> list[str]:
        delimiter = "," if "," in lines[-1] else " "
        cells = lines[line].split(delimiter)
        cells[column] = text
        return [*lines[:line], delimiter.join(cells), *lines[line + 1 :]]

    return lines_of(name, edit)


def column(name: str, index: int, value: Callable[[float, int], float], header: int = 1) -> Change:
    """Replace the numbers of a column by a function of the number and its row."""

    def edit(lines: list[str]) -> list[str]:
        delimiter = "," if "," in lines[-1] else " "
        rows = [line.split(delimiter) for line in lines[header:]]
        for k, cells in enumerate(rows):
            cells[index] = repr(value(float(cells[index]), k))
        return [*lines[:header], *map(delimiter.join, rows)]

    return lines_of(name, edit)


def replaced(name: str, old: str, new: str) -> Change:
    """Replace a text of a file, which must hold it, everywhere."""

    def edit(data: bytes) -> bytes:
        assert old.encode() in data, f"{name} holds no {old!r}"
        return data.replace(old.encode(), new.encode())

    return bytes_of(name, edit)


def added(name: str, text: str) -> Change:
    """Append a text to a file."""
    return bytes_of(name, lambda data: data + text.encode())


def without(name: str) -> Change:
    """Delete a file."""
    return lambda folder: (folder / name).unlink()


def instead(name: str, make: Callable[[Path], object]) -> Change:
    """Put something that is no regular file in the place of a file."""

    def change(folder: Path) -> None:
        (folder / name).unlink(missing_ok=True)
        make(folder / name)

    return change


def sparse(size: int) -> Callable[[Path], None]:
    """Make a file of that size that takes no disk."""

    def make(path: Path) -> None:
        path.touch()
        os.truncate(path, size)

    return make


def both(*changes: Change) -> Change:
    """One change after another."""

    def change(folder: Path) -> None:
        for each in changes:
            each(folder)

    return change
