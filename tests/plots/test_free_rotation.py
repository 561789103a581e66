"""Figures of free rotation say what they show, and draw bodies that cannot exist as such."""

import numpy as np
from matplotlib.figure import Figure

from spinfilters.core.spin_threshold import SPHERES
from spinfilters.plots.free_rotation import (
    cones_figure,
    polhode_figure,
    spin_threshold_figure,
    stability_figure,
)
from spinfilters.plots.style import picture_bytes


def words(figure: Figure) -> str:
    """All titles of a figure, once it is drawn."""
    assert picture_bytes(figure, "png", dpi=40)
    titles = [axes.get_title() or axes.get_title(loc="left") for axes in figure.axes]
    return "\n".join([figure.get_suptitle(), *titles])


def test_a_polhode_of_no_rigid_body_is_drawn_and_says_so() -> None:
    rate = np.array([2.0, 1.0, 1.0])
    assert "no rigid body" in words(polhode_figure(np.array([3.0, 1.0, 1.0 / 3.0]), rate))
    assert "no rigid body" not in words(polhode_figure(np.array([1.3, 1.0, 1.0 / 3.0]), rate))


def test_polhodes_that_are_points_or_the_separatrix_are_drawn() -> None:
    moments = np.array([1.3, 1.0, 0.5])
    assert "fixed rate" in words(polhode_figure(moments, np.array([0.0, 0.0, 1.0])))
    assert "intermediate axis" in words(polhode_figure(moments, np.array([0.0, 1.0, 0.0])))


def test_cones_name_their_sense() -> None:
    rate = np.array([0.5, 0.0, 1.0])
    assert "retrograde" in words(cones_figure(np.array([1.0, 1.0, 1.8]), rate))
    assert "prograde" in words(cones_figure(np.array([1.0, 1.0, 0.4]), rate))
    assert "not circular" in words(cones_figure(np.array([1.0, 0.9, 0.4]), rate))
    assert words(cones_figure(np.array([1.0, 1.0, 0.4]), np.array([0.0, 0.0, 1.0])))


def test_only_the_intermediate_axis_is_named_unstable() -> None:
    titles = words(stability_figure(np.array([1.3, 1.0, 0.5]), 1.0)).splitlines()
    assert ["unstable" in title for title in titles if title] == [False, True, False]


def test_the_threshold_of_a_mission_stands_in_its_title() -> None:
    assert "2.165 rpm" in words(spin_threshold_figure({"SPHERES": SPHERES}, {"target": 0.3}))
