"""The report of a campaign's folder: one page, its pictures, a table of cells."""

import csv
from collections.abc import Mapping, Sequence
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import pyarrow as pa
from matplotlib.figure import Figure

from spinfilters.campaigns.campaign_folder import STUDY_FILE, read_folder
from spinfilters.campaigns.report.report_figures import bound_figure, nees_figure, verdict_figure
from spinfilters.campaigns.report.report_sections import (
    MOST_ROWS,
    asked_section,
    consistency_section,
    cost_section,
    errors_section,
    failures_section,
    verdict_section,
)
from spinfilters.campaigns.report.statistics import QUANTITIES, CellSummary, cell_summaries
from spinfilters.campaigns.rows_folder import read_rows
from spinfilters.campaigns.study import Study
from spinfilters.data.atomic_write import make_folder, write_bytes, write_text
from spinfilters.data.input_file import read_settings_text
from spinfilters.pages.page import image, page

REPORT: Final = "report"
PAGE: Final = "index.html"
_PAGE_DPI = 110
_FILE_DPI = 150


def write_report(folder: Path) -> Path:
    """Write the report of a campaign, finished or not; the path of its page.

    Raises
    ------
    InputError: no campaign's folder, no rows, damaged rows, a report that cannot be written.
    """
    study, document = read_folder(folder)
    table = read_rows(folder, study.columns)
    cells = list(cell_summaries(study, table))
    varied = study.varied or ["estimator"]
    target = folder / REPORT
    make_folder(target)
    pictures = {
        "nees": (nees_figure(cells, varied), "NEES over time with its band"),
        "bound": (bound_figure(cells, varied), "errors over the Cramer-Rao bound"),
        "verdicts": (verdict_figure(cells, varied), "verdicts against the truth"),
    }
    shown = {name: _picture(target, name, *each) for name, each in pictures.items()}
    failures = failed_rows(table)
    sections = {
        "What was asked": asked_section(
            study.options.description, _told(study, table, document), read_settings_text(folder / STUDY_FILE)
        ),
        "Consistency": consistency_section(cells, varied, shown["nees"]),
        "Errors": errors_section(cells, varied, shown["bound"]),
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
    intervals = [
        "nees",
        *(f"error_{name}" for name in QUANTITIES),
        *(f"over_bound_{name}" for name in QUANTITIES),
    ]
    head = [f"{name}{end}" for name in intervals for end in ("", "_low", "_high")]
    writer.writerow(["cell", *factors, "runs", "ok", "right_of_ok", *head])
    for cell in cells:
        each = [cell.nees, *(cell.errors[n] for n in QUANTITIES), *(cell.over_bound[n] for n in QUANTITIES)]
        limits = [value for found in each for value in (found.value, found.low, found.high)]
        levels = [cell.levels[name] for name in factors]
        writer.writerow([cell.cell, *levels, cell.runs, cell.ok.value, cell.right_of_ok.value, *limits])
    return stream.getvalue()


def _told(study: Study, table: pa.Table, document: Mapping[str, Any]) -> dict[str, str]:
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
    page_png, png, svg = BytesIO(), BytesIO(), BytesIO()
    figure.savefig(page_png, format="png", dpi=_PAGE_DPI)
    figure.savefig(png, format="png", dpi=_FILE_DPI)
    with mpl.rc_context({"svg.hashsalt": name}):
        figure.savefig(svg, format="svg", metadata={"Date": None})
    write_bytes(folder / f"{name}.png", png.getvalue())
    write_bytes(folder / f"{name}.svg", svg.getvalue())
    return image(page_png.getvalue(), words)
