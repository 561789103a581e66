"""Tables of the pages are tables: a head, a rule, and rows with as many cells."""

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
RULE = re.compile(r"\|(?:\s*:?-+:?\s*\|)+")


def tables(text: str) -> Iterator[list[str]]:
    """Lines of each table, outside of code."""
    prose = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    for table in re.findall(r"(?:^\|.*\n?)+", prose, re.MULTILINE):
        yield table.splitlines()


def cells(line: str) -> int:
    """Number of cells of a row; a bar within code or behind a backslash ends none."""
    return re.sub(r"`[^`]*`|\\\|", "", line).count("|") - 1


def is_broken(table: list[str]) -> bool:
    """Whether the head has no rule below it, or a row another number of cells."""
    return len(table) < 2 or not RULE.fullmatch(table[1]) or len({cells(line) for line in table}) > 1


def test_every_table_of_a_page_has_a_head_and_rows_of_equal_length() -> None:
    found = [(page, table) for page in PAGES for table in tables(page.read_text(encoding="utf-8"))]
    assert len(found) > 100
    assert not [(page.name, table[0]) for page, table in found if is_broken(table)]


def test_a_broken_table_is_found() -> None:
    whole = "| a | b |\n|---|---|\n| `x|y` | 1 |\n"
    assert not any(is_broken(table) for table in tables(whole))
    assert any(is_broken(table) for table in tables(f"{whole}\n| c | 2 |\n"))
    assert any(is_broken(table) for table in tables(f"{whole}| c | 2 | 3 |\n"))
