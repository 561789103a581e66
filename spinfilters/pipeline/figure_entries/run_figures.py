"""Figures of a run: what each draws of the run's data."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from spinfilters.evaluation.estimated_motion import estimated_rates
from spinfilters.evaluation.span import initialisation_end
from spinfilters.pipeline.figures import FigureData, FigureEntry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# matplotlib is slow to import: every figure imports its module when it is drawn


class SummaryFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.summary`."""

    name, order = "summary", 0
    caption = (
        "Rates, inertia ratios, errors with their standard deviations, observations and times, on one page."
    )

    def draw(self, shown: FigureData, name: str) -> "Figure":
        """Rates, inertia, errors and used measurements in one figure."""
        from spinfilters.plots.summary import summary_figure

        return summary_figure(shown.evaluations, shown.reference, shown.true_moments, shown.conditions)


class RatesFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.body_rates`."""

    name, order = "rates", 1
    caption = "Body rates of every estimator over time, beside the true or measured ones."

    def draw(self, shown: FigureData, name: str) -> "Figure":
        """Body rates of all estimators and of the truth."""
        from spinfilters.plots.body_rates import rates_figure

        estimates = [estimated_rates(each.history) for each in shown.evaluations]
        return rates_figure(
            estimates, shown.reference, end_of_initialisation=initialisation_end(shown.evaluations)
        )


class InertiaFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.inertia`."""

    name, order = "inertia", 2
    caption = "Principal moments of inertia of every estimator over time."

    def draw(self, shown: FigureData, name: str) -> "Figure":
        """Ratios of the principal moments over time."""
        from spinfilters.plots.inertia import inertia_figure

        return inertia_figure(shown.evaluations, shown.true_moments)


class PolhodeFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.polhode_on_ellipsoids`."""

    name, order = "polhode", 3
    caption = "Path of the body rate of the first estimator on its inertia ellipsoid."

    def draw(self, shown: FigureData, name: str) -> "Figure":
        """Polhode of the first estimator's rates."""
        from spinfilters.plots.polhode_on_ellipsoids import (
            estimated_polhode_figure,
        )

        first = shown.evaluations[0]
        return estimated_polhode_figure(
            estimated_rates(first.history), first.body, first.history.initialisation
        )


class SceneFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.scene`."""

    name, order = "scene", 4
    caption = "Path, principal axes and landmarks of the body before the camera, of the first estimator."

    def draw(self, shown: FigureData, name: str) -> "Figure":
        """Path, principal axes and landmarks of the first estimator."""
        from spinfilters.plots.scene import scene_figure

        first = shown.evaluations[0]
        smoothed = first.history.initialisation
        return scene_figure(first.trajectory, first.body, shown.camera, shown.map_points, smoothed)


class ConsistencyFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.consistency_bands`."""

    name, order = "consistency", 5
    caption = "NEES and NIS of every estimator with their chi-square bands."

    def draw(self, shown: FigureData, name: str) -> "Figure":
        """NEES, NIS and their bands over time."""
        from spinfilters.plots.consistency_bands import consistency_figure

        return consistency_figure(shown.evaluations)


class ErrorsFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.error_bands`."""

    name, order = "errors", 6
    caption = "Errors of one estimator over time, within three of their standard deviations."

    def names(self, estimators: Sequence[str]) -> tuple[str, ...]:
        """One file for each estimator."""
        return tuple(f"{self.name}-{each}" for each in estimators)

    def draw(self, shown: FigureData, name: str) -> "Figure":
        """Errors of one estimator with bands of its standard deviations."""
        from spinfilters.plots.error_bands import error_bands_figure

        evaluation = next(each for each in shown.evaluations if name == f"{self.name}-{each.name}")
        return error_bands_figure(evaluation)


FIGURE = (
    SummaryFigure(),
    RatesFigure(),
    InertiaFigure(),
    PolhodeFigure(),
    SceneFigure(),
    ConsistencyFigure(),
    ErrorsFigure(),
)
