"""Results of a comparison: a run with one result per estimator."""

import os
import shutil
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from html import escape
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from rich.console import Console, RenderableType

from spinfilters.data.argument_checks import checked_arguments, path, text
from spinfilters.data.dataset import Dataset
from spinfilters.data.input_file import value_text
from spinfilters.errors import InputError
from spinfilters.evaluation.body import BodyEstimate
from spinfilters.evaluation.comparison import ComparisonCells, comparison_cells, comparison_table
from spinfilters.evaluation.estimated_motion import (
    TRAJECTORY_COLUMNS,
    Trajectory,
    read_map_ply,
    trajectory_columns,
)
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.pipeline.comparison_run import write_comparison
from spinfilters.pipeline.conditions import conditions_of
from spinfilters.pipeline.estimation import Comparison
from spinfilters.runs.run_folder import MAP_FILE, read_figure_data
from spinfilters.runs.run_summary import read_summary, summary
from spinfilters.settings.run_settings import Settings
from spinfilters.state.status import verdict_sentences

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class EstimatorResult:
    """Result of one estimator.

    Attributes
    ----------
    evaluation: everything that was computed of it, `spinfilters.evaluation.estimator_evaluation.Evaluation`.
    landmarks: (k, 3) m in frame g, the map that it ended with or was given; None without any.
    """

    evaluation: Evaluation
    landmarks: Float[np.ndarray, "k 3"] | None = None

    @property
    def name(self) -> str:
        """Name of the estimator."""
        return self.evaluation.name

    @property
    def status(self) -> str:
        """Whether it can be trusted: "ok", "degraded" or "failed"."""
        return str(self.evaluation.history.status.verdict)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons for a status other than "ok": sentences with their numbers; empty otherwise."""
        return self.evaluation.history.status.reasons

    @property
    def holds(self) -> dict[str, str]:
        """Whether each quantity holds: "ok", "doubtful" or "not determined", whatever the status of the whole.

        Quantities are "position" (of the centre of mass), "attitude", "velocity", "rate", "moments", "axes" and
        "center_of_mass" (in the body). Empty of runs that older versions made.
        """
        return {name: str(state) for name, state in self.evaluation.history.status.holds.items()}

    @property
    def checks(self) -> tuple[str, ...]:
        """Names of the checks that failed, as ``docs/reference/checks.md`` lists them."""
        return tuple(each.check for each in self.evaluation.history.status.findings)

    @property
    def body(self) -> BodyEstimate:
        """The body after the last epoch.

        ``principal_moments`` (3,), ascending, largest = 1; ``principal_axes_g`` (3, 3), rows are unit axes in g;
        ``center_of_mass_g`` (3,) m, None for a gyro alone; standard deviations as ``principal_moments_std`` (3,),
        ``principal_axes_std`` (3,) rad, ``center_of_mass_std`` (3,) m. NaN where the estimator failed.
        """
        return self.evaluation.body

    @cached_property
    def trajectory(self) -> Trajectory:
        """Motion after every epoch.

        ``time`` (n,) s, ``position`` (n, 3) of the centre of mass in i, m, ``q_ig`` (n, 4), ``velocity`` (n, 3) in i, m/s,
        ``rate_i`` (n, 3) in i axes, rad/s; ``std_position``, ``std_attitude`` (rad, g axes), ``std_velocity``, ``std_rate``,
        each (n, 3).
        """
        return self.evaluation.trajectory

    def to_dataframe(self) -> Any:
        """The trajectory as a pandas.DataFrame over ``time_s``, with the columns of ``trajectory.csv``.

        Raises
        ------
        ImportError: pandas is not installed.
        """
        columns = dict(zip(TRAJECTORY_COLUMNS, trajectory_columns(self.trajectory), strict=True))
        return data_frame(columns, TRAJECTORY_COLUMNS[0])

    def __repr__(self) -> str:
        moments = ", ".join(f"{value:.4f}" for value in self.body.principal_moments)
        epochs = len(self.evaluation.history.time)
        return f"<{self.name}: {self.status}, {epochs} epochs, principal moments {moments}>"


@dataclass(frozen=True, eq=False, repr=False)
class Run(Mapping[str, EstimatorResult]):
    """Results of estimators on one data set, by the estimator's name.

    Printed, and shown in a notebook, it is the table of the command.

    Attributes
    ----------
    dataset, settings: that it was made with.   results: by name of the estimator.
    conditions: sentences on the map, the seed and the noise.   summary: the content of ``summary.json``.
    comparison: what the estimators left behind, None where the run was read from its folder.
    folder: that holds the run, None where it was not written.
    """

    dataset: Dataset
    settings: Settings
    results: Mapping[str, EstimatorResult]
    conditions: tuple[str, ...]
    summary: Mapping[str, Any]
    comparison: Comparison | None = None
    folder: Path | None = None

    @classmethod
    def from_comparison(cls, comparison: Comparison, settings: Settings, folder: Path | None = None) -> "Run":
        """Run of a comparison that has just ended."""
        results = {e.name: EstimatorResult(e, comparison.maps.get(e.name)) for e in comparison.evaluations}
        setup = comparison.setup
        conditions = tuple(conditions_of(setup).sentences)
        return cls(setup.dataset, settings, results, conditions, summary(comparison), comparison, folder)

    @classmethod
    def from_folder(cls, folder: Path, settings: Settings) -> "Run":
        """Run of a complete run folder. InputError: a damaged one."""
        shown_run = read_figure_data(folder)
        maps = {e.name: folder / e.name / MAP_FILE for e in shown_run.evaluations}
        landmarks = {name: read_map_ply(path) for name, path in maps.items() if path.exists()}
        results = {e.name: EstimatorResult(e, landmarks.get(e.name)) for e in shown_run.evaluations}
        conditions = tuple(shown_run.conditions)
        return cls(shown_run.dataset, settings, results, conditions, read_summary(folder), None, folder)

    def __getitem__(self, name: str) -> EstimatorResult:
        if name not in self.results:
            raise KeyError(f"{value_text(name)} is not in this run; it has {', '.join(self.results)}")
        return self.results[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.results)

    def __len__(self) -> int:
        return len(self.results)

    @property
    def remarks(self) -> list[str]:
        """A sentence per reason for which estimators are not "ok"."""
        return verdict_sentences({each.name: each.evaluation.history.status for each in self.values()})

    @checked_arguments(name=text('the name of a figure, such as "summary"'))
    def figure(self, name: str = "summary") -> "Figure":
        """One of the run's pictures as a matplotlib figure, which can be shown or saved (`savefig`).

        Parameters
        ----------
        name: of the table of figures: "summary", "rates", "inertia", "polhode", "scene", "consistency", "errors-mekf" (or
            another estimator's), or that of an installed figure.

        Raises
        ------
        InputError: no such figure, or one that needs what the run does not have.
        """
        from spinfilters.pipeline.figures import FigureData, drawn_figure

        landmarks = next(iter(self.values())).landmarks
        return drawn_figure(FigureData(self.dataset, self._evaluations, landmarks, self.conditions), name)

    @checked_arguments(folder=path("a folder"))
    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write the run folder of the command, with its pictures; returns its path.

        Raises
        ------
        InputError: the folder holds something else than a run or cannot be written; the run was read from a folder itself.
        """
        if self.comparison is None:
            raise InputError(f"this run was read from {self.folder}; copy that folder")
        write_comparison(Path(folder), self.comparison, self.settings)
        return Path(folder)

    def to_dataframe(self) -> Any:
        """The numbers of ``summary.json`` as a pandas.DataFrame, a row per estimator.

        Tables as ``a.b``, lists as ``a_1``.

        Raises
        ------
        ImportError: pandas is not installed.
        """
        rows = [{"estimator": name} | dict(flattened(self.summary["estimators"][name], "")) for name in self]
        names = dict.fromkeys(name for row in rows for name in row)
        return data_frame({name: [row.get(name) for row in rows] for name in names}, "estimator")

    def __str__(self) -> str:
        return "\n".join([plain_text(comparison_table(self._evaluations, self.conditions)), *self.remarks])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        """For a notebook."""
        return html_table(comparison_cells(self._evaluations, self.conditions), self.remarks)

    @property
    def _evaluations(self) -> list[Evaluation]:
        return [each.evaluation for each in self.values()]


WIDTH = 150
"""Characters of a table where the terminal does not tell its own."""


def plain_text(table: RenderableType) -> str:
    """A table without colours, as wide as the terminal, or `WIDTH` where there is none."""
    width = shutil.get_terminal_size((WIDTH, 24)).columns if sys.stdout.isatty() else WIDTH
    stream = StringIO()
    console = Console(file=stream, width=width, markup=False, emoji=False, color_system=None)
    console.print(table)
    return stream.getvalue().rstrip("\n")


def html_table(cells: ComparisonCells, remarks: list[str]) -> str:
    """The table for a notebook, its texts escaped; ``remarks`` are sentences below it."""
    head = "".join(f"<th>{escape(text)}</th>" for text in ("", *cells.headings))
    bodies = ("".join(_html_row(row) for row in section) for section in cells.sections if section)
    below = [*cells.captions, *remarks]
    return (
        f"<table><caption>{_html_lines(cells.title)}</caption><thead><tr>{head}</tr></thead>"
        f"{''.join(f'<tbody>{rows}</tbody>' for rows in bodies)}</table>"
        f"<p>{_html_lines(below)}</p>"
    )


def data_frame(columns: Mapping[str, Any], index: str) -> Any:
    """pandas.DataFrame of columns of equal length, one of which is its index.

    Raises
    ------
    ImportError: pandas is not installed.
    """
    try:
        pandas = import_module("pandas")
    except ImportError:
        raise ImportError(
            "to_dataframe needs pandas, which is not installed; install it with 'pip install pandas'"
        ) from None
    return pandas.DataFrame(dict(columns)).set_index(index)


def flattened(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Flat names and values of a document's numbers and words.

    ``a.b`` of tables, ``a_1`` of lists; a list of sentences is one text.
    """
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from flattened(inner, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list) and all(isinstance(each, str) for each in value):
        yield name, "; ".join(value)
    elif isinstance(value, list):
        for number, inner in enumerate(value, start=1):
            yield from flattened(inner, f"{name}_{number}")
    else:
        yield name, value


def _html_row(row: tuple[str, ...]) -> str:
    name, *cells = row
    indent = "&nbsp;" * (len(name) - len(name.lstrip()))
    numbers = "".join(f'<td style="text-align:right">{escape(cell)}</td>' for cell in cells)
    return f'<tr><th style="text-align:left">{indent}{escape(name.strip())}</th>{numbers}</tr>'


def _html_lines(lines: list[str] | tuple[str, ...]) -> str:
    return "<br>".join(map(escape, lines))
