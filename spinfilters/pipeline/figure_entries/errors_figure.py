"""Errors of one estimator over time, within three of their standard deviations."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from spinfilters.pipeline.figure_entry import FigureEntry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from spinfilters.pipeline.figures import FigureData


class ErrorsFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.error_bands`."""

    name, order = "errors", 6
    caption = "Errors of one estimator over time, within three of their standard deviations."

    def names(self, estimators: Sequence[str]) -> tuple[str, ...]:
        """One file for each estimator."""
        return tuple(f"{self.name}-{each}" for each in estimators)

    def draw(self, shown: "FigureData", name: str) -> "Figure":
        """Errors of one estimator with bands of its standard deviations."""
        from spinfilters.plots.error_bands import error_bands_figure  # matplotlib is slow to import

        evaluation = next(each for each in shown.evaluations if name == f"{self.name}-{each.name}")
        return error_bands_figure(evaluation)


FIGURE = ErrorsFigure()
