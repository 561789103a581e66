"""Ready studies of filters compared with smoothers, and one page that answers: which of them, when?

The studies are files of `spinfilters.campaigns.studies`. Each varies one factor besides the estimator. By the levels of that factor
the page shows ratios of errors and of processor time to those of the smoother on the same recordings, NEES, the share of
estimates within four stated deviations and how soon filters converge, each with its 95 % interval; and it names one to choose.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from importlib.resources import files
from pathlib import Path
from textwrap import fill
from typing import Any, Final

import numpy as np
import pyarrow as pa
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.stats import chi2

from spinfilters.campaigns.rows_folder import STUDY_FILE, read_folder, read_rows
from spinfilters.campaigns.statistics import (
    ESTIMATOR,
    MARKERS,
    NOTHING,
    Interval,
    cell_summaries,
    geometric_ratio,
    label_logarithms,
    paired_ratios,
    pareto_figure,
    positive_mean,
    ratio_of_squares,
    reference_of,
    share,
)
from spinfilters.campaigns.study import Study, read_study
from spinfilters.core.errors import InputError
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR
from spinfilters.io.input_file import path_text, value_text
from spinfilters.io.output_files import write_bytes, write_text
from spinfilters.plots.page import image, note, page, table
from spinfilters.plots.printing import PrintStyle, printed_figure
from spinfilters.plots.style import GREY, estimator_lines, legend_below, picture_bytes, tidy

NAMES: Final = (
    "cases",
    "motions",
    "rates",
    "noise",
    "lags",
    "initial-error",
    "iterations",
    "family",
    "members",
)
"""Ready studies, in the order of the page."""
PAGE: Final = "studies.html"
COMPARISON: Final = "comparison"
PARETO: Final = "pareto"
PICTURE: Final = f"{COMPARISON}.png"
CAPTIONS: Final = {COMPARISON: "estimators by level", PARETO: "error against processor time"}
DPI: Final = 150
WORSE: Final = 1.1
"""An estimator whose errors are, with 95 %, at most so many times the reference's is as good."""
CONVERGED: Final = 0.999
"""Share of the errors of a consistent estimator that lie below the NEES up to which a run counts as converged."""
ERRORS: Final = {"error_attitude_rad": "attitude", "error_rate_rad_s": "rate", "error_position_m": "position"}
"""Errors of the motion that are compared, by their columns: root mean squares over a run's epochs."""
MOMENTS: Final = "moments"
"""Title of the errors of both ratios of moments at the last epoch."""


@dataclass(frozen=True)
class LevelResult:
    """What a study found of one estimator at one level of its factor.

    Attributes
    ----------
    level, estimator : str
        Of the factor, and whose.
    ratios : dict of str to Interval
        Errors over those of the reference on the same recordings, by the titles of `ERRORS` and `MOMENTS`.
    cost : Interval
        Processor time per epoch over the reference's.
    seconds : Interval
        Processor time per epoch, s.
    nees : Interval
        Mean over runs, per degree of freedom; 1 for a consistent estimator.
    right : Interval
        Share of runs whose published quantities all are within `LARGEST_STATED_ERROR` deviations at the end.
    converged : Interval
        Share of runs that converge.
    settling : Interval
        Time until they have, s from the first epoch.
    lost : int
        Runs without a result.
    """

    level: str
    estimator: str
    ratios: dict[str, Interval]
    cost: Interval
    seconds: Interval
    nees: Interval
    right: Interval
    converged: Interval
    settling: Interval
    lost: int

    @property
    def is_as_good(self) -> bool:
        """Whether each error is, with 95 %, at most `WORSE` times the reference's, and nine runs of ten keep their deviations."""
        errors = list(self.ratios.values())
        return bool(errors) and all(each.high <= WORSE for each in errors) and self.right.value >= 0.9


def study_file(name: str) -> Path:
    """File of a ready study.

    Raises
    ------
    InputError
        None of this name.
    """
    if name not in NAMES:
        raise InputError(
            f"study {value_text(name)} is none of the ready ones; choose from {', '.join(NAMES)}, or all"
        )
    return Path(str(files("spinfilters.campaigns") / "studies" / f"{name}.toml"))


