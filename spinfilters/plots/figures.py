"""The figures of a run: interface, the table of all, their data, and their drawing."""

import gc
from abc import ABC, abstractmethod
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.camera_trajectory import CameraTrajectory
from spinfilters.core.errors import InputError
from spinfilters.core.plugins import (
    entries_by_name,
    in_order,
    installed_plugins,
    require_file_name,
    require_made,
)
from spinfilters.evaluation.epoch_spans import initialisation_end
from spinfilters.evaluation.estimated_motion import BodyRates, estimated_rates, measured_rates, true_rates
from spinfilters.evaluation.estimator_evaluation import Evaluation, not_failed
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import value_text
from spinfilters.io.output_files import write_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from spinfilters.plots.scene import DrawnCamera


# matplotlib is slow to import: what draws is imported when it draws


@dataclass(frozen=True)
class FigureData:
    """Data of all figures of a run.

    Attributes
    ----------
    dataset : Dataset
        That all estimators took.
    evaluations : sequence of Evaluation
        One for each estimator.
    map_points : ndarray of float, shape (k, 3) or None
        Landmarks of the first estimator, m, frame g; None without any.
    conditions : sequence of str
        Sentences on the map, the seed and the noise.
    """

    dataset: Dataset
    evaluations: Sequence[Evaluation]
    map_points: Float[np.ndarray, "k 3"] | None
    conditions: Sequence[str] = ()

    @property
    def true_moments(self) -> Float[np.ndarray, " 3"] | None:
        """Principal moments of the truth, None without one."""
        return None if self.dataset.truth is None else self.dataset.truth.principal_moments

    @property
    def reference(self) -> BodyRates | None:
        """True rates, or else what a gyro measured."""
        truth, errors = self.dataset.truth, self.evaluations[0].errors
        if truth is not None and errors is not None:
            return true_rates(truth, errors.frame)
        return measured_rates(self.dataset.log)

    @property
    def most_exact(self) -> Evaluation | None:
        """Evaluation of the smoother, else of the first estimator that has not failed."""
        usable = not_failed(self.evaluations)
        return min(usable, key=lambda each: each.name != "smoother", default=None)

    @property
    def camera(self) -> "DrawnCamera | None":
        """Camera of the data set, None without one."""
        from spinfilters.plots.scene import DrawnCamera

        rig = self.dataset.rig
        return None if rig is None else DrawnCamera(rig, CameraTrajectory.of(self.dataset.inspector))


class FigureEntry(ABC):
    """A figure of the table.

    A subclass states its attributes and writes `draw`; what else it does differently it overrides.

    Attributes
    ----------
    name : str
        As in ``run.figure(name)``, and of its PNG file.
    caption : str
        What it shows, a sentence.
    order : int
        Of the table.
    """

    name: str
    caption: str
    order: int = 100

    def names(self, estimators: Sequence[str]) -> tuple[str, ...]:
        """Names of the figures in a run of these estimators; one, unless it draws each estimator by itself.

        Parameters
        ----------
        estimators : sequence of str
            Names of the estimators of the run.

        Returns
        -------
        tuple[str, ...]
            Names, without the suffix of a file.
        """
        return (self.name,)

    def shown_estimates(self, name: str, estimators: Sequence[str]) -> tuple[str, ...] | None:
        """Estimators whose estimates alone the figure shows, so that it can be drawn as soon as these have ended.

        Parameters
        ----------
        name : str
            One of `names`.
        estimators : sequence of str
            Names of the estimators of the run.

        Returns
        -------
        tuple[str, ...] or None
            Their names; None where it shows more, such as verdicts, and is drawn when the whole run is written.
        """
        return None

    def lacks(self, shown: FigureData) -> str | None:
        """Noun for what the figure needs and a run lacks; None where it can be drawn.

        Parameters
        ----------
        shown : FigureData
            Data of the run.

        Returns
        -------
        str or None
            Such as "truth", for a message.
        """
        return None

    @abstractmethod
    def draw(self, shown: FigureData, name: str) -> "Figure":
        """The figure of one of its names.

        Parameters
        ----------
        shown : FigureData
            Data of the run.
        name : str
            One of `names`.

        Returns
        -------
        Figure
            Not yet saved or shown.
        """


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
    """Figure entry of `spinfilters.plots.time_courses`."""

    name, order = "rates", 1
    caption = "Body rates of every estimator over time, axes of g, with the true or measured ones."

    def shown_estimates(self, name: str, estimators: Sequence[str]) -> tuple[str, ...]:
        """Those of all."""
        return tuple(estimators)

    def draw(self, shown: FigureData, name: str) -> "Figure":
        """Body rates of all estimators and of the truth."""
        from spinfilters.plots.time_courses import rates_figure

        estimates = [estimated_rates(each.history) for each in shown.evaluations]
        return rates_figure(
            estimates, shown.reference, end_of_initialisation=initialisation_end(shown.evaluations)
        )


class InertiaFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.summary`."""

    name, order = "inertia", 2
    caption = "Principal moments of inertia of every estimator over time."

    def shown_estimates(self, name: str, estimators: Sequence[str]) -> tuple[str, ...]:
        """Those of all."""
        return tuple(estimators)

    def draw(self, shown: FigureData, name: str) -> "Figure":
        """Ratios of the principal moments over time."""
        from spinfilters.plots.summary import inertia_figure

        return inertia_figure(shown.evaluations, shown.true_moments)


class PolhodeFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.scene`."""

    name, order = "polhode", 3
    caption = "Path of the body rate of the first estimator on its inertia ellipsoid."

    def shown_estimates(self, name: str, estimators: Sequence[str]) -> tuple[str, ...]:
        """Those of the first."""
        return (estimators[0],)

    def draw(self, shown: FigureData, name: str) -> "Figure":
        """Polhode of the first estimator's rates."""
        from spinfilters.plots.scene import estimated_polhode_figure

        first = shown.evaluations[0]
        return estimated_polhode_figure(
            estimated_rates(first.history), first.body, first.history.initialisation
        )


class SceneFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.scene`."""

    name, order = "scene", 4
    caption = "Path, principal axes and landmarks of the body before the camera, of the first estimator."

    def shown_estimates(self, name: str, estimators: Sequence[str]) -> tuple[str, ...]:
        """Those of the first."""
        return (estimators[0],)

    def draw(self, shown: FigureData, name: str) -> "Figure":
        """Path, principal axes and landmarks of the first estimator."""
        from spinfilters.plots.scene import scene_figure

        first = shown.evaluations[0]
        smoothed = first.history.initialisation
        return scene_figure(first.trajectory, first.body, shown.camera, shown.map_points, smoothed)


class ConsistencyFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.time_courses`."""

    name, order = "consistency", 5
    caption = "NEES and NIS of every estimator with their chi-square bands."

    def shown_estimates(self, name: str, estimators: Sequence[str]) -> tuple[str, ...]:
        """Those of all."""
        return tuple(estimators)

    def draw(self, shown: FigureData, name: str) -> "Figure":
        """NEES, NIS and their bands over time."""
        from spinfilters.plots.time_courses import consistency_figure

        return consistency_figure(shown.evaluations)


class ErrorsFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.time_courses`."""

    name, order = "errors", 6
    caption = "Errors of one estimator over time, within three of their standard deviations."

    def names(self, estimators: Sequence[str]) -> tuple[str, ...]:
        """One file for each estimator."""
        return tuple(f"{self.name}-{each}" for each in estimators)

    def shown_estimates(self, name: str, estimators: Sequence[str]) -> tuple[str, ...]:
        """Those of one."""
        return tuple(each for each in estimators if name == f"{self.name}-{each}")

    def draw(self, shown: FigureData, name: str) -> "Figure":
        """Errors of one estimator with bands of its standard deviations."""
        from spinfilters.plots.time_courses import error_bands_figure

        evaluation = next(each for each in shown.evaluations if name == f"{self.name}-{each.name}")
        return error_bands_figure(evaluation)


class EnergyFigure(FigureEntry):
    """Figure entry of `spinfilters.plots.time_courses`."""

    name, order = "energy", 7
    caption = "Kinetic energy of rotation and translation of every estimator, with the true ones."

    def lacks(self, shown: FigureData) -> str | None:
        """A truth."""
        return "truth" if shown.dataset.truth is None else None

    def shown_estimates(self, name: str, estimators: Sequence[str]) -> tuple[str, ...]:
        """Those of all."""
        return tuple(estimators)

    def draw(self, shown: FigureData, name: str) -> "Figure":
        """Energies of all estimators and of the truth."""
        from spinfilters.plots.time_courses import energy_figure

        assert shown.dataset.truth is not None
        return energy_figure(shown.evaluations, shown.dataset.truth)


OWN: Final[tuple[FigureEntry, ...]] = (
    SummaryFigure(),
    RatesFigure(),
    InertiaFigure(),
    PolhodeFigure(),
    SceneFigure(),
    ConsistencyFigure(),
    ErrorsFigure(),
    EnergyFigure(),
)
"""Figures of this package."""


def figure_entries() -> list[FigureEntry]:
    """All figures, in their order: these, and those of the entry points ``spinfilters.figures``.

    InputError: a plug-in that cannot be loaded, a name that stands twice.

    Returns
    -------
    list of FigureEntry
        Members of the table, sorted by ``order``.
    """
    others = installed_plugins("spinfilters.figures", FigureEntry)
    return list(entries_by_name(in_order((*OWN, *others)), "figure").values())


def picture_files(estimators: Sequence[str]) -> list[str]:
    """Files of the figures of a run of these estimators.

    Parameters
    ----------
    estimators : sequence of str
        Names of the estimators of the run.

    Returns
    -------
    list of str
        Names of PNG files.
    """
    return [f"{name}.png" for entry in figure_entries() for name in _names_of(entry, estimators)]


