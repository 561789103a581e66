"""Principal moments of inertia of every estimator over time."""

from typing import TYPE_CHECKING

from spinfilters.pipeline.figure_entry import FigureEntry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from spinfilters.pipeline.figures import FigureData


class InertiaFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.inertia`."""

    name, order = "inertia", 2
    caption = "Principal moments of inertia of every estimator over time."

    def draw(self, shown: "FigureData", name: str) -> "Figure":
        """Ratios of the principal moments over time."""
        from spinfilters.plots.inertia import inertia_figure  # matplotlib is slow to import

        return inertia_figure(shown.evaluations, shown.true_moments)


FIGURE = InertiaFigure()
