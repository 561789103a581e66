"""The figures of torque-free motion show the data that they were given, with units on every axis."""

from io import BytesIO

import numpy as np
import pytest
from matplotlib.figure import Figure

from spinfilters.conventions import RPM
from spinfilters.dynamics.axis_stability import axis_stability
from spinfilters.dynamics.polhode import polhode
from spinfilters.dynamics.spin_threshold import ORBITAL_EXPRESS, SPHERES, spin_threshold
from spinfilters.dynamics.torque_free import torque_free_motion
from spinfilters.plots.dynamics import axis_stability_figure, polhode_figure, spin_threshold_figure

MOMENTS = np.array([3.0, 2.0, 1.5])


def rendered_size(figure: Figure) -> int:
    """Bytes of the figure as PNG; drawing it raises what is wrong with it."""
    target = BytesIO()
    figure.savefig(target, dpi=50)
    return len(target.getvalue())


@pytest.mark.parametrize("rate", [[1.5, 0.8, 0.6], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
def test_polhode_figure_draws_both_curves_and_units(rate: list[float]) -> None:
    curve = polhode(MOMENTS, np.array(rate))
    figure = polhode_figure(curve, np.array(rate))
    axes = figure.axes[0]
    assert len(axes.lines) == 3
    assert all("[rad/s]" in label for label in (axes.get_xlabel(), axes.get_ylabel()))
    assert curve.kind.value in axes.get_title()
    assert rendered_size(figure) > 5000


def test_axis_stability_figure_draws_the_rates_and_names_the_verdict() -> None:
    time = np.linspace(0.0, 60.0, 301)
    starts = [np.roll([1.0, 0.05, 0.0], axis) for axis in range(3)]
    motions = [torque_free_motion(MOMENTS, start, time) for start in starts]
    figure = axis_stability_figure(motions, axis_stability(MOMENTS, 1.0))
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert ["unstable" in title for title in titles] == [False, True, False]
    assert np.array_equal(np.asarray(figure.axes[1].lines[2].get_ydata()), motions[1].rate[:, 2])
    assert figure.axes[2].get_xlabel() == "time [s]"
    assert rendered_size(figure) > 5000


def test_spin_threshold_figure_marks_the_missions_on_the_lower_limit() -> None:
    radii = np.geomspace(0.3, 100.0, 30)
    figure = spin_threshold_figure({"SPHERES": SPHERES, "Orbital Express": ORBITAL_EXPRESS}, radii)
    for axes, mission in zip(figure.axes, (SPHERES, ORBITAL_EXPRESS), strict=True):
        mark = axes.lines[2]
        assert list(np.asarray(mark.get_xdata())) == [mission.station_keeping_radius]
        assert np.asarray(mark.get_ydata())[0] == pytest.approx(spin_threshold(mission).overall / RPM)
        assert "[m]" in axes.get_xlabel()
    assert "[rpm]" in figure.axes[0].get_ylabel()
    assert rendered_size(figure) > 5000
