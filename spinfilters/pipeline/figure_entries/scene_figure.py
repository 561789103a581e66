"""Path, principal axes and landmarks of the body before the camera, of the first estimator."""

from typing import TYPE_CHECKING

from spinfilters.pipeline.figure_entry import FigureEntry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from spinfilters.pipeline.figures import FigureData


class SceneFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.scene`."""

    name, order = "scene", 4
    caption = "Path, principal axes and landmarks of the body before the camera, of the first estimator."

    def draw(self, shown: "FigureData", name: str) -> "Figure":
        """Path, principal axes and landmarks of the first estimator."""
        from spinfilters.plots.scene import scene_figure  # matplotlib is slow to import

        first = shown.evaluations[0]
        smoothed = first.history.initialisation
        return scene_figure(first.trajectory, first.body, shown.camera, shown.map_points, smoothed)


FIGURE = SceneFigure()
