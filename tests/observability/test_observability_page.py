"""The how-to page on a user's own system prints what it shows."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from observability import analyse_file
from observability.bound_section import stated_bound

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "observability-of-your-system.md"
TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorials" / "observability.md"


@pytest.mark.parametrize(("page", "count"), [(PAGE, 11), (TUTORIAL, 5)])
def test_the_examples_of_the_page_print_what_is_shown(
    page: Path, count: int, capsys: pytest.CaptureFixture[str]
) -> None:
    names: dict[str, object] = {}
    pairs = re.findall(
        r"```python\n(.*?)```\n+(?:[^`\n][^\n]*\n+)*```text\n(.*?)```", page.read_text(), re.DOTALL
    )
    assert len(pairs) == count
    for program, shown in pairs:
        exec(compile(program, page.name, "exec"), names)
        assert capsys.readouterr().out == shown


def test_the_files_of_the_page_are_models(tmp_path: Path) -> None:
    texts = re.findall(r"```toml\n(.*?)```", PAGE.read_text(), re.DOTALL)
    ranks = []
    for text in texts:
        (tmp_path / "model.toml").write_text(text)
        ranks.append(analyse_file(tmp_path / "model.toml").rank)
    assert ranks == [4, 5, 7]


def test_the_bounds_of_the_page_are_finite(tmp_path: Path) -> None:
    texts = re.findall(r"```toml\n(.*?)```", PAGE.read_text(), re.DOTALL)
    for text in texts[1:]:
        found = stated_bound(tomllib.loads(text), "model.toml", tmp_path)
        assert found is not None
        assert np.isfinite(list(found.last.final.values())).all()
