"""Report of a campaign's folder: one page, its pictures, a table of cells."""

import csv
import shlex
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from io import StringIO
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from spinfilters.campaigns.rows_folder import STUDY_FILE, read_folder, read_rows
from spinfilters.campaigns.statistics import (
    ESTIMATOR,
    NOTHING,
    CellSummary,
    Interval,
    PairedRatio,
    cell_summaries,
    counted_metrics,
    paired_ratios,
    pareto_figure,
    reference_of,
    share,
)
from spinfilters.campaigns.study import Study
from spinfilters.evaluation.metrics import Metric, Section
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR
from spinfilters.io.input_file import read_settings_text
from spinfilters.io.output_files import make_folder, write_bytes, write_text
from spinfilters.plots.page import details, facts, image, note, page, table
from spinfilters.plots.style import (
    BLUE,
    GREEN,
    GREY,
    ONE_DRAWS,
    ORANGE,
    RED,
    SKY,
    EstimatorLine,
    estimator_lines,
    legend_below,
    picture_bytes,
    tidy,
)

MOST_ROWS: Final = 300
"""Of a table or list on the page; all cells are in cells.csv."""
_HATCHED: Final = "background:repeating-linear-gradient(45deg,#8886 0 2px,transparent 2px 6px)"
"""Of a number of what most runs of a cell do not determine."""


def asked_section(description: str, told: Mapping[str, str], study: str) -> str:
    """The study: its facts in a table, and its file."""
    words = f"<p>{escape(description)}</p>" if description else ""
    return f"{words}{facts(told)}{details('study file', study)}"


def consistency_section(cells: Sequence[CellSummary], varied: Sequence[str], picture: str) -> str:
    """NEES by cell with its interval and band."""
    blocks = [metric for metric in _metrics_shown(cells, Section.CONSISTENCY) if metric.label.startswith(" ")]
    head = [
        *varied,
        "runs",
        "NEES / dof",
        "median",
        "last epoch",
        "95 % band",
        "epochs within",
        *(metric.label.strip() for metric in blocks),
    ]
    rows = [
        [*_levels(cell, varied), *_consistency_cells(cell), *(_mean(cell, metric) for metric in blocks)]
        for cell in cells[:MOST_ROWS]
    ]
    remark = (
        "Normalised estimation error squared per degree of freedom, 1 for a consistent estimator: mean over runs of the mean over "
        "the estimator's own epochs, with its 95 % confidence interval. Last epoch: mean over the N runs, marked where it lies "
        "outside the 95 % band: the interval that holds the mean of N runs of a consistent estimator with probability 95 %, from "
        "chi-square with N times the state's degrees of freedom. It narrows as N grows. Of the blocks: means."
    )
    return note(remark) + table(head, rows, len(varied)) + _cut(cells) + picture


def _consistency_cells(cell: CellSummary) -> list[str]:
    low, high = cell.band
    outside = np.isfinite(cell.last.value) and not low <= cell.last.value <= high
    last = _number(cell.last.value)
    return [
        str(cell.nees.count),
        _interval(cell.nees),
        _number(cell.nees_median),
        f'<span class="bad">{last}</span>' if outside else last,
        f"{_number(low)} .. {_number(high)}",
        _percent(cell.over_time.inside),
    ]


def _metrics_shown(cells: Sequence[CellSummary], *sections: Section) -> list[Metric]:
    """Metrics of these sections that any cell has numbers of."""
    return [
        metric
        for metric in counted_metrics()
        if metric.section in sections and any(cell.numbers[metric.column_name].count for cell in cells)
    ]


