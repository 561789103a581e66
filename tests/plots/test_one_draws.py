"""Pictures of reports and of the doctor are drawn while no other thread draws."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from spinfilters.campaigns import campaign_report as writing
from spinfilters.cli.installation_checks import figure_drawn
from spinfilters.plots import style


def report_picture(folder: Path) -> object:
    return writing._picture(folder, "one", Figure(figsize=(1, 1)), "words")  # pyright: ignore[reportPrivateUsage]


@pytest.mark.parametrize("draw", [report_picture, lambda _: figure_drawn()])
def test_a_picture_holds_the_lock(
    draw: Callable[[Path], object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held: list[bool] = []
    draw_panels = Figure.draw

    def watched(self: Figure, *arguments: Any, **options: Any) -> None:
        held.append(style.ONE_DRAWS._is_owned())  # pyright: ignore[reportAttributeAccessIssue]
        draw_panels(self, *arguments, **options)

    monkeypatch.setattr(Figure, "draw", watched)
    draw(tmp_path)
    assert held
    assert all(held)
