"""Every capability has a command on its page, or stands there as missing; shell lines are run by `docs.test_commands`."""

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "capabilities.md"
PYTHON = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
MARK = re.compile(r"(?<![\w.-])([TCD]\d+|\+\d+)(?: to ([TCD]\d+))?(?![\w.])")
ROWS = {
    *(f"T{number}" for number in range(1, 20)),
    *(f"D{number}" for number in range(1, 8)),
    *(f"C{number}" for number in range(1, 8)),
    *(f"+{number}" for number in range(1, 15)),
}


def named(text: str) -> set[str]:
    """Rows that a text names, ranges included."""
    found: set[str] = set()
    for first, last in MARK.findall(text):
        numbers = range(int(first[1:]), int((last or first)[1:]) + 1)
        found |= {f"{first[0]}{number}" for number in numbers}
    return found


def test_every_capability_has_a_command_or_is_said_to_be_missing() -> None:
    assert ROWS - named(PAGE.read_text()) == set()


@pytest.mark.parametrize("block", PYTHON.findall(PAGE.read_text()), ids=("motion", "face"))
def test_the_python_lines_run(block: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    code = compile(block, str(PAGE), "exec")
    namespace: dict[str, object] = {}
    exec(code, namespace)
    assert namespace.get("run", namespace.get("R")) is not None
