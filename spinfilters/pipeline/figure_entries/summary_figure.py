"""Rates, inertia ratios, errors with their standard deviations, observations and times, on one page."""

from typing import TYPE_CHECKING

from spinfilters.pipeline.figure_entry import FigureEntry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from spinfilters.pipeline.figures import FigureData


class SummaryFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.summary`."""

    name, order = "summary", 0
    caption = (
        "Rates, inertia ratios, errors with their standard deviations, observations and times, on one page."
    )

    def draw(self, shown: "FigureData", name: str) -> "Figure":
        """Rates, inertia, errors and used measurements in one figure."""
        from spinfilters.plots.summary import summary_figure  # matplotlib is slow to import

        return summary_figure(shown.evaluations, shown.reference, shown.true_moments, shown.conditions)


FIGURE = SummaryFigure()
