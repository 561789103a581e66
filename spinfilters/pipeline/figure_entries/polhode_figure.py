"""Path of the body rate of the first estimator on its inertia ellipsoid."""

from typing import TYPE_CHECKING

from spinfilters.evaluation.rates import estimated_rates
from spinfilters.pipeline.figure_entry import FigureEntry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from spinfilters.pipeline.figures import FigureData


class PolhodeFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.polhode_on_ellipsoids`."""

    name, order = "polhode", 3
    caption = "Path of the body rate of the first estimator on its inertia ellipsoid."

    def draw(self, shown: "FigureData", name: str) -> "Figure":
        """Polhode of the first estimator's rates."""
        from spinfilters.plots.polhode_on_ellipsoids import (
            estimated_polhode_figure,  # matplotlib is slow to import
        )

        first = shown.evaluations[0]
        return estimated_polhode_figure(
            estimated_rates(first.history), first.body, first.history.initialisation
        )


FIGURE = PolhodeFigure()
