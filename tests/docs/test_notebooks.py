"""Every notebook runs as it stands, holds no output, and has its place in the gallery."""

import json
import re
from pathlib import Path

import cv2
import pytest
from matplotlib.figure import Figure

from tests.docs.executed_notebooks import FOLDER, NOTEBOOKS, THUMBNAIL_WIDTH, execute

LARGEST_THUMBNAIL = 60_000


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_as_it_stands(
    notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if notebook.stem == "study":
        pytest.importorskip("dask")
    monkeypatch.chdir(tmp_path)
    shown = execute(notebook)
    for value in shown:  # what Jupyter would ask a value for
        is_drawn = isinstance(value, Figure) or not hasattr(value, "_repr_html_")
        assert str(value) if is_drawn else value._repr_html_()
    assert any(isinstance(value, Figure) for value in shown)


def test_notebooks_hold_no_output() -> None:
    for notebook in NOTEBOOKS:
        for cell in json.loads(notebook.read_text())["cells"]:
            assert not cell.get("outputs"), notebook.name
            assert cell.get("execution_count") is None, notebook.name


def test_the_gallery_shows_every_notebook_with_a_small_picture() -> None:
    page = (FOLDER / "index.md").read_text()
    named = [path.name for path in NOTEBOOKS]
    assert sorted(set(re.findall(r"[\w-]+\.ipynb", page))) == named
    for notebook in NOTEBOOKS:
        picture = notebook.with_suffix(".png")
        assert f"({picture.name})" in page
        assert picture.stat().st_size < LARGEST_THUMBNAIL
        image = cv2.imread(str(picture))
        assert image is not None
        assert abs(image.shape[1] - THUMBNAIL_WIDTH) <= 1