def errors_section(cells: Sequence[CellSummary], varied: Sequence[str], picture: str) -> str:
    """Errors and their ratio to the bound."""
    tables = []
    for section in (Section.MOTION, Section.BODY):
        errors = [metric for metric in _metrics_shown(cells, section) if metric.bound is not None]
        bounded = {
            metric for metric in errors if any(cell.over_bound[metric.column_name].count for cell in cells)
        }
        head = [
            *varied,
            *(part for m in errors for part in (m.title, *(["over bound"] if m in bounded else []))),
        ]
        rows = [
            [
                *_levels(cell, varied),
                *(part for m in errors for part in _error_cells(cell, m)[: 1 + (m in bounded)]),
            ]
            for cell in cells[:MOST_ROWS]
        ]
        tables += [table(head, rows, len(varied))] if errors else []
    remark = (
        "Root mean square over runs with its 95 % confidence interval, of the motion over the estimator's own epochs, of the body "
        "at the last; and over the Cramer-Rao bound of smoothing, which a filter reaches at the last epoch and in constants only."
    )
    return note(remark) + "".join(tables) + _cut(cells) + picture


def _error_cells(cell: CellSummary, metric: Metric) -> tuple[str, str]:
    name = metric.column_name
    shown = _interval(cell.numbers[name], metric.scale), _interval(cell.over_bound[name])
    if cell.determines(metric):
        return shown
    return f'<span style="{_HATCHED}" title="not determined">{shown[0]}</span>', shown[1]


def further_section(cells: Sequence[CellSummary], varied: Sequence[str]) -> str:
    """Means of the metrics that no other section shows."""
    shown = [
        metric
        for metric in _metrics_shown(cells, Section.USE, Section.CONSISTENCY, Section.FURTHER, Section.COST)
        if metric.label and not metric.column_name.startswith("nees")
    ]
    head = [*varied, *(metric.title for metric in shown)]
    rows = [
        [*_levels(cell, varied), *(_mean(cell, metric) for metric in shown)] for cell in cells[:MOST_ROWS]
    ]
    return (
        note("Mean over runs with its 95 % confidence interval.")
        + table(head, rows, len(varied))
        + _cut(cells)
    )


def _mean(cell: CellSummary, metric: Metric) -> str:
    return _interval(cell.numbers[metric.column_name], metric.scale)


def pairs_section(
    ratios: Sequence[PairedRatio], others: Sequence[str], reference: str | None, picture: str
) -> str:
    """Ratios of estimators over the reference on the same recordings."""
    if not ratios:
        return "<p>There is only one estimator, or no recording in common.</p>"
    quantities = list(dict.fromkeys(each.quantity for each in ratios))
    found: dict[tuple[tuple[str, ...], str], dict[str, Interval]] = {}
    for each in ratios:
        found.setdefault((each.levels, each.estimator), {})[each.quantity] = each.ratio
    rows = [
        [*map(escape, levels), escape(name), *(_interval(own.get(title, NOTHING)) for title in quantities)]
        for (levels, name), own in list(found.items())[:MOST_ROWS]
    ]
    remark = (
        f"Geometric mean over recordings of the ratio to {reference} on the same recording, with its 95 % confidence interval; "
        "errors as in the table of errors, processor time of estimation alone. Below 1 is better."
    )
    return note(remark) + table([*others, "estimator", *quantities], rows, len(others) + 1) + picture


def verdict_section(cells: Sequence[CellSummary], picture: str) -> str:
    """Verdicts against correctness, over all cells of an estimator."""
    names = list(dict.fromkeys(cell.levels["estimator"] for cell in cells))
    head = ["estimator", "said", "right", "wrong", "unknown", "right of those known"]
    rows = []
    for name in names:
        own = [cell.verdicts for cell in cells if cell.levels["estimator"] == name]
        for said in ("ok", "degraded", "failed", "no result"):
            counts = [sum(each.get((said, was), 0) for each in own) for was in ("right", "wrong", "unknown")]
            if sum(counts):
                wrong = (
                    f'<span class="bad">{counts[1]}</span>' if said == "ok" and counts[1] else str(counts[1])
                )
                known = share(counts[0], counts[0] + counts[1])
                rows.append([escape(name), said, str(counts[0]), wrong, str(counts[2]), _shares(known)])
    remark = (
        f"Right: every published quantity of the last epoch is within {LARGEST_STATED_ERROR:g} of its stated standard deviations "
        "of the truth. A run that is ok and wrong is a defect."
    )
    return note(remark) + table(head, rows, 2) + picture


