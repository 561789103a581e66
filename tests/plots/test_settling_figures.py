"""Figures of what settles: a panel an axis, the loop's closure in each, courses on one scale, times of every solve."""

from io import BytesIO

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from spinfilters.plots import settling
from spinfilters.plots.settling import (
    SettlingConstant,
    SettlingQuantity,
    SolveCosts,
    constants_figure,
    costs_figure,
    course_animation,
    course_figure,
    surfaces_figure,
)

EPOCHS = 70
FEW_FRAMES = 8
"""Of an animation, far fewer than solves."""
TIME = 0.5 * np.arange(EPOCHS)
HELD = np.where(np.tri(EPOCHS) > 0, 1.0, np.nan)[..., np.newaxis]
WAVE = np.stack([np.sin(TIME), np.cos(TIME), 0.1 * TIME], axis=1)
SHARE = 1.0 / (1.0 + np.arange(EPOCHS))[:, np.newaxis, np.newaxis]
QUANTITY = SettlingQuantity(
    *("velocity", "mm/s", "mm/s", ("x", "y", "z")), HELD * (WAVE + SHARE), HELD * SHARE * np.ones(3), WAVE
)


def titles(figure: Figure) -> list[str]:
    """Of all panels that have one."""
    return [axes.get_title(loc="left") for axes in figure.axes if axes.get_title(loc="left")]


def test_surfaces_have_a_titled_panel_an_axis_and_mark_the_loop() -> None:
    figure = surfaces_figure(TIME, QUANTITY, 12)
    figure.savefig(BytesIO(), dpi=40)
    assert len(set(titles(figure))) == 6
    panels = [axes for axes in figure.axes if axes.get_title(loc="left")]
    assert all([line.get_xdata()[0] for line in axes.lines] == [12] for axes in panels)  # pyright: ignore[reportIndexIssue, reportArgumentType]
    assert not any(axes.lines for axes in surfaces_figure(TIME, QUANTITY).axes)


def test_constants_are_drawn_with_deviation_and_truth_whatever_the_first_solves_say() -> None:
    values, std = np.ones((EPOCHS, 2)), np.full((EPOCHS, 2), 0.01)
    values[:3], std[:3] = np.nan, 1e6
    constant = SettlingConstant("ratios", "-", ("k1", "k2"), values, std, np.array([1.0, 1.01]))
    figure = constants_figure([constant])
    assert len(set(titles(figure))) == 2
    low, high = figure.axes[1].get_ylim()
    assert 0.0 < high - low < 0.2


def test_courses_share_one_scale_and_the_animation_ends_with_the_last_solve(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(settling, "MOST_FRAMES", FEW_FRAMES)
    figure = course_figure(TIME, QUANTITY, 1, (5, 20, 40, EPOCHS))
    assert titles(figure) == [f"after epoch {n}" for n in (5, 20, 40, EPOCHS)]
    with Image.open(BytesIO(course_animation(TIME, QUANTITY, 1))) as picture:
        assert getattr(picture, "n_frames", 1) == FEW_FRAMES


def test_the_times_of_all_solves_are_drawn_from_the_first_on() -> None:
    count = np.arange(EPOCHS) + 1.0
    figure = costs_figure(SolveCosts(0.01 * count, 10 * count, 100 * count))
    assert len(set(titles(figure))) == 6
    for axes in figure.axes[:2]:
        line = axes.lines[0]
        assert len(line.get_xdata()) == EPOCHS  # pyright: ignore[reportArgumentType]
        assert np.asarray(line.get_ydata())[0] > 0.0
    nothing = np.full(EPOCHS, np.nan)
    costs_figure(SolveCosts(nothing, nothing, nothing)).savefig(BytesIO(), dpi=40)
