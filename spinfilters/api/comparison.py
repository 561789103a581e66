"""The comparison of estimators from Python: `compare`, `load_run`, and the `Run` that they return."""

import os
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from jaxtyping import Float
from rich.console import Console, RenderableType

from spinfilters.api.arguments import RunArguments
from spinfilters.api.blas_threads import on_one_blas_thread
from spinfilters.api.given_settings import SETTINGS_GIVEN, AnySettings, chosen_settings
from spinfilters.core.errors import InputError
from spinfilters.evaluation.comparison_table import ComparisonCells, comparison_cells, comparison_table
from spinfilters.evaluation.estimated_motion import (
    TRAJECTORY_COLUMNS,
    Trajectory,
    read_map_ply,
    trajectory_columns,
)
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.io.argument_checks import (
    ESTIMATORS,
    KIND,
    called,
    checked_arguments,
    is_path,
    names,
    one_of,
    optional,
    path,
    plain_numbers,
    refuse,
    text,
)
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import path_text, value_text
from spinfilters.io.stated_values import ReadingOptions
from spinfilters.models.body import BodyEstimate
from spinfilters.models.status import verdict_sentences
from spinfilters.run.comparison_run import (
    RunOutput,
    compare_dataset,
    compare_into,
    silent,
    with_reference,
    write_comparison,
)
from spinfilters.run.estimation import Comparison, Progress
from spinfilters.run.run_folder import CONFIG_FILE, MAP_FILE, SEGMENTS_FOLDER, read_figure_data
from spinfilters.run.run_summary import SUMMARY_FILE, interval_document, read_summary, summary
from spinfilters.settings.run_settings import Settings, names_in, read_settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure


SAVED_AS: Final = (".nc", ".mcap", ".rrd")
"""Suffixes of files that a run is saved as."""
REFERENCE_GIVEN: Final = "the path of poses, attitudes or rates, or a Dataset of them"
# fmt: off
OTHER_FORMATS: Final = frozenset((
    ".csv", ".tsv", ".txt", ".tum", ".xlsx", ".json", ".jsonl", ".toml", ".yaml", ".yml", ".h5", ".hdf5", ".nc4", ".cdf", ".npy",
    ".feather", ".arrow", ".pkl", ".pickle", ".a", ".aem", ".ply", ".html", ".pdf", ".svg", ".png", ".gif",
))
# fmt: on
"""Suffixes of files that a run is not saved as, besides those of the readers; any other, as of ``run.2026``, belongs to the name of
a folder."""


def _suffixes_of_readers() -> frozenset[str]:
    from spinfilters.run.readers import dataset_readers

    return frozenset(suffix for reader in dataset_readers() for suffix in reader.suffixes)