def failures_section(
    failures: Sequence[Mapping[str, Any]], total: int, varied: Sequence[str], folder: Path
) -> str:
    """Failed runs, each with the command that repeats it."""
    if not total:
        return "<p>None: every run gave a result, and none was called ok and wrong or failed.</p>"
    place = shlex.quote(str(folder))
    items = []
    for row in failures[:MOST_ROWS]:
        run = int(row["run"])
        levels = ", ".join(f"{name} {row[name]}" for name in varied)
        command = f"spinfilters campaign repeat {place} {run} -o repeated-{run}"
        compare = f"spinfilters compare repeated-{run} -o repeated-{run}-run"
        items.append(
            f'<details id="run-{run}"><summary>run {run}, seed {int(row["seed"])}: {escape(levels)} - '
            f"{escape(_why(row))}</summary><pre>{escape(command)}\n{escape(compare)}</pre></details>"
        )
    more = "" if total <= len(items) else note(f"{len(items)} of {total} are listed; all are in the rows.")
    remark = "A click shows the commands that repeat the run and compare its data set."
    return note(remark) + more + "".join(items)


def cost_section(cells: Sequence[CellSummary], varied: Sequence[str]) -> str:
    """Processor time per run, and how runs ended."""
    head = [*varied, "runs", "processor time [s]", "ended otherwise"]
    rows = [
        [
            *_levels(cell, varied),
            str(cell.runs),
            _interval(cell.seconds),
            escape(", ".join(f"{count} {name}" for name, count in cell.outcomes.items() if name != "done"))
            or "-",
        ]
        for cell in cells[:MOST_ROWS]
    ]
    return table(head, rows, len(varied)) + _cut(cells)


def _why(row: Mapping[str, Any]) -> str:
    if row["outcome"] != "done":
        return f"{row['outcome']}: {row['reason']}"
    if row["verdict"] == "failed":
        return f"failed: {row['verdict_reasons']}"
    return f"called {row['verdict']}, but {row['worst_quantity']} is {row['worst_error']:.3g} stated deviations off"


def _levels(cell: CellSummary, varied: Sequence[str]) -> Iterator[str]:
    return (escape(cell.levels[name]) for name in varied)


def _interval(found: Interval, scale: float = 1.0) -> str:
    if not np.isfinite(found.value):
        return "-"
    value = _number(scale * found.value)
    if not np.isfinite(found.low):
        return value
    return f'{value} <span class="i">{_number(scale * found.low)} .. {_number(scale * found.high)}</span>'


def _shares(found: Interval) -> str:
    if not found.count:
        return "-"
    return f'{100 * found.value:.1f} % <span class="i">{100 * found.low:.1f} .. {100 * found.high:.1f}</span>'


def _percent(value: float) -> str:
    return f"{100 * value:.0f} %" if np.isfinite(value) else "-"


def _number(value: float) -> str:
    return f"{value:#.3g}".rstrip(".") if np.isfinite(value) else "-"


def _cut(cells: Sequence[CellSummary]) -> str:
    return (
        "" if len(cells) <= MOST_ROWS else note(f"{MOST_ROWS} of {len(cells)} cells; all are in cells.csv.")
    )


REPORT: Final = "report"
PAGE: Final = "index.html"
_PAGE_DPI = 110
_FILE_DPI = 150


