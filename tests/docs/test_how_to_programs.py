"""The programs of how-to pages that need no file of the reader's run as they stand, and print what the page shows."""

import re
from pathlib import Path

import pytest

HOW_TO = Path(__file__).parents[2] / "docs" / "how-to"
BLOCK = re.compile(r"^```(python|text)\n(.*?)^```", re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("page", ["arrays", "online"])
def test_a_program_of_a_how_to_page_prints_what_is_shown(
    page: str, capsys: pytest.CaptureFixture[str]
) -> None:
    names: dict[str, object] = {}
    printed = ""
    for language, block in BLOCK.findall((HOW_TO / f"{page}.md").read_text()):
        if language == "python":
            exec(compile(block, page, "exec"), names)
            printed = capsys.readouterr().out
        else:
            assert printed == block
