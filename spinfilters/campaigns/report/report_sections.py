"""Sections of a campaign's report, every text of the study escaped."""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, Final

import numpy as np

from spinfilters.campaigns.report.intervals import Interval, share
from spinfilters.campaigns.report.statistics import CellSummary
from spinfilters.campaigns.schema import BLOCKS, BODY_ERRORS, ERRORS
from spinfilters.campaigns.stated_errors import LARGEST
from spinfilters.pages.page import details, facts, note, table

MOST_ROWS: Final = 300
"""Of a table or list on the page; all cells are in cells.csv."""
BLOCK_NAMES: Final = {
    "t": "place of g",
    "a": "attitude",
    "v": "velocity",
    "w": "rate",
    "c": "centre",
    "s": "masses",
}
SCALES: Final = {"position_m": (1e3, "position [mm]"), "attitude_rad": (1e3, "attitude [mrad]")}
SCALES_MORE: Final = {"velocity_m_s": (1e3, "velocity [mm/s]"), "rate_rad_s": (1e3, "rate [mrad/s]")}
BODY: Final = dict(
    zip(BODY_ERRORS, ("moment 1 [%]", "moment 2 [%]", "k1 [%]", "k2 [%]", "centre [mm]"), strict=True)
)


def asked_section(description: str, told: Mapping[str, str], study: str) -> str:
    """The study: its facts in a table, and its file."""
    words = f"<p>{escape(description)}</p>" if description else ""
    return f"{words}{facts(told)}{details('study file', study)}"


def consistency_section(cells: Sequence[CellSummary], varied: Sequence[str], picture: str) -> str:
    """NEES by cell with its interval and band."""
    head = [
        *varied,
        "runs",
        "NEES / dof",
        "median",
        "last epoch",
        "95 % band",
        "epochs within",
        *(BLOCK_NAMES[b] for b in BLOCKS),
    ]
    rows = [[*_levels(cell, varied), *_consistency_cells(cell)] for cell in cells[:MOST_ROWS]]
    remark = (
        "Normalised estimation error squared per degree of freedom, 1 for a consistent estimator: mean over runs of the mean over "
        "the estimator's own epochs, with its 95 % confidence interval. Last epoch: mean over runs, marked where it lies outside "
        "the band that holds it with 95 % for a consistent estimator. Of the blocks: means."
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
        *(_number(cell.blocks[block].value) for block in BLOCKS),
    ]


def errors_section(cells: Sequence[CellSummary], varied: Sequence[str], picture: str) -> str:
    """Errors and their ratio to the bound."""
    motion = SCALES | SCALES_MORE
    body = {name: (1e3 if name.endswith("_m") else 1e2, label) for name, label in BODY.items()}
    shown = {**motion, **body}
    tables = []
    for quantities in (ERRORS, BODY_ERRORS):
        head = [*varied, *(part for name in quantities for part in (shown[name][1], "over bound"))]
        rows = [
            [
                *_levels(cell, varied),
                *(
                    part
                    for name in quantities
                    for part in (
                        _interval(cell.errors[name], shown[name][0]),
                        _interval(cell.over_bound[name]),
                    )
                ),
            ]
            for cell in cells[:MOST_ROWS]
        ]
        tables.append(table(head, rows, len(varied)))
    remark = (
        "Root mean square over runs with its 95 % confidence interval, of the motion over the estimator's own epochs, of the body "
        "at the last; and over the Cramer-Rao bound of smoothing, which a filter reaches at the last epoch and in constants only."
    )
    return note(remark) + "".join(tables) + _cut(cells) + picture


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
        f"Right: every published quantity of the last epoch is within {LARGEST:g} of its stated standard deviations of the truth. "
        "Said ok and wrong is what must not happen."
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
    remark = "A click shows the command that makes the run again and writes its data set, and one that looks at that."
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