def write_report(folder: Path) -> Path:
    """Write the report of a campaign, finished or not; the path of its page.

    Raises
    ------
    InputError
        No campaign's folder, no rows, damaged rows, a report that cannot be written.
    """
    study, document = read_folder(folder)
    table = read_rows(folder, study.columns, levels=study.levels)
    cells = list(cell_summaries(study, table))
    varied = study.varied or ["estimator"]
    ratios, others = paired_ratios(study, table), [name for name in study.varied if name != ESTIMATOR]
    reference = reference_of(list(dict.fromkeys(cell.levels[ESTIMATOR] for cell in study.cells)))
    target = folder / REPORT
    make_folder(target)
    pictures = {
        "nees": (nees_figure(cells, varied), "NEES over time with its band"),
        "bound": (bound_figure(cells, varied), "errors over the Cramer-Rao bound"),
        "pareto": (pareto_figure(ratios), "errors against processor time, over the reference"),
        "verdicts": (verdict_figure(cells, varied), "verdicts against the truth"),
    }
    shown = {name: _picture(target, name, *each) for name, each in pictures.items()}
    failures = failed_rows(table)
    sections = {
        "What was asked": asked_section(
            study.options.description,
            _describe_campaign(study, table, document),
            read_settings_text(folder / STUDY_FILE),
        ),
        "Consistency": consistency_section(cells, varied, shown["nees"]),
        "Errors": errors_section(cells, varied, shown["bound"]),
        "Estimators in pairs": pairs_section(ratios, others, reference, shown["pareto"]),
        "Further numbers": further_section(cells, varied),
        "Verdicts against the truth": verdict_section(cells, shown["verdicts"]),
        "Runs that went wrong": failures_section(
            failures.slice(0, MOST_ROWS).to_pylist(), len(failures), varied, folder.resolve()
        ),
        "What it took": cost_section(cells, varied),
    }
    write_text(target / "cells.csv", cells_csv(cells, study.columns))
    write_text(target / PAGE, page(sections, f"Campaign: {study.name}"))
    return target / PAGE


def failed_rows(table: pa.Table) -> pa.Table:
    """Rows of wrong, missing and failed results, in this order."""
    said, was, ended = (table[name].to_pandas() for name in ("verdict", "right", "outcome"))
    wrong = (said == "ok") & (was == False)  # noqa: E712  unknown is not wrong
    masks = (wrong, ended != "done", said == "failed")
    columns = [name for name in table.column_names if not name.startswith("nees_")]
    parts = [table.filter(pa.array(mask.to_numpy(dtype=bool))).select(columns) for mask in masks]
    return pa.concat_tables(parts)


def cells_csv(cells: Sequence[CellSummary], factors: Sequence[str]) -> str:
    """Every cell's numbers, a row each."""
    stream = StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    numbers = [metric.column_name for metric in counted_metrics()]
    errors = [metric.column_name for metric in counted_metrics() if metric.bound is not None]
    intervals = [*numbers, *(f"over_bound_{name.removeprefix('error_')}" for name in errors)]
    head = [f"{name}{end}" for name in intervals for end in ("", "_low", "_high")]
    writer.writerow(["cell", *factors, "runs", "ok", "right_of_ok", *head])
    for cell in cells:
        each = [*(cell.numbers[name] for name in numbers), *(cell.over_bound[name] for name in errors)]
        limits = [value for found in each for value in (found.value, found.low, found.high)]
        levels = [cell.levels[name] for name in factors]
        writer.writerow([cell.cell, *levels, cell.runs, cell.ok.value, cell.right_of_ok.value, *limits])
    return stream.getvalue()


def _describe_campaign(study: Study, table: pa.Table, document: Mapping[str, Any]) -> dict[str, str]:
    finished = sorted(filter(None, table["finished"].to_pylist()))
    hosts = sorted(set(table["host"].to_pylist()))
    made = table.group_by(["version", "packages"]).aggregate([]).to_pylist()
    versions = sorted(f"spinfilters {each['version']}, {each['packages']}" for each in made)
    options = study.options
    levels = {name: dict.fromkeys(cell.levels[name] for cell in study.cells) for name in study.varied}
    return {
        "runs": f"{len(table)} of {len(study)}: {len(study.cells)} cells times {options.seeds} seeds of root {options.root_seed}",
        **{f"factor {name}": ", ".join(each) for name, each in levels.items()},
        "initialisation": options.initialisation,
        "bound": options.bound,
        "made": f"{finished[0][:19]} to {finished[-1][:19]} UTC" if finished else "",
        "commit": str(document.get("commit", "")),
        "machine": f"{document.get('machine', '')} ({', '.join(hosts[:5])})",
        "versions": "; ".join(versions),
    }


