"""The figures of a run: data of all, and their drawing."""

import gc
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from spinfilters.data.dataset import Dataset
from spinfilters.data.dataset_reader import read_dataset
from spinfilters.data.input_file import value_text
from spinfilters.errors import InputError
from spinfilters.evaluation.estimator_evaluation import Evaluation, evaluate
from spinfilters.evaluation.rates import BodyRates, measured_rates, true_rates
from spinfilters.evaluation.trajectory import read_map_ply
from spinfilters.evaluation.trajectory_errors import Alignment
from spinfilters.geometry.camera_trajectory import CameraTrajectory
from spinfilters.pipeline.conditions import conditions_of, told_sentences
from spinfilters.pipeline.estimation import Comparison
from spinfilters.pipeline.figure_entry import figure_entries
from spinfilters.pipeline.setup import knows_frames
from spinfilters.plots.scene import DrawnCamera
from spinfilters.plots.style import draw_figure, drawn
from spinfilters.runs.run_folder import DATASET_FOLDER, MAP_FILE, read_histories
from spinfilters.runs.run_summary import not_whole, read_summary
from spinfilters.state.status import Verdict


@dataclass(frozen=True)
class FigureData:
    """Data of all figures of a run.

    Evaluations of one data set, the landmarks (k, 3) if any, and sentences on its conditions.
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
        usable = [each for each in self.evaluations if each.history.status.verdict is not Verdict.FAILED]
        return min(usable, key=lambda each: each.name != "smoother", default=None)

    @property
    def camera(self) -> DrawnCamera | None:
        """Camera of the data set, None without one."""
        rig = self.dataset.rig
        return None if rig is None else DrawnCamera(rig, CameraTrajectory.of(self.dataset.inspector))

    @classmethod
    def from_comparison(cls, comparison: Comparison) -> "FigureData":
        """Figure data of a run that has just ended."""
        setup, first = comparison.setup, comparison.evaluations[0].name
        conditions = conditions_of(setup).sentences
        return cls(setup.dataset, comparison.evaluations, comparison.maps.get(first), conditions)

    @classmethod
    def from_folder(cls, folder: Path) -> "FigureData":
        """Figure data of a run folder.

        Raises
        ------
        InputError: a folder that is no run, or a damaged one.
        """
        document = read_summary(folder)
        dataset = read_dataset(folder / DATASET_FOLDER)
        alignment = Alignment.NONE if knows_frames(dataset) else Alignment.FIRST_FRAME
        try:
            names = [str(name) for name in document["estimators"]]
            map_path = folder / names[0] / MAP_FILE
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise not_whole(folder, error) from None
        histories = read_histories(folder, names)
        evaluations = [evaluate(history, dataset.truth, alignment) for history in histories]
        points = read_map_ply(map_path) if map_path.exists() else None
        return cls(dataset, evaluations, points, told_sentences(document))


def draw_run(
    figure_data: FigureData,
    folder: Path,
    progress: Callable[[int, int], None],
    wanted: Container[str] | None = None,
) -> list[str]:
    """Draw all or the wanted figures of a run as PNG files; returns names."""
    every = {f"{name}.png": draw for name, draw in _figures(figure_data)}
    figures = {name: draw for name, draw in every.items() if wanted is None or name in wanted}
    for index, (name, draw) in enumerate(figures.items()):
        progress(index, len(figures))
        draw_figure(draw, folder / name)
        gc.collect()  # a figure is a knot of references that would wait for the next ones
    progress(len(figures), len(figures))
    return list(figures)


def drawn_figure(figure_data: FigureData, name: str) -> Figure:
    """One figure of a run; a note where its numbers cannot be drawn.

    Raises
    ------
    InputError: no such figure, or one that needs what the run does not have.
    """
    figures = dict(_figures(figure_data))
    if name not in figures:
        missing = {entry.name: entry.lacks(figure_data) for entry in figure_entries()}.get(name)
        why = "is unknown" if missing is None else f"needs {missing}"
        raise InputError(f"figure {value_text(name)} {why}; choose from {', '.join(figures)}")
    return drawn(figures[name], name)


def _figures(figure_data: FigureData) -> Iterator[tuple[str, Callable[[], Figure]]]:
    """Every figure of the table that the run has what it needs for."""
    estimators = [evaluation.name for evaluation in figure_data.evaluations]
    for entry in figure_entries():
        if entry.lacks(figure_data) is None:
            for name in entry.names(estimators):
                yield name, partial(entry.draw, figure_data, name)