def ready_study(name: str) -> Study:
    """A ready study. Errors: `study_file`."""
    return read_study(study_file(name))


def level_results(study: Study, rows: pa.Table) -> list[LevelResult]:
    """Results of a study by level and estimator, in the order of its cells.

    Parameters
    ----------
    study : Study
        Whose factors but the estimator are one axis.
    rows : pyarrow.Table
        Of its runs.
    """
    others = [name for name in study.varied if name != ESTIMATOR]
    reference = reference_of(list(dict.fromkeys(cell.levels[ESTIMATOR] for cell in study.cells)))
    plain, found = rows.to_pandas().set_index("seed"), list[LevelResult]()
    for summary in cell_summaries(study, rows):
        own = plain[plain["cell"] == summary.cell]
        levels = {**summary.levels, ESTIMATOR: reference}
        beside = next(
            (number for number, cell in enumerate(study.cells) if cell.levels == levels), summary.cell
        )
        found.append(
            LevelResult(
                " ".join(summary.levels[name] for name in others),
                summary.levels[ESTIMATOR],
                **_numbers(own, plain[plain["cell"] == beside]),
                lost=summary.runs - summary.outcomes.get("done", 0),
            )
        )
    return found


def _numbers(own: Any, reference: Any) -> dict[str, Any]:
    """Intervals of an estimator's runs and of their ratios to those of the reference, on the seeds that both have."""
    seeds = own.index.intersection(reference.index)

    def pairs(column: str) -> list[Float[np.ndarray, " n"]]:
        return [each.loc[seeds, column].to_numpy(float) for each in (own, reference)]

    ratios = {title: geometric_ratio(*pairs(column)) for column, title in ERRORS.items()}
    lengths = [np.hypot(*of_both) for of_both in zip(pairs("error_k1"), pairs("error_k2"), strict=True)]
    ratios[MOMENTS] = ratio_of_squares(*lengths)
    dof = own["dof"].max()
    settled = np.array(
        [] if not dof > 0 else [_settling(run, int(dof)) for run in own.itertuples() if run.nees > 0]
    )
    right = own["right"].dropna()
    return {
        "ratios": {title: each for title, each in ratios.items() if each.count},
        "cost": geometric_ratio(*pairs("time_per_epoch_s")),
        "seconds": positive_mean(own["time_per_epoch_s"].to_numpy(float)),
        "nees": positive_mean(own["nees"].to_numpy(float)),
        "right": share(int(right.sum()), len(right)),
        "converged": share(int(np.isfinite(settled).sum()), len(settled)),
        "settling": positive_mean(settled[np.isfinite(settled)]),
    }


def _settling(run: Any, dof: int) -> float:
    """Time from a run's first shown epoch on until its NEES stays below the limit of `CONVERGED`, s; infinite if never."""
    time, nees = np.asarray(run.nees_time_s, float), np.asarray(run.nees_over_time, float)
    above = np.flatnonzero(~(nees <= chi2.ppf(CONVERGED, dof) / dof))
    if not len(above):
        return 0.0
    return float(time[above[-1] + 1] - time[0]) if above[-1] + 1 < len(time) else np.inf


def recommended(results: Sequence[LevelResult]) -> LevelResult | None:
    """Of the results of one level the cheapest that is as good as the reference; None where none is."""
    return min(
        (each for each in results if each.is_as_good), key=lambda each: each.seconds.value, default=None
    )


def by_level(results: Sequence[LevelResult]) -> dict[str, list[LevelResult]]:
    """Results in groups of one level each."""
    groups: dict[str, list[LevelResult]] = {}
    for each in results:
        groups.setdefault(each.level, []).append(each)
    return groups


def _error_titles(results: Sequence[LevelResult]) -> list[str]:
    """Errors that any of the results has a ratio of."""
    return [title for title in (*ERRORS.values(), MOMENTS) if any(title in each.ratios for each in results)]


