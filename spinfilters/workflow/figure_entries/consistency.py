"""NEES and NIS of every estimator with their chi-square bands."""

from typing import TYPE_CHECKING

from spinfilters.workflow.figure_entry import FigureEntry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from spinfilters.workflow.figures import Pictured


class ConsistencyFigure(FigureEntry):
    """See `spinfilters.plots.consistency`."""

    name, order = "consistency", 5
    caption = "NEES and NIS of every estimator with their chi-square bands."

    def draw(self, shown: "Pictured", name: str) -> "Figure":
        from spinfilters.plots.consistency import consistency_figure  # matplotlib is slow to import

        return consistency_figure(shown.evaluations)


FIGURE = ConsistencyFigure()
