"""Comparison of estimators as a table in the terminal, with standard deviations."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from rich.table import Table
from rich.text import Text

from spinfilters.evaluation.estimator_evaluation import Evaluation, numbers_text
from spinfilters.evaluation.metrics import (
    ALWAYS,
    ObservationUse,
    SpanErrors,
    held_text,
    observation_use,
    shared_begin,
    span_errors,
    title_sentences,
)
from spinfilters.evaluation.trajectory_errors import BodyErrors, RmsErrors
from spinfilters.models.state_blocks import BLOCKS, StateBlock

DEGREE: Final = float(np.deg2rad(1.0))


@dataclass(frozen=True)
class Column:
    """Source of the cells of one column.

    Attributes
    ----------
    use, errors : ObservationUse or None, SpanErrors or None
        Over the epochs that all estimators have.
    every : SpanErrors or None
        Errors over all of this estimator's own, where these are more.
    """

    evaluation: Evaluation
    use: ObservationUse | None
    errors: SpanErrors | None
    every: SpanErrors | None


Cell = Callable[[Column], str | None]


@dataclass(frozen=True)
class TableRow:
    """A named row of the table with the cells of estimators and bound; a cell is None where there is nothing to show."""

    name: str
    cell: Cell
    bound: Cell = lambda _: None


PARTS_CAPTION: Final = (
    "random / calibration: parts of the standard deviation after the last epoch, whose squares add up; the second is what the "
    "calibration's own uncertainty adds. If it is exact, as of a simulation of your own, state in the settings' table "
    "[calibration] that the deviations named above are 0."
)


def parts_row(name: str, quantity: str, unit_in_si: float = 1.0, component: int | None = None) -> TableRow:
    """Random and calibration part of a standard deviation: of one component, or the length of all."""

    def cell(column: Column) -> str | None:
        """A cell of the table."""
        if column.evaluation.history.calibration is None:
            return None
        part = column.evaluation.deviation_parts.get(quantity)
        if part is None:
            return None
        both = (part.random, part.calibration)
        sizes = [math.hypot(*each) if component is None else float(each[component]) for each in both]
        return " / ".join(f"{size / unit_in_si:.2g}" for size in sizes)

    return TableRow(name, cell)


LATEST_ROWS: Final = tuple(
    parts_row(f"{name}: random / calibration [{unit}]", quantity, scale)
    for name, quantity, unit, scale in (
        ("position", "position_m", "mm", 1e-3),
        ("attitude", "attitude_rad", "deg", DEGREE),
        ("velocity", "velocity_m_s", "mm/s", 1e-3),
        ("rate", "rate_rad_s", "deg/s", DEGREE),
        ("centre of mass", "center_of_mass_m", "mm", 1e-3),
    )
)
"""Of the latest state and the centre of mass in g."""


BOUND_COLUMN = "BOUND"
BOUND_CAPTION = (
    "BOUND: Cramer-Rao, the least standard deviation given all epochs; of what moves a smoother can reach it, a filter in its last "
    "epoch only."
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
    columns = [_column(evaluation, begin) for evaluation in evaluations]
    bounded = any(evaluation.bound is not None for evaluation in evaluations)
    missing = [f"No BOUND: {e.bound_missing}." for e in evaluations if e.bound_missing is not None]
    headings = [column.evaluation.name.upper() for column in columns]
    rows = [[_filled(row, columns, bounded) for row in section] for section in SECTIONS]
    return ComparisonCells(
        title=(*title_sentences(evaluations), *conditions),
        headings=(*headings, *([BOUND_COLUMN] if bounded else [])),
        sections=tuple(tuple(row for row in section if row is not None) for section in rows),
        captions=(
            *epoch_sentences(evaluations),
            *([BOUND_CAPTION] if bounded else missing[:1]),
            *([PARTS_CAPTION] if any(e.history.calibration is not None for e in evaluations) else []),
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


def _filled(row: TableRow, columns: Sequence[Column], bounded: bool) -> tuple[str, ...] | None:
    """A row's name and cells, the bound's last; None where no estimator fills one."""
    cells = [row.cell(column) for column in columns]
    if all(text is None for text in cells):
        return None
    bounds = (text for column in columns if (text := row.bound(column)) is not None)
    return (row.name, *(text or "-" for text in cells), *([next(bounds, "")] if bounded else []))


def epoch_sentences(evaluations: Sequence[Evaluation]) -> list[str]:
    """Sentence on the epochs of the errors; none without an initialisation."""
    history = max((e.history for e in evaluations), key=lambda history: history.initialisation)
    begin, count = shared_begin(evaluations), history.initialisation
    if not count or begin == ALWAYS:
        return []
    own = {e.name: int(np.count_nonzero(e.history.time[e.history.own] >= begin)) for e in evaluations}
    if len(set(own.values())) == 1:
        epochs = f"the {next(iter(own.values()))} epochs from t = {begin:.6g} s on, which every estimator made itself"
    else:
        each = ", ".join(f"{name.upper()} {number}" for name, number in own.items())
        epochs = f"every estimator's own epochs from t = {begin:.6g} s on ({each})"
    return [
        f"Errors, NEES, NIS and counts: over {epochs}. The {count} before are the filters' initialisation, made by a smoother."
    ]


def _column(evaluation: Evaluation, begin: float) -> Column:
    own, use = evaluation.own_begin, observation_use(evaluation.history, begin)
    if own is None:
        return Column(evaluation, use, None, None)
    every = span_errors(evaluation, own) if own < begin else None
    return Column(evaluation, use, span_errors(evaluation, begin), every)


def _moment(index: int, part: int) -> Cell:
    """A principal moment (part 0) or its standard deviation (1)."""

    def cell(column: Column) -> str:
        """A cell of the row."""
        pair = column.evaluation.moment_texts[index]
        return pair.split(" ± ")[part] if " ± " in pair else pair

    return cell


def _moment_error(index: int) -> TableRow:
    def shown(body: BodyErrors | None, sign: str) -> str | None:
        """A number as it is printed."""
        return (
            None
            if body is None or body.principal_moments is None
            else f"{body.principal_moments[index]:{sign}#.2g}"
        )

    return TableRow(
        "  error", lambda c: shown(c.evaluation.body_errors, "+"), lambda c: shown(_body_bound(c), "")
    )


def _moment_rows(name: str, index: int) -> tuple[TableRow, ...]:
    return (
        TableRow(name, _moment(index, 0)),
        TableRow("  standard deviation", _moment(index, 1)),
        parts_row("    random / calibration", "principal_moments", component=index),
        _moment_error(index),
    )


def _body_bound(column: Column) -> BodyErrors | None:
    return None if column.evaluation.bound is None else column.evaluation.bound.body


def _axis(body: BodyErrors | None) -> str | None:
    return None if body is None or body.axes_angle is None else f"{np.rad2deg(body.axes_angle.max()):.3g}"


def _centre(body: BodyErrors | None) -> str | None:
    error = None if body is None else body.center_of_mass_g
    return None if error is None else f"{1e3 * math.hypot(*error):.3g}"


def _rms_row(
    name: str, field: str, unit_in_si: float, span: Callable[[Column], SpanErrors | None]
) -> TableRow:
    """The root mean square of something that moves over a span, and its bound."""

    def shown(rms: RmsErrors | None) -> str | None:
        """A number as it is printed."""
        value = None if rms is None else getattr(rms, field)
        return None if value is None else f"{value / unit_in_si:.3g}"

    def cell(column: Column) -> str | None:
        """A cell of the row."""
        found = span(column)
        return None if found is None else shown(found.rms)

    def bound(column: Column) -> str | None:
        """The bound's cell."""
        found = span(column)
        return None if found is None else shown(found.bound)

    return TableRow(name, cell, bound)