def comparison_figure(results: Sequence[LevelResult]) -> Figure:
    """Curves over the levels: ratios of errors, NEES, share within four deviations, processor time; a line an estimator."""
    levels, names = list(by_level(results)), list(dict.fromkeys(each.estimator for each in results))
    lines = dict(zip(names, estimator_lines(names), strict=True))
    titles, reference = _error_titles(results), reference_of(names)
    figure = Figure(figsize=(12.5, 6.6), layout="constrained")
    panels = figure.subplots(2, -(-(len(titles) + 3) // 2), squeeze=False).ravel()
    draws: list[tuple[str, str, Callable[[LevelResult], Interval]]] = [
        *((f"{title}: error over the {reference}'s", "log", partial(_ratio, title)) for title in titles),
        ("NEES per degree of freedom", "log", lambda each: each.nees),
        (f"share within {LARGEST_STATED_ERROR:g} deviations", "linear", lambda each: each.right),
        ("processor time per epoch [ms]", "log", lambda each: _scaled(each.seconds, 1e3)),
    ]
    shifts = dict(zip(names, np.linspace(-0.3, 0.3, len(names)), strict=True))
    for axes, (title, scale, read) in zip(panels, draws, strict=False):
        for number, name in enumerate(names):
            found = [(levels.index(each.level), read(each)) for each in results if each.estimator == name]
            found = [(place, each) for place, each in found if np.isfinite(each.value) and each.count]
            value = np.array([each.value for _, each in found])
            reach = (
                np.array([[each.value - each.low, each.high - each.value] for _, each in found])
                .reshape(-1, 2)
                .T
            )
            axes.errorbar(
                [place + shifts[name] for place, _ in found],
                value,
                yerr=np.nan_to_num(np.abs(reach)),
                fmt=MARKERS[number % len(MARKERS)],
                color=lines[name].color,
                markersize=4,
                linewidth=1.2,
            )
        if scale == "log":
            axes.set_yscale("log")
            label_logarithms(axes.yaxis)
            if "time" not in title:
                axes.axhline(1.0, color=GREY, linewidth=0.8, zorder=0)
        axes.set_title(title, fontsize="small", loc="left")
        axes.set_xticks(
            range(len(levels)),
            [fill(level or "all", 36 // len(levels) + 1, break_long_words=False) for level in levels],
            fontsize="x-small",
        )
        tidy(axes)
    for axes in panels[len(draws) :]:
        axes.set_visible(False)
    handles = [
        Line2D(
            [], [], marker=MARKERS[k % len(MARKERS)], color=lines[name].color, linestyle="none", label=name
        )
        for k, name in enumerate(names)
    ]
    legend_below(figure, handles)
    return figure


def _ratio(title: str, result: LevelResult) -> Interval:
    return result.ratios.get(title, NOTHING)


def _scaled(found: Interval, scale: float) -> Interval:
    return Interval(scale * found.value, scale * found.low, scale * found.high, found.count)


def study_figures(study: Study, rows: pa.Table, results: Sequence[LevelResult]) -> dict[str, Figure]:
    """Figures of a study by name: curves over its levels, and errors against processor time where there are both."""
    pareto = pareto_figure(paired_ratios(study, rows))
    return {COMPARISON: comparison_figure(results)} | ({} if pareto is None else {PARETO: pareto})


def write_comparison_page(
    folder: Path, studies: Sequence[str] = NAMES, print_style: PrintStyle | None = None
) -> Path:
    """Write the page over the ready studies that a folder holds, finished or not, and pictures of each; the page's path.

    Parameters
    ----------
    folder : Path
        With a campaign's folder for each study, by its name.
    studies : sequence of str
        Their order.
    print_style : PrintStyle or None
        Prints each figure for a paper too, beside the pictures.

    Raises
    ------
    InputError
        No study is there, or one that is damaged; the page cannot be written.
    """
    sections, choices = {}, []
    for name in studies:
        place = folder / name
        if not (place / STUDY_FILE).is_file():
            continue
        study, begun = read_folder(place)
        rows = read_rows(place, study.columns, levels=study.levels)
        results = level_results(study, rows)
        figures = study_figures(study, rows, results)
        pictures = {title: picture_bytes(figure, "png", dpi=DPI) for title, figure in figures.items()}
        printed: dict[str, bytes] = {}
        if print_style is not None:  # after the pictures, because printing scales a figure
            for title, figure in figures.items():
                printed |= printed_figure(figure, title, print_style)
        shown = {f"{title}.png": picture for title, picture in pictures.items()}
        for file, content in (printed | shown).items():
            write_bytes(place / file, content)
        sections[study.name] = (
            f"<p>{escape(study.options.description)}</p>"
            + note(
                f"{len(rows)} of {len(study)} runs, {study.options.seeds} seeds, begun {begun.get('begun', '')[:10]} "
                f"at commit {str(begun.get('commit', ''))[:12]} on {begun.get('machine', '')}."
            )
            + "".join(image(each, f"{study.name}: {CAPTIONS[title]}") for title, each in pictures.items())
            + _result_table(results)
        )
        choices += _choices(study.name, results)
    if not sections:
        raise InputError(
            f"{path_text(folder)}: holds none of the ready studies; run 'spinfilters study all -o {folder}'"
        )
    head = [
        "study",
        "level",
        "choose",
        "processor ms an epoch",
        "worst error over the reference",
        "reference, ms an epoch",
    ]
    remark = (
        "Choose: the cheapest estimator of the study whose errors of attitude, rate, position and moments are, "
        f"with 95 % confidence, at most {WORSE:g} times the reference's on the same recordings, and nine of whose ten results "
        f"lie within {LARGEST_STATED_ERROR:g} stated deviations. The reference is the smoother, of a study without it the MEKF. "
        "Filters answer at once, the smoother in the end or after its lag; that is not in this table."
    )
    write_text(
        folder / PAGE,
        page({"What to fly when": note(remark) + table(head, choices, 3), **sections}, "Filter or smoother?"),
    )
    return folder / PAGE


def _choices(study: str, results: Sequence[LevelResult]) -> Iterator[list[str]]:
    """Rows of the first table: of each level the estimator to choose."""
    for level, group in by_level(results).items():
        name = reference_of([each.estimator for each in group])
        reference = next((each for each in group if each.estimator == name), None)
        chosen = recommended(group)
        worst = None if chosen is None else max(chosen.ratios.values(), key=lambda each: each.value)
        yield [
            escape(study),
            escape(level or "all"),
            "none is reliable" if chosen is None else escape(chosen.estimator),
            "-" if chosen is None else _text(chosen.seconds, 1e3),
            "-" if worst is None else _text(worst),
            "-" if reference is None else _text(reference.seconds, 1e3),
        ]


def _result_table(results: Sequence[LevelResult]) -> str:
    titles = _error_titles(results)
    within = f"within {LARGEST_STATED_ERROR:g} deviations"
    head = [
        "level",
        "estimator",
        *titles,
        "processor time",
        "ms an epoch",
        "NEES",
        within,
        "converged",
        "after [s]",
        "no result",
    ]
    rows = [
        [
            escape(each.level or "all"),
            escape(each.estimator),
            *(_text(_ratio(title, each)) for title in titles),
            _text(each.cost),
            _text(each.seconds, 1e3),
            _text(each.nees),
            _text(each.right, 100, " %"),
            _text(each.converged, 100, " %"),
            _text(each.settling),
            str(each.lost or "-"),
        ]
        for each in results
    ]
    remark = (
        "Errors and processor time over those of the reference on the same recordings, with 95 % intervals: geometric means of the "
        "motion's root mean squares, the ratio of root mean squares over runs of the moments. Converged: NEES stays below what "
        f"{100 * CONVERGED:g} % of the epochs of a consistent estimator do not reach; after that time from the first epoch on."
    )
    return note(remark) + table(head, rows, 2)


def _text(found: Interval, scale: float = 1.0, unit: str = "") -> str:
    if not found.count or not np.isfinite(found.value):
        return "-"
    value = f"{scale * found.value:.3g}{unit}"
    if not np.isfinite(found.low) or found.low == found.high:
        return value
    return f'{value} <span class="i">{scale * found.low:.3g} .. {scale * found.high:.3g}</span>'