def _picture(folder: Path, name: str, figure: Figure | None, words: str) -> str:
    """Write a figure as PNG and SVG; its HTML."""
    if figure is None:
        return ""
    with ONE_DRAWS, mpl.rc_context({"svg.hashsalt": name}):
        page_png = picture_bytes(figure, "png", dpi=_PAGE_DPI)
        png = picture_bytes(figure, "png", dpi=_FILE_DPI)
        svg = picture_bytes(figure, "svg", metadata={"Date": None})
    write_bytes(folder / f"{name}.png", png)
    write_bytes(folder / f"{name}.svg", svg)
    return image(page_png, words)


HATCHED: Final[dict[str, Any]] = {"hatch": "///", "facecolor": "none", "edgecolor": "0.45", "linewidth": 0.0}
"""Of what most runs of a cell do not determine."""
MOST_PANELS: Final = 9
MOST_CELLS: Final = 40
PARTS: Final = {
    ("ok", "right"): (GREEN, "ok, right"),
    ("ok", "wrong"): (RED, "ok, wrong"),
    ("degraded", "right"): (SKY, "degraded, right"),
    ("degraded", "wrong"): (ORANGE, "degraded, wrong"),
}


def _panels(cells: Sequence[CellSummary], names: Sequence[str]) -> dict[str, list[CellSummary]]:
    """Cells with a NEES by the levels of factors, `MOST_PANELS` at most."""
    groups: dict[str, list[CellSummary]] = {}
    for cell in cells:
        if len(cell.over_time.mean):
            groups.setdefault(label_of(cell, names), []).append(cell)
    return dict(list(groups.items())[:MOST_PANELS])


def _draw_nees(axes: Axes, group: Sequence[CellSummary], lines: Mapping[str, EstimatorLine]) -> float:
    """Draw a panel's band and lines; how high it should reach."""
    over = max(group, key=lambda cell: len(cell.over_time.mean)).over_time
    axes.fill_between(over.time_s, over.low, over.high, color=GREEN, alpha=0.25, linewidth=0)
    axes.axhline(1.0, color=GREY, linewidth=0.8)
    for cell in group:
        lines[cell.levels["estimator"]].draw(axes, cell.over_time.time_s, cell.over_time.mean)
    axes.set_xlabel("time [s]")
    tidy(axes)
    return max(float(np.quantile(cell.over_time.mean, 0.9)) * 1.3 for cell in group)