def _nees(span: Callable[[Column], SpanErrors | None], block: str | None = None) -> Cell:
    """NEES per degree of freedom of a block or the state."""

    def cell(column: Column) -> str | None:
        """A cell of the row."""
        found = span(column)
        value = None if found is None else found.nees if block is None else found.nees_blocks.get(block)
        return None if value is None else f"{value:.2f}"

    return cell


def _constant_rows(block: StateBlock) -> tuple[TableRow, ...]:
    """Value and standard deviation of a constant that is a result of its own."""
    reported = block.reported
    if reported is None:
        return ()

    def value(column: Column) -> str | None:
        """The constant's value."""
        found = column.evaluation.constants.get(block.name)
        return None if found is None else numbers_text(found.value, reported.value_format)

    def std(column: Column) -> str | None:
        """The constant's standard deviation."""
        found = column.evaluation.constants.get(block.name)
        return None if found is None else numbers_text(found.std, reported.std_format)

    return TableRow(f"{block.label} [{block.unit}]", value), TableRow("  standard deviation", std)


def _used(show: Callable[[ObservationUse], str | None]) -> Cell:
    return lambda column: None if column.use is None else show(column.use)


def _own_epochs(column: Column) -> str:
    """Number of own epochs, and how many of them errors and counts are over where these are fewer."""
    history = column.evaluation.history
    own = len(history.time[history.own])
    compared = own if column.use is None else len(column.use.accepted)
    return str(own) if compared == own else f"{own}, {compared} compared"


