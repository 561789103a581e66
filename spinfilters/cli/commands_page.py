"""The page of all commands, made from the records of their arguments."""

import sys
from dataclasses import MISSING
from typing import Any, Final

from spinfilters.cli.command import Command
from spinfilters.cli.commands import COMMANDS
from spinfilters.io.argument_fields import GivenField, default_text
from spinfilters.io.output_files import write_or_print

HEAD: Final = """# All commands

Look up a command or an option here. `spinfilters COMMAND --help` prints the same, and [the command line](../how-to/command-line.md)
shows how to use them. A dash in the column *default* means: off, or chosen by the command.

This page is made from the code by `python -m spinfilters.cli.commands_page docs/reference/commands.md`; a test compares the two.
"""


def page() -> str:
    """The page as Markdown."""
    sections = [
        _section(command, f"## `{words}`", command.help or listed.help)
        for listed in COMMANDS
        for words, command in listed.load().parts
    ]
    return HEAD + "".join(sections)


def _section(command: Command[Any], heading: str, help_line: str) -> str:
    rows = "".join(_row(field) for field in command.fields)
    table = f"\n| argument | default | range | what it is |\n|---|---|---|---|\n{rows}" if rows else ""
    description = f" {command.description}" if command.description else ""
    return f"\n{heading}\n\n{_sentence(help_line)}{description}\n{table}"


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def _row(field: GivenField) -> str:
    metavar = field.argument.metavar
    names = " ".join(metavar) if isinstance(metavar, tuple) else metavar
    shown = field.flag if field.argument.positional else f"{field.flag} {names}".strip()
    short = f"`{field.argument.short}`, " if field.argument.short else ""
    default = "must be given" if field.default is MISSING else default_text(field.default) or "-"
    return f"| {short}`{_cell(shown)}` | {_cell(default)} | {_cell(_range_text(field))} | {_cell(field.argument.help)} |\n"


def _range_text(field: GivenField) -> str:
    if field.choices is not None:
        return ", ".join(map(str, field.choices))
    return "" if field.allowed is None else str(field.allowed)


def _cell(text: str) -> str:
    """Text of a cell: a bar in it would end the cell, angle brackets would be HTML."""
    return text.replace("|", "\\|").replace("<", "&lt;").replace(">", "&gt;")


def main(arguments: list[str]) -> int:
    """Write the page to a file, or print it."""
    return write_or_print(page(), arguments)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