def nees_figure(cells: Sequence[CellSummary], varied: Sequence[str]) -> Figure | None:
    """Mean NEES over time with its band.

    A panel per combination of levels, a line per estimator; None without any NEES.
    """
    shown = _panels(cells, [name for name in varied if name != "estimator"])
    if not shown:
        return None
    across = min(3, len(shown))
    down = -(-len(shown) // across)
    figure = Figure(figsize=(4.2 * across + 0.8, 2.9 * down + 0.7), layout="constrained")
    panels = figure.subplots(down, across, squeeze=False, sharex=False, sharey=True).ravel()
    names = list(dict.fromkeys(cell.levels["estimator"] for group in shown.values() for cell in group))
    lines = {line.name: line for line in estimator_lines(names)}
    highest = 2.0
    for axes, (label, group) in zip(panels, shown.items(), strict=False):
        highest = max(highest, _draw_nees(axes, group, lines))
        widest = min(group, key=lambda cell: len(cell.over_time.mean))
        axes.set_title(f"{label or 'all'}, {widest.runs} runs", fontsize="small")
    for axes in panels[len(shown) :]:
        axes.set_visible(False)
    panels[0].set_ylim(0.0, min(highest, 10.0))
    panels[0].set_ylabel("NEES / dof, mean over runs [-]")
    band = Patch(
        color=GREEN, alpha=0.25, label="95 % interval of the mean over the runs, for a consistent estimator"
    )
    legend_below(figure, [*(line.handle for line in lines.values()), band])
    return figure


def bound_figure(cells: Sequence[CellSummary], varied: Sequence[str]) -> Figure | None:
    """Error over the Cramer-Rao bound with its interval.

    A row per cell; None where no cell has a bound.
    """
    errors = [
        metric
        for metric in counted_metrics()
        if metric.section is Section.MOTION and metric.bound is not None
    ]
    shown = [cell for cell in cells if any(cell.over_bound[m.column_name].count for m in errors)][:MOST_CELLS]
    if not shown:
        return None
    figure = Figure(figsize=(11.0, 1.2 + 0.26 * len(shown)), layout="constrained")
    panels = figure.subplots(1, len(errors), sharey=True, squeeze=False).ravel()
    places = np.arange(len(shown))[::-1]
    for axes, metric in zip(panels, errors, strict=True):
        found = [cell.over_bound[metric.column_name] for cell in shown]
        value = np.array([each.value for each in found])
        width = np.array([[each.value - each.low, each.high - each.value] for each in found]).T
        axes.axvline(1.0, color=GREY, linewidth=0.8)
        axes.errorbar(
            value, places, xerr=np.nan_to_num(np.abs(width)), fmt="o", color=BLUE, markersize=4, linewidth=1.2
        )
        for place, cell in zip(places, shown, strict=True):
            if not cell.determines(metric):
                axes.axhspan(place - 0.45, place + 0.45, **HATCHED)
        axes.set_title(metric.label.removesuffix(" error"), fontsize="small")
        axes.set_xlabel("rms error / bound [-]")
        if np.nanmax(value, initial=1.0) > 10:
            axes.set_xscale("log")
        tidy(axes)
    panels[0].set_yticks(places, [label_of(cell, varied) or "all" for cell in shown], fontsize="x-small")
    panels[0].set_ylim(-0.7, len(shown) - 0.3)
    if not all(cell.determines(metric) for cell in shown for metric in errors):
        legend_below(figure, [Patch(label="not determined in most runs", **HATCHED)])
    return figure


def verdict_figure(cells: Sequence[CellSummary], varied: Sequence[str]) -> Figure:
    """Shares of verdicts and of correct estimates, one bar per cell."""
    shown = cells[:MOST_CELLS]
    figure = Figure(figsize=(9.0, 1.3 + 0.26 * len(shown)), layout="constrained")
    axes = figure.subplots()
    places, left = np.arange(len(shown))[::-1], np.zeros(len(shown))
    for key, (colour, label) in PARTS.items():
        share = np.array([cell.verdicts.get(key, 0) / cell.runs for cell in shown])
        axes.barh(places, share, left=left, color=colour, label=label, height=0.75)
        left += share
    axes.barh(places, 1.0 - left, left=left, color="0.75", label="failed, or no result", height=0.75)
    hatched = [place for place, cell in zip(places, shown, strict=True) if not cell.determines_all]
    if hatched:
        axes.barh(
            hatched,
            1.0,
            height=0.75,
            label="most runs leave a quantity not determined",
            fill=False,
            **HATCHED,
        )
    axes.set_yticks(places, [label_of(cell, varied) or "all" for cell in shown], fontsize="x-small")
    axes.set(
        xlim=(0, 1),
        ylim=(-0.7, len(shown) - 0.3),
        xlabel=f"share of runs [-]; right: within {LARGEST_STATED_ERROR:g} deviations",
    )
    tidy(axes)
    figure.legend(loc="outside lower center", ncols=3, fontsize="small", frameon=False)
    return figure


def label_of(cell: CellSummary, varied: Sequence[str]) -> str:
    """Label of a cell by its levels that vary."""
    words = ", ".join(
        cell.levels[name] if "." not in name else f"{name} {cell.levels[name]}" for name in varied
    )
    return words.replace("$", r"\$")  # no formula
