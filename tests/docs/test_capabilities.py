"""Every capability has a command on its page, or stands there as missing; shell lines are run by `docs.test_commands`."""

import re
from pathlib import Path

import pytest

from spinfilters.reproduction.items import ITEMS
from tests.docs.pasted_commands import PAGES, Rewriting, blocks_of, inline_of, rewriting_of

PAGE = Path(__file__).parents[2] / "docs" / "capabilities.md"
PYTHON = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
MARK = re.compile(r"(?<![\w.-])([TCD]\d+|\+\d+)(?: to ([TCD]\d+))?(?![\w.])")
UNCHANGED = Rewriting("", "", "as it stands")
ROWS = {
    *(f"T{number}" for number in range(1, 20)),
    *(f"D{number}" for number in range(1, 8)),
    *(f"C{number}" for number in range(1, 8)),
    *(f"+{number}" for number in range(1, 15)),
}


EXECUTED = [
    command
    for page in PAGES
    for command in blocks_of(page)
    if (rewriting_of(command) or UNCHANGED).added is not None
]


def named(text: str) -> set[str]:
    """Rows that a text names, ranges included."""
    found: set[str] = set()
    for first, last in MARK.findall(text):
        numbers = range(int(first[1:]), int((last or first)[1:]) + 1)
        found |= {f"{first[0]}{number}" for number in numbers}
    return found


def test_every_capability_has_a_command_or_is_said_to_be_missing() -> None:
    assert ROWS - named(PAGE.read_text()) == set()


def test_every_command_of_a_table_is_run_somewhere() -> None:
    """By a block of a page, with the same options, or as an entry of the sources that is made."""
    run = [_parts(command) for command in EXECUTED if command.startswith("spinfilters ")]
    names = ["list", *(item.name for item in ITEMS)]
    quoted = inline_of(PAGE)
    assert len(quoted) > 10
    for command in quoted:
        verb, options, words = _parts(command)
        if verb == "reproduce":
            assert not words or any(name.startswith(words[0]) for name in names), command
        else:
            assert any(verb == other and options <= own for other, own, _ in run), command


def _parts(command: str) -> tuple[str, set[str], list[str]]:
    """Verb, names of the options, and what stands between both."""
    words = command.split()[1:]
    options = {word for word in words if word.startswith("-")}
    return words[0], options, [word for word in words[1:] if word not in options]


@pytest.mark.parametrize("block", PYTHON.findall(PAGE.read_text()), ids=("motion", "face"))
def test_the_python_lines_run(block: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    code = compile(block, str(PAGE), "exec")
    namespace: dict[str, object] = {}
    exec(code, namespace)
    assert namespace.get("run", namespace.get("R")) is not None
