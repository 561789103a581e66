"""Self-contained pages."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from spinfilters.plots.page import (
    STYLE,
    ShownModel,
    ShownMotion,
    details,
    facts,
    image,
    model_script,
    model_view,
    page,
    shown_box,
    table,
)
from tests.plots.chromium import document_after_scripts, pixels_drawn

STILL = ShownMotion(np.arange(3.0), np.tile(np.eye(3), (3, 1, 1)), np.zeros((3, 3)))


def _cube() -> ShownModel:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.1
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = np.array([[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)])
    return ShownModel(corners, triangles, np.full(8, 150.0))


def test_texts_are_escaped_and_nothing_is_loaded_from_elsewhere() -> None:
    text = page({"<h>": facts({"<a>": "<b>"}) + details("<c>", "<d>")}, "<title>")
    assert "<a>" not in text
    assert "<d>" not in text
    assert "default-src 'none'" in text
    assert "script-src" not in text
    assert not re.search(r'(src|href)="(?!data:)', text)


def test_columns_of_words_are_aligned_to_the_left_with_their_heads() -> None:
    text = table(["name", "value"], [["a", "1"]], 1)
    assert text.count("text-align:left") == 2


def test_a_browser_draws_the_surface_of_a_page_and_runs_no_other_script(tmp_path: Path) -> None:
    model = model_view(_cube(), STILL)
    path = tmp_path / "page.html"
    foreign = "<script>document.title = 'foreign'</script>"
    path.write_text(page({"Model": model + foreign}, "own", model_script()), encoding="utf-8")
    document = document_after_scripts(path)
    assert pixels_drawn(document) > 20_000
    assert "<title>own</title>" in document


def test_a_browser_draws_points_where_there_is_no_surface(tmp_path: Path) -> None:
    points = np.random.default_rng(0).standard_normal((200, 3)) * 0.1
    path = tmp_path / "page.html"
    view = model_view(ShownModel(points, np.zeros((0, 3), int), np.full(200, 200.0)), STILL)
    path.write_text(page({"Model": view}, "points", model_script()), encoding="utf-8")
    assert 400 < pixels_drawn(document_after_scripts(path)) <= 800


def test_epochs_and_points_that_are_not_finite_are_left_out() -> None:
    points = np.array([[0.0, 0, 0], [0, 0, 0.1], [0, 0.1, 0], [0.1, 0, 0], [np.nan, 0, 0]])
    motion = ShownMotion(STILL.time, STILL.rotation, np.array([[0.0, 0, 0], [np.inf, 0, 0], [0, 0, 1]]))
    text = model_view(ShownModel(points, np.zeros((0, 3), int), np.full(5, 200.0)), motion)
    assert "NaN" not in text
    assert text.count("1.0, 0.0, 0.0, 0.0, 1.0") == 2


def test_nothing_is_wider_than_a_telephone() -> None:
    """No rule demands more than 390 px; pictures, canvas and slider shrink with the window."""
    rules = re.sub(r"@media \([^)]*\)|min\([^()]*\)|max-width:[^;}]*", "", STYLE)
    assert [size for size in map(int, re.findall(r"(\d+)px", rules)) if size > 390] == []
    for element in ("img", "canvas"):
        assert "max-width:100%" in re.findall(rf"^{element}\{{([^}}]*)", STYLE, re.MULTILINE)[0]
    slider = re.findall(r"\.controls input\{([^}]*)", STYLE)[0]
    assert "min-width:0" in slider
    assert "100%" in re.findall(r"max-width:(.*)", slider)[0]


def test_a_dark_page_darkens_figures_and_leaves_photographs() -> None:
    dark = STYLE.partition("prefers-color-scheme:dark")[2]
    assert "img.drawn{filter:invert" in dark.partition("\nbody")[0]
    assert 'class="drawn"' in image(b"", "rates")
    assert "drawn" not in image(b"", "animation", "gif")


def test_a_box_shows_six_faces_from_outside() -> None:
    box = shown_box(np.array([1.0, 2.0, 3.0]))
    a, b, c = (box.vertices[box.triangles[:, k]] for k in range(3))
    outwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c)
    assert (outwards > 0).all()
    assert np.ptp(box.vertices, axis=0).tolist() == [1.0, 2.0, 3.0]


def test_rate_and_momentum_are_drawn_where_they_are_known() -> None:
    rate = np.array([[0.0, 0, 2], [0, 0, 1], [0, 0, 1]])
    text = model_view(shown_box(np.ones(3)), replace(STILL, rate=rate, momentum=rate, sees_position=True))
    told = json.loads(re.findall(r'id="model-data">(.*?)</script>', text)[0])
    assert told["rate"][:2] == told["polhode"][:2] == [[0.0, 0.0, 1.0], [0.0, 0.0, 0.5]]
    assert told["metric"]


def test_sections_stand_side_by_side_where_asked() -> None:
    text = page({"Numbers": "1", "Rest": "2"}, "own", beside=("Numbers",))
    assert "<section class=half><h2>Numbers</h2>" in text
    assert "<section><h2>Rest</h2>" in text
    assert "prefers-color-scheme:dark" in text
    assert "http:" not in text
    assert "https:" not in text
