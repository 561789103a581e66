"""Faults put into folders, and the one line with which a command refuses them."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from spinfilters.cli.main import main

Change = Callable[[Path], object]


def refusal(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What a command that must fail says: its one line."""
    capsys.readouterr()
    try:
        code: object = main(arguments)
    except SystemExit as stop:  # argparse
        code = stop.code
    captured = capsys.readouterr()
    assert code == 2, captured.err
    assert len(captured.err.splitlines()) == 1, captured.err
    assert captured.err.startswith("spinfilters: ")
    assert captured.out == ""
    return captured.err


def replaced(file: str, old: str, new: str) -> Change:
    """Change a file's text where ``old`` first occurs."""

    def change(folder: Path) -> None:
        text = (folder / file).read_text(encoding="utf-8")
        assert old in text
        (folder / file).write_text(text.replace(old, new, 1), encoding="utf-8")

    return change


def line(file: str, number: int, new: str) -> Change:
    """Replace a line of a file, counted from 1."""

    def change(folder: Path) -> None:
        lines = (folder / file).read_text(encoding="utf-8").splitlines()
        lines[number - 1] = new
        (folder / file).write_text("\n".join(lines) + "\n", encoding="utf-8")

    return change


def first_lines(file: str, count: int) -> Change:
    """Cut a file off."""

    def change(folder: Path) -> None:
        lines = (folder / file).read_text(encoding="utf-8").splitlines()
        (folder / file).write_text("\n".join(lines[:count]) + "\n", encoding="utf-8")

    return change


def without(name: str) -> Change:
    """Delete a file or folder."""
    return lambda folder: (
        shutil.rmtree(folder / name) if (folder / name).is_dir() else (folder / name).unlink()
    )


def text(name: str, content: str) -> Change:
    """Write a file."""
    return lambda folder: (folder / name).write_text(content, encoding="utf-8")


def cut_off(name: str) -> Change:
    """Leave half of a file."""
    return lambda run: (run / name).write_bytes((run / name).read_bytes()[: (run / name).stat().st_size // 2])
