"""Figures as a paper prints them: format, width and panels; titles differ, and colours of axes are no estimator's."""

import re

import numpy as np
import pytest
from matplotlib.figure import Figure

from spinfilters.core.errors import InputError
from spinfilters.plots.figures import FigureData, drawn_figure, figure_names
from spinfilters.plots.printing import INCH_MM, PrintStyle, figure_panels, printed_figure
from spinfilters.plots.style import AXIS_COLOURS, estimator_lines
from spinfilters.settings.run_settings import estimator_names
from spinfilters.simulation.scenario import Scenario, simulate
from tests.plots.run_samples import full_runs


def drawn() -> Figure:
    """Two panels with shared axes, a colour bar and a legend of both."""
    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    left.plot([0, 1], [1, 2], label="one")
    left.set(title="first", xlabel="time [s]", ylabel="rate")
    image = right.imshow(np.eye(3))
    right.set_title("second")
    figure.colorbar(image, ax=right)
    figure.legend(loc="outside lower center")
    return figure


def svg_width_mm(content: bytes) -> float:
    """Width that an SVG file states, in points there."""
    found = re.search(r'<svg [^>]*width="([0-9.]+)pt"', content.decode())
    assert found is not None
    return float(found[1]) / 72.0 * INCH_MM


def test_panels_are_files_of_the_width_with_a_legend_beside_them() -> None:
    files = printed_figure(drawn(), "rates", PrintStyle("svg", 84.0, panels=True))
    assert list(files) == ["rates-1.svg", "rates-2.svg", "rates-legend.svg"]
    for name in ("rates-1.svg", "rates-2.svg"):
        assert svg_width_mm(files[name]) == pytest.approx(84.0, abs=0.5)


def test_a_whole_figure_is_scaled_to_the_width_and_keeps_its_proportions() -> None:
    ((name, content),) = printed_figure(drawn(), "rates", PrintStyle("svg", 174.0)).items()
    assert name == "rates.svg"
    assert svg_width_mm(content) == pytest.approx(174.0, abs=0.1)
    assert 'viewBox="0 0 648 288"' in content.decode()
    (content,) = printed_figure(drawn(), "rates", PrintStyle("pdf")).values()
    assert content.startswith(b"%PDF")
    (content,) = printed_figure(drawn(), "rates", PrintStyle("pdf", INCH_MM)).values()
    assert b"/MediaBox [ 0 0 72 32 ]" in content


def test_a_narrow_figure_is_laid_out_in_its_own_size() -> None:
    figure = Figure(figsize=(9.0, 9.0), layout="constrained")
    for axes in figure.subplots(12, 3).flat:
        axes.set(title="a panel", ylabel="value")
    for form in ("pdf", "svg", "png"):  # a warning that nothing could be laid out would be an error here
        assert printed_figure(figure, "panels", PrintStyle(form, 30.0))


def test_colour_bars_are_no_panels() -> None:
    assert [axes.get_title() for axes in figure_panels(drawn())] == ["first", "second"]


@pytest.mark.parametrize("width", [0.0, -1.0, float("nan")])
def test_a_width_that_is_none_is_refused(width: float) -> None:
    with pytest.raises(InputError, match="must be positive"):
        PrintStyle("pdf", width)


def test_axes_and_estimators_never_share_a_colour() -> None:
    names = estimator_names()
    assert not {line.color for line in estimator_lines(names)} & set(AXIS_COLOURS)


def test_no_two_panels_of_a_figure_share_a_title() -> None:
    runs = full_runs()
    shown = FigureData(simulate(Scenario.simplified(kind="pose", epochs=20)), runs.with_truth, None)
    for name in figure_names(shown):
        figure = drawn_figure(shown, name)
        titles = [axes.get_title(loc="left") or axes.get_title() for axes in figure_panels(figure)]
        assert len(set(titles)) == len(titles), name