@dataclass(frozen=True, eq=False)
class EstimatorResult:
    """Result of one estimator.

    Attributes
    ----------
    evaluation : Evaluation
        Everything that was computed of it, `spinfilters.evaluation.estimator_evaluation.Evaluation`.
    landmarks : ndarray of float, shape (k, 3) or None
        Map that it ended with or was given, m, frame g; None without any.
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

    @property
    def intervals(self) -> dict[str, dict[str, list[float | None]]] | None:
        """Central intervals after the last epoch where standard deviations are too wide in the middle; None elsewhere.

        If errors of the measurements may be correlated, a standard deviation covers them at four times its size. The intervals are
        quantiles of both explanations. Half widths about the estimate for each component, by quantity ("rate_rad_s",
        "principal_moments" and more) and per cent ("50", "80", "95"), as in ``summary.json``.
        """
        return interval_document(self.evaluation)

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

        Returns
        -------
        Any
            pandas.DataFrame, a row an epoch.

        Raises
        ------
        ImportError
            pandas is not installed.
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
    dataset : Dataset
        That it was made of.
    settings : Settings
        That it was made with.
    results : Mapping[str, EstimatorResult]
        By name of the estimator.
    conditions : tuple[str, ...]
        Sentences on the map, the seed and the noise.
    summary : Mapping[str, Any]
        The content of ``summary.json``.
    comparison : Comparison or None
        What the estimators left behind, None where the run was read from its folder.
    folder : Path or None
        That holds the run, None where it was not written.
    """

    dataset: Dataset
    settings: Settings
    results: Mapping[str, EstimatorResult]
    conditions: tuple[str, ...]
    summary: Mapping[str, Any]
    comparison: Comparison | None = None
    folder: Path | None = None

    @classmethod
    def from_comparison(
        cls,
        comparison: Comparison,
        settings: Settings,
        document: Mapping[str, Any],
        folder: Path | None = None,
    ) -> "Run":
        """Run of a comparison that has just ended, with the content of its summary.json.

        Parameters
        ----------
        comparison : Comparison
            Of all estimators.
        settings : Settings
            That it was made with.
        document : Mapping[str, Any]
            Content of summary.json.
        folder : Path or None
            That it was written into; None where it was not.

        Returns
        -------
        Run
            With a result for every estimator.
        """
        results = {e.name: EstimatorResult(e, comparison.maps.get(e.name)) for e in comparison.evaluations}
        conditions = tuple(comparison.conditions.sentences)
        return cls(comparison.setup.dataset, settings, results, conditions, document, comparison, folder)

    @classmethod
    def from_folder(cls, folder: Path, settings: Settings) -> "Run":
        """Run of a complete run folder. InputError: a damaged one.

        Parameters
        ----------
        folder : Path
            Of a complete run.
        settings : Settings
            Those of its config.toml.

        Returns
        -------
        Run
            As the run that wrote it, without the comparison.
        """
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
        name : str
            Of the table of figures: "summary", "rates", "inertia", "polhode", "scene", "consistency", "errors-mekf" (or another
            estimator's), or that of an installed figure.

        Returns
        -------
        Figure
            A matplotlib figure.

        Raises
        ------
        InputError
            No such figure, or one that needs what the run does not have.
        """
        from spinfilters.plots.figures import FigureData, drawn_figure

        landmarks = next(iter(self.values())).landmarks
        return drawn_figure(FigureData(self.dataset, self._evaluations, landmarks, self.conditions), name)

    @checked_arguments(folder=path("a folder"))
    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write the run folder of the command, with its pictures, or one file of NetCDF, MCAP or Rerun; returns its path.

        Parameters
        ----------
        folder : str or os.PathLike[str]
            New, or that of an earlier run. A name that ends in ``.nc`` is a file with the content of `to_xarray`; one in
            ``.mcap`` holds the motions as messages of ROS 2; one in ``.rrd`` shows motions, bodies, maps and courses in Rerun.
            Capitals do not matter.

        Returns
        -------
        Path
            Of the folder or the file.

        Raises
        ------
        ImportError
            A file of NetCDF needs xarray, one of MCAP rosbags, one of Rerun rerun-sdk, which is not installed.
        InputError
            The name is one of a file of another format, such as ``.csv``; the folder holds something else than a run or cannot be
            written; the run was read from a folder itself.
        """
        suffix = Path(folder).suffix.lower()
        if suffix not in SAVED_AS and (suffix in OTHER_FORMATS or suffix in _suffixes_of_readers()):
            raise InputError(
                f"{path_text(Path(folder))}: a run is not saved as {suffix}; give a name that ends in .nc, .mcap or .rrd, or a "
                "folder without a suffix"
            )
        if suffix == ".nc":
            from spinfilters.api.labelled_arrays import write_netcdf

            write_netcdf(Path(folder), self._evaluations)
            return Path(folder)
        if suffix == ".mcap":
            from spinfilters.run.exported_runs import write_mcap

            write_mcap(Path(folder), self._evaluations)
            return Path(folder)
        if suffix == ".rrd":
            from spinfilters.io.dataset_reader import has_images
            from spinfilters.run.exported_runs import write_rrd

            maps = {each.name: each.landmarks for each in self.values() if each.landmarks is not None}
            source = self.dataset.path
            images = source if source is not None and has_images(source) else None
            write_rrd(Path(folder), self._evaluations, maps, self.dataset.name, images)
            return Path(folder)
        if self.comparison is None:
            raise InputError(f"this run was read from {self.folder}; copy that folder")
        write_comparison(Path(folder), self.comparison, self.settings)
        return Path(folder)

    def to_dataframe(self) -> Any:
        """The numbers of ``summary.json`` as a pandas.DataFrame, a row per estimator; tables as ``a.b``, lists as ``a_1``.

        Returns
        -------
        Any
            pandas.DataFrame with the index "estimator".

        Raises
        ------
        ImportError
            pandas is not installed.
        """
        rows = [{"estimator": name} | dict(flattened(self.summary["estimators"][name], "")) for name in self]
        names = dict.fromkeys(name for row in rows for name in row)
        return data_frame({name: [row.get(name) for row in rows] for name in names}, "estimator")

    def to_xarray(self) -> Any:
        """Motions and bodies of all estimators as an xarray.Dataset, with units and meanings.

        Returns
        -------
        Any
            xarray.Dataset over ``estimator``, ``time`` (s) and axes; NaN where an estimator has no epoch.

        Raises
        ------
        ImportError
            xarray is not installed.
        """
        from spinfilters.api.labelled_arrays import labelled_arrays

        return labelled_arrays(self._evaluations)

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
"""Characters of a table where the terminal does not report its own."""


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
    ImportError
        pandas is not installed.
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


@checked_arguments(
    RunArguments,
    ReadingOptions,
    kind=optional(text(KIND)),
    segment=optional(one_of(int, str, cure='a number, times such as "6.55:7.4", or "auto"')),
    belief=optional(one_of(Mapping, cure='{"mean": {"rate": (0, 0, 1), ...}, "std": {...}}')),
    settings=optional(SETTINGS_GIVEN),
    output=optional(path("a folder")),
    reference=optional(one_of(Dataset, path_of="a recording", cure=REFERENCE_GIVEN)),
    reference_inspector=optional(one_of(Dataset, path_of="a recording", cure=REFERENCE_GIVEN)),
    progress=called,
)
@on_one_blas_thread
def compare(
    data: Any,
    estimators: Sequence[str] | str | None = None,
    settings: AnySettings | None = None,
    segment: int | str | None = None,
    output: str | os.PathLike[str] | None = None,
    *,
    kind: str | None = None,
    units: str | Mapping[str, str] | None = None,
    unit: str | None = None,
    clock: str | None = None,
    rate: float | None = None,
    topic: str | None = None,
    columns: str | None = None,
    rig: str | None = None,
    resume: bool = False,
    predict: float | None = None,
    convergence: bool = False,
    explain: bool = False,
    reference: str | os.PathLike[str] | Dataset | None = None,
    reference_shares: Sequence[str] = (),
    reference_inspector: str | os.PathLike[str] | Dataset | None = None,
    race: Sequence[str] = (),
    no_figures: bool = False,
    verdict: str | None = None,
    belief: Mapping[str, Any] | None = None,
    from_truth: int | None = None,
    progress: Progress = silent,
) -> Run:
    """Estimators side by side on one recording, as ``spinfilters compare`` runs them.

    Parameters
    ----------
    data : Dataset, str, os.PathLike, data frame, mapping or array
        A data set, the path of one, or a table in memory (see `load`): ``compare(frame, units="deg/s")``.
    estimators : str, sequence of str or None
        Names such as "mekf", "smoother" and "posterior", of which ``spinfilters compare --help`` has a list; one text may have
        several, with commas. None takes those of the settings, by default "mekf,ukf,smoother".
    settings : Settings, Mapping, str, os.PathLike or None
        `Settings`, a mapping such as ``{"sensors": {"pixel_std": 0.5}}``, or the path of a settings file.
    segment : int, str or None
        Of a recording, see `load`.
    output : str, os.PathLike or None
        Folder to write the run into, with checkpoints and pictures; None writes nothing, and `Run.save` can later.
    kind : str or None
        Of a table in memory, see `load`.
    units : str, Mapping or None
        Of the columns of a table or of a file, see `load`.
    unit : str or None
        Of body rates or positions whose header states none, as the option of the command; see `load`.
    clock : str or None
        Unit of time stamps, likewise.
    rate : float or None
        Samples a second, Hz, of a table without a clock.
    topic : str or None
        Of a ROS bag; a body of a table, or a segment of an Xsens MVN.
    columns : str or None
        Names of the columns of a table without a header.
    rig : str or None
        Folder with the calibration of a bag's images, see `load`.
    resume : bool
        Whether to go on from what an interrupted run has left in ``output``; a finished run is read from there.
    predict : float or None
        s to go on after the last epoch; a file of ``output``, as those of the next three.
    convergence : bool
        Whether to show how the smoother settles.
    explain : bool
        Whether to run again with the errors of the models that are found.
    reference : str, os.PathLike, Dataset or None
        Another instrument's poses, attitudes or rates of the body, on its own clock and in its own axes, to compare with.
    reference_shares : sequence of str
        What of ``reference`` need not be fitted: "frame", its inertial frame is that of the data set; "origin", it is the centre of
        mass.
    reference_inspector : str, os.PathLike, Dataset or None
        The inspector's poses from the same instrument as ``reference``, which is then seen from the inspector.
    race : sequence of str
        Estimators, "truth" or TOML files whose inertias are propagated from the last state, with ``predict``.
    no_figures : bool
        Whether to write the numbers alone into ``output``, without pictures and page.
    verdict : str or None
        "full" judges by all checks, "filter" by those alone that need no smoothed motion, which leave every estimate degraded at
        best. None takes that of the settings.
    belief : Mapping or None
        From which every estimator begins at the first epoch, in place of smoothed first epochs: ``mean`` by block, and ``std`` by
        block or a ``covariance``, as the settings' table ``[initialisation]`` has them.
    from_truth : int or None
        Seed of the error of a belief that is drawn about the truth, with ``std`` of ``belief`` or usual deviations.
    progress : Callable[[str, int, int], None]
        Called with what is being done, steps done and steps in all.

    Returns
    -------
    Run
        Results by the estimator's name.

    Raises
    ------
    InputError
        What the command refuses with exit code 2; the text is one line that names the value and the cure.
    KeyboardInterrupt
        Ctrl-C; what was estimated is in ``output``, if given, for ``resume`` to go on from.
    """
    chosen = _set_initial_belief(_settings(settings, estimators, verdict), belief, from_truth)
    reading = {"unit": unit, "clock": clock, "rate": rate, "topic": topic, "columns": columns, "rig": rig}
    dataset = given_dataset(data, segment, kind=kind, units=units, **reading)
    how = RunArguments(
        resume=resume,
        predict=predict,
        convergence=convergence,
        explain=explain,
        reference_shares=tuple(reference_shares),
        race=tuple(race),
    )
    optional_outputs = how.optional_outputs
    if reference is not None:
        from spinfilters.run.reference_output import chosen_reference

        compared = chosen_reference(reference, reference_inspector, tuple(reference_shares))
        optional_outputs = with_reference(optional_outputs, compared)
    if output is None:
        if resume or optional_outputs is not None:
            raise InputError(
                "resume, predict, convergence, explain, reference and race work in a run folder; give output"
            )
        comparison = _whole(compare_dataset(dataset, chosen, progress), None)
        return Run.from_comparison(comparison, chosen, summary(comparison))
    folder = Path(output)
    written = compare_into(
        dataset, chosen, RunOutput(folder, how.resume, optional_outputs, not no_figures), progress
    )
    if written.comparison is None or written.summary is None:
        return Run.from_folder(folder, chosen)
    return Run.from_comparison(_whole(written.comparison, folder), chosen, written.summary, folder)


@checked_arguments(folder=path("a run's folder"))
def load_run(folder: str | os.PathLike[str]) -> Run:
    """Run of a folder that a comparison has written, read without running anything.

    Parameters
    ----------
    folder : str or os.PathLike
        Of ``spinfilters compare -o``, of `compare` with ``output``, or of `Run.save`; of several segments that of one, such as
        ``runs/mine/segments/001``.

    Returns
    -------
    Run
        Results by the estimator's name.

    Raises
    ------
    InputError
        No folder of a run, an unfinished or a damaged one; the text is one line that names the file and the cure.
    """
    place = Path(folder)
    if not (place / SUMMARY_FILE).exists() and (place / SEGMENTS_FOLDER).is_dir():
        raise InputError(
            f"{path_text(place)}: holds runs of several segments; give one of them ({SEGMENTS_FOLDER}/...)"
        )
    read_summary(place)  # first reports a folder that holds no finished run
    return Run.from_folder(place, read_settings(place / CONFIG_FILE))


def _whole(comparison: Comparison, folder: Path | None) -> Comparison:
    """A comparison that Ctrl-C has not cut short."""
    if comparison.interrupted:
        raise KeyboardInterrupt(
            "nothing was written; give output to continue from it next time"
            if folder is None
            else f"the finished part is in {folder}; resume=True continues from it"
        )
    return comparison


def _settings(
    settings: AnySettings | None, estimators: Sequence[str] | str | None, verdict: str | None
) -> Settings:
    chosen = Settings() if settings is None else chosen_settings(settings)
    if verdict is not None:
        chosen = replace(chosen, verdict=verdict)
    return chosen if estimators is None else replace(chosen, estimators=_names(estimators))


def _set_initial_belief(
    settings: Settings, belief: Mapping[str, Any] | None, from_truth: int | None
) -> Settings:
    """The settings with a belief from which estimators begin. InputError: one that cannot be."""
    changes: dict[str, Any] = {}
    if belief is not None:
        known = ("mean", "std", "covariance")
        for name in belief:
            if name not in known:
                raise InputError(f"belief.{value_text(name)[1:-1]} is unknown; give {', '.join(known)}")
        changes = {name: _as_setting(name, value) for name, value in belief.items()}
    if from_truth is not None:
        changes |= {"from_truth": True, "draw": from_truth}
    initialisation = replace(settings.initialisation, **changes)
    if belief is not None and not initialisation.states_belief:
        raise InputError("belief states no mean; give numbers by block, such as rate, or leave belief out")
    return replace(settings, initialisation=initialisation)


def _as_setting(name: str, value: Any) -> Any:
    """Arrays of a belief as the lists of a settings file. InputError: no table of blocks."""
    plain = value.tolist() if isinstance(value, np.ndarray) else plain_numbers(value)
    if name == "covariance":
        return tuple(map(tuple, plain))
    if not isinstance(plain, Mapping):
        raise InputError(f"belief.{name} is {value_text(value)}; give numbers by block, such as rate")
    return dict(plain)


def _names(estimators: Sequence[str] | str) -> tuple[str, ...]:
    """Names from a list, or from one text with commas. InputError: no names."""
    if isinstance(estimators, Settings | Mapping):
        raise InputError("estimators are settings; give them by name: compare(data, settings=...)")
    names(ESTIMATORS)("estimators", estimators)
    return names_in(estimators) if isinstance(estimators, str) else tuple(estimators)


def given_dataset(data: Any, segment: int | str | None, **reading: Any) -> Dataset:
    """The data set, or that of a path or of a table in memory, read as `load` reads it; see `compare`.

    Raises
    ------
    InputError
        What is of no use for a data set.
    """
    if not isinstance(data, Dataset):
        from spinfilters.api.recordings import load
        from spinfilters.io.memory_tables import WHAT_TO_GIVE, is_table

        if not is_path(data) and not is_table(data):
            refuse("data", data, WHAT_TO_GIVE)
        return load(data, segment, **reading)
    if segment is not None:
        raise InputError(f"segment {segment} is of a recording's folder; give its path, not a data set")
    for name, value in reading.items():
        if value is not None:
            raise InputError(
                f"{name} {value_text(value)} says how to read a file or a table; a data set has its own: leave it out"
            )
    return data