def _optional(value: float | None, form: str) -> str | None:
    return None if value is None else format(value, form)


def _share(use: ObservationUse) -> str | None:
    return None if use.share is None else f"{100 * use.share:.1f} %"


def _shared(column: Column) -> SpanErrors | None:
    return column.errors


def _every(column: Column) -> SpanErrors | None:
    return column.every


MOTIONS = (
    ("position", "mm", 1e-3),
    ("attitude", "deg", DEGREE),
    ("velocity", "mm/s", 1e-3),
    ("rate", "deg/s", DEGREE),
)
"""What moves: name, unit, and that in SI."""

SECTIONS: tuple[tuple[TableRow, ...], ...] = (
    (
        TableRow("status", lambda c: str(c.evaluation.history.status.verdict)),
        TableRow("what holds", lambda c: held_text(c.evaluation) or None),
        TableRow("own epochs", lambda c: _own_epochs(c)),
        TableRow("observations per epoch", _used(lambda use: _optional(use.available_per_epoch, ".1f"))),
        TableRow("  of these used", _used(lambda use: f"{use.used_per_epoch:.1f}")),
        TableRow("  share used", _used(_share)),
        TableRow("accepted / rejected", _used(lambda use: f"{use.accepted.sum()} / {use.rejected.sum()}")),
    ),
    (
        *_moment_rows("J smallest / largest", 0),
        *_moment_rows("J middle / largest", 1),
        TableRow(
            "worst principal axis [deg]",
            lambda c: _axis(c.evaluation.body_errors),
            lambda c: _axis(_body_bound(c)),
        ),
        TableRow(
            "centre of mass, error [mm]",
            lambda c: _centre(c.evaluation.body_errors),
            lambda c: _centre(_body_bound(c)),
        ),
        *(row for block in BLOCKS.values() for row in _constant_rows(block)),
    ),
    tuple(_rms_row(f"{name} error [{unit}]", name, scale, _shared) for name, unit, scale in MOTIONS),
    LATEST_ROWS,
    (
        TableRow("NEES per dof", _nees(_shared)),
        *(TableRow(f"  {block.label}", _nees(_shared, block.name)) for block in BLOCKS.values()),
        TableRow("NIS per dof", lambda c: _optional(c.evaluation.nis_ratio, ".3f")),
    ),
    (
        *(_rms_row(f"all epochs: {name} [{unit}]", name, scale, _every) for name, unit, scale in MOTIONS),
        TableRow("all epochs: NEES per dof", _nees(_every)),
    ),
    (TableRow("ms per epoch (median)", lambda c: _optional(c.evaluation.milliseconds_per_frame, ".3g")),),
)
"""Rows of the table, in groups."""
