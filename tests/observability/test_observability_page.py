"""The how-to page on a user's own system prints what it shows."""

import re
from pathlib import Path

import pytest

from observability import analyse_file

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "observability-of-your-system.md"


def test_the_examples_of_the_page_print_what_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, object] = {}
    pairs = re.findall(
        r"```python\n(.*?)```\n+(?:[^`\n][^\n]*\n+)*```text\n(.*?)```", PAGE.read_text(), re.DOTALL
    )
    assert len(pairs) == 8
    for program, shown in pairs:
        exec(compile(program, PAGE.name, "exec"), names)
        assert capsys.readouterr().out == shown


def test_the_file_of_the_page_is_a_model(tmp_path: Path) -> None:
    (text,) = re.findall(r"```toml\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (tmp_path / "spring.toml").write_text(text)
    assert analyse_file(tmp_path / "spring.toml").rank == 4
