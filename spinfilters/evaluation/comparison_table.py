"""Comparison of estimators as a table of texts, and that table in the terminal."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from rich.table import Table
from rich.text import Text

from spinfilters.evaluation.epoch_spans import (
    EpochSpan,
    epoch_sentences,
    own_span,
    shared_begin,
    shared_span,
    title_sentences,
)
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.metrics import Metric, Section, metrics

PARTS_CAPTION: Final = (
    "random / calibration: the two parts of the standard deviation after the last epoch; their squares add up. The second comes "
    "from the uncertainty of the calibration. If it is exact, as in your own simulation, set the deviations named above to 0 in "
    "the table [calibration] of the settings."
)

INTERVAL_CAPTION: Final = (
    "within ±: errors of the measurements may be correlated, so that a standard deviation covers two explanations and is too wide "
    "in the middle. These central intervals, by component, are quantiles of both."
)

BOUND_COLUMN = "BOUND"
BOUND_CAPTION = (
    "BOUND: Cramer-Rao bound, the smallest possible standard deviation with all epochs. A smoother can reach it at every epoch, a "
    "filter only at the last."
)


@dataclass(frozen=True)
class ComparisonCells:
    """Texts of the table.

    Attributes
    ----------
    title, captions : tuple[str, ...]
        Sentences above and below.
    headings : tuple[str, ...]
        Of the columns behind the rows' names.
    sections : tuple[tuple[tuple[str, ...], ...], ...]
        Groups of rows, each a name and a cell per heading.
    """

    title: tuple[str, ...]
    headings: tuple[str, ...]
    sections: tuple[tuple[tuple[str, ...], ...], ...]
    captions: tuple[str, ...]


def comparison_cells(evaluations: Sequence[Evaluation], conditions: Sequence[str] = ()) -> ComparisonCells:
    """One column per estimator; rows that no estimator can fill are left out.

    Errors (root mean squares), NEES and counts are over the epochs that every estimator has made itself; the rows "all epochs"
    are over all of an estimator's own, where these are more.

    Parameters
    ----------
    conditions : Sequence[str]
        Sentences on what was estimated, for the title.
    """
    begin = shared_begin(evaluations)
    shared = [shared_span(evaluation, begin) for evaluation in evaluations]
    every = [own if own.begin < begin else None for own in map(own_span, evaluations)]
    bounded = any(evaluation.bound is not None for evaluation in evaluations)
    missing = [f"No BOUND: {e.bound_missing}." for e in evaluations if e.bound_missing is not None]
    headings = [evaluation.name.upper() for evaluation in evaluations]
    shown = [metric for metric in metrics() if metric.label]
    sections = {
        section: [_row(each, shared, bounded) for each in shown if each.section is section]
        for section in Section
    }
    whole = [metric for metric in shown if metric.of_epochs and metric.needs_truth and metric.label[0] != " "]
    sections[Section.FURTHER] += [_row(metric, every, bounded, "all epochs: ") for metric in whole]
    return ComparisonCells(
        title=(*title_sentences(evaluations), *conditions),
        headings=(*headings, *([BOUND_COLUMN] if bounded else [])),
        sections=tuple(tuple(row for row in rows if row is not None) for rows in sections.values()),
        captions=(
            *epoch_sentences(evaluations),
            *([BOUND_CAPTION] if bounded else missing[:1]),
            *([PARTS_CAPTION] if any(e.history.calibration is not None for e in evaluations) else []),
            *([INTERVAL_CAPTION] if any(e.history.mixture is not None for e in evaluations) else []),
        ),
    )


def comparison_table(evaluations: Sequence[Evaluation], conditions: Sequence[str] = ()) -> Table:
    """The table of `comparison_cells` for a terminal."""
    cells = comparison_cells(evaluations, conditions)
    table = Table(title=Text("\n".join(cells.title)), title_justify="left")
    table.caption, table.caption_justify = "\n".join(cells.captions) or None, "left"
    table.add_column("")
    for heading in cells.headings:
        table.add_column(heading, justify="right")
    for section in cells.sections:
        for name, *row in section:
            table.add_row(Text(name), *row)
        table.add_section()
    return table


def _row(
    metric: Metric, spans: Sequence[EpochSpan | None], bounded: bool, before: str = ""
) -> tuple[str, ...] | None:
    """A metric's name and a cell per estimator, the bound's last; None where no estimator has it."""
    held = [span for span in spans if span is not None]
    cells = [None if span is None else metric.text(metric.of(span)) for span in spans]
    if all(text is None for text in cells):
        return None
    name = f"{before}{metric.heading.replace(' error', '') if before else metric.heading}"
    bounds = (text for span in held if (text := metric.text(metric.bound_of(span))) is not None)
    return (
        name,
        *(text or "-" for text in cells),
        *([next(bounds, "").removeprefix("+")] if bounded else []),
    )
