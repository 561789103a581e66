"""Body rates of every estimator over time, beside the true or measured ones."""

from typing import TYPE_CHECKING

from spinfilters.evaluation.rates import estimated_rates
from spinfilters.evaluation.span import initialisation_end
from spinfilters.pipeline.figure_entry import FigureEntry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from spinfilters.pipeline.figures import FigureData


class RatesFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.body_rates`."""

    name, order = "rates", 1
    caption = "Body rates of every estimator over time, beside the true or measured ones."

    def draw(self, shown: "FigureData", name: str) -> "Figure":
        """Body rates of all estimators and of the truth."""
        from spinfilters.plots.body_rates import rates_figure  # matplotlib is slow to import

        estimates = [estimated_rates(each.history) for each in shown.evaluations]
        return rates_figure(
            estimates, shown.reference, end_of_initialisation=initialisation_end(shown.evaluations)
        )


FIGURE = RatesFigure()
