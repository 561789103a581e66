"""NEES and NIS of every estimator with their chi-square bands."""

from typing import TYPE_CHECKING

from spinfilters.pipeline.figure_entry import FigureEntry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from spinfilters.pipeline.figures import FigureData


class ConsistencyFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.consistency_bands`."""

    name, order = "consistency", 5
    caption = "NEES and NIS of every estimator with their chi-square bands."

    def draw(self, shown: "FigureData", name: str) -> "Figure":
        """NEES, NIS and their bands over time."""
        from spinfilters.plots.consistency_bands import consistency_figure  # matplotlib is slow to import

        return consistency_figure(shown.evaluations)


FIGURE = ConsistencyFigure()