def early_pictures(
    estimators: Sequence[str], made: Sequence[str]
) -> Iterator[tuple[tuple[str, ...], list[str]]]:
    """Files of figures that show estimates alone, of those estimators of a run that have made theirs.

    Parameters
    ----------
    estimators : sequence of str
        Names of all estimators of the run.
    made : sequence of str
        Names of those that have ended.

    Yields
    ------
    tuple[str, ...]
        Estimators that these figures show.
    list of str
        Names of PNG files.
    """
    found: dict[tuple[str, ...], list[str]] = {}
    for entry in figure_entries():
        for name in _names_of(entry, estimators):
            shown = entry.shown_estimates(name, estimators)
            if shown and set(shown) <= set(made):
                found.setdefault(shown, []).append(f"{name}.png")
    yield from found.items()


def _names_of(entry: FigureEntry, estimators: Sequence[str]) -> tuple[str, ...]:
    """Names of the files of an entry's figures. InputError: a plug-in's that are no such names."""
    names = require_made(entry.names(estimators), tuple, f"names of the figure {entry.name!r}")
    for name in names:
        require_file_name(name, f"figure {entry.name!r}")
    return names


def _draw_entry(entry: FigureEntry, figure_data: FigureData, name: str) -> "Figure":
    """A figure of an entry. InputError: a plug-in drew something else."""
    from matplotlib.figure import Figure

    return require_made(entry.draw(figure_data, name), Figure, f"figure {name!r}")


def draw_run(
    figure_data: FigureData,
    folder: Path,
    progress: Callable[[int, int], None],
    wanted: Container[str] | None = None,
) -> list[str]:
    """Draw all or the wanted figures of a run as PNG files; returns names.

    Parameters
    ----------
    figure_data : FigureData
        Data of the run.
    folder : Path
        Of the run.
    progress : Callable[[int, int], None]
        Called with figures done and figures in all.
    wanted : Container[str] or None
        Names of the files to draw; None for all.

    Returns
    -------
    list of str
        Names of the files that were drawn.
    """
    names = []
    for name, content in drawn_pictures(figure_data, progress, wanted):
        write_bytes(folder / name, content)
        names.append(name)
    return names


def drawn_pictures(
    figure_data: FigureData, progress: Callable[[int, int], None], wanted: Container[str] | None = None
) -> Iterator[tuple[str, bytes]]:
    """Names and contents of all or the wanted PNG files of a run, each drawn when it is asked for; arguments as of `draw_run`."""
    from spinfilters.plots.style import drawn_png

    every = [(f"{name}.png", draw) for name, draw in _figures(figure_data)]
    figures = [(name, draw) for name, draw in every if wanted is None or name in wanted]
    with _searched_behind_figures() if figures else nullcontext():
        for index, (name, draw) in enumerate(figures):
            progress(index, len(figures))
            yield name, drawn_png(draw, Path(name).stem)
            gc.collect()  # a figure is a knot of references that would wait for the next ones
    progress(len(figures), len(figures))


@contextmanager
def _searched_behind_figures() -> Iterator[None]:
    """Let the garbage collector search where it is asked to, and only what is new: a figure has very many objects."""
    is_frozen, is_enabled = gc.get_freeze_count() > 0, gc.isenabled()
    gc.disable()
    if not is_frozen:
        gc.freeze()
    try:
        yield
    finally:
        if not is_frozen:
            gc.unfreeze()
        if is_enabled:
            gc.enable()


def drawn_figure(figure_data: FigureData, name: str, others: Iterable[str] = ()) -> "Figure":
    """One figure of a run; a note where its numbers cannot be drawn.

    Parameters
    ----------
    figure_data : FigureData
        Data of the run.
    name : str
        Of a figure, without the suffix of its file.
    others : iterable of str
        Names that the caller draws itself, for the message.

    Returns
    -------
    Figure
        Not yet saved or shown.

    Raises
    ------
    InputError
        No such figure, or one that needs what the run does not have.
    """
    from spinfilters.plots.style import drawn

    figures = dict(_figures(figure_data))
    if name not in figures:
        missing = {entry.name: entry.lacks(figure_data) for entry in figure_entries()}.get(name)
        why = "is unknown" if missing is None else f"needs {missing}"
        raise InputError(f"figure {value_text(name)} {why}; choose from {', '.join((*figures, *others))}")
    return drawn(figures[name], name)


def figure_names(figure_data: FigureData) -> list[str]:
    """Names of the figures that a run has what it needs for.

    Parameters
    ----------
    figure_data : FigureData
        Data of the run.
    """
    return [name for name, _ in _figures(figure_data)]


def _figures(figure_data: FigureData) -> Iterator[tuple[str, Callable[[], "Figure"]]]:
    """Every figure of the table that the run has what it needs for."""
    estimators = [evaluation.name for evaluation in figure_data.evaluations]
    for entry in figure_entries():
        if entry.lacks(figure_data) is None:
            for name in _names_of(entry, estimators):
                yield name, partial(_draw_entry, entry, figure_data, name)
