"""The table that sets estimators side by side."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from spinfilters.evaluation.errors import BodyErrors, RmsErrors
from spinfilters.evaluation.evaluation import Evaluation
from spinfilters.evaluation.rounding import with_uncertainty

Cell = Callable[[Evaluation], str | None]
Errors = tuple[RmsErrors, BodyErrors]
Source = Callable[[Evaluation], Errors | None]
"""Of errors, or of the bound in their place."""

BOUND_CAPTION = (
    "bound: Cramer-Rao, the least standard deviation given all frames; of what moves a smoother can reach it, a filter in its last "
    "frame only"
)


def comparison_table(evaluations: Sequence[Evaluation]) -> Table:
    """One column per estimator; rows that no estimator can fill are left out.

    Errors are root mean squares over the second half of the time; NEES and NIS are per degree of freedom.
    """
    table = Table(title="Estimators on identical measurements", title_justify="left")
    if any(evaluation.bound is not None for evaluation in evaluations):
        table.caption, table.caption_justify = BOUND_CAPTION, "left"
    table.add_column("")
    for evaluation in evaluations:
        table.add_column(evaluation.name.upper(), justify="right")
    for name, cell in ROWS:
        cells = [cell(evaluation) for evaluation in evaluations]
        if any(text is not None for text in cells):
            table.add_row(Text(name), *(text or "-" for text in cells))
    return table


def _moment(index: int) -> Cell:
    def cell(evaluation: Evaluation) -> str:
        body = evaluation.body
        return with_uncertainty(body.principal_moments[index], body.principal_moments_std[index])

    return cell


def _errors(evaluation: Evaluation) -> Errors | None:
    if evaluation.errors is None or evaluation.body_errors is None:
        return None
    return evaluation.errors.rms_second_half, evaluation.body_errors


def _bound(evaluation: Evaluation) -> Errors | None:
    return None if evaluation.bound is None else (evaluation.bound.rms_second_half, evaluation.bound.body)


def _error(source: Source, part: int, field: str, show: Callable[[Any], str]) -> Cell:
    """A field of the errors of what moves (part 0) or of the body (1), where it is known."""

    def cell(evaluation: Evaluation) -> str | None:
        errors = source(evaluation)
        value = None if errors is None else getattr(errors[part], field)
        return None if value is None else show(value)

    return cell


def _rms(source: Source, field: str, unit_in_si: float) -> Cell:
    return _error(source, 0, field, lambda value: f"{value / unit_in_si:.3g}")


def _moment_errors(source: Source, sign: str) -> Cell:
    return _error(source, 1, "principal_moments", lambda found: f"{found[0]:{sign}.2g}, {found[1]:{sign}.2g}")


def _axes_angle(source: Source) -> Cell:
    return _error(source, 1, "axes_angle", lambda angle: f"{np.rad2deg(angle.max()):.3g}")


def _centre_error(source: Source) -> Cell:
    return _error(source, 1, "center_of_mass_g", lambda error: f"{1e3 * np.linalg.norm(error):.3g}")


def _motion_rows(name: str, unit: str, unit_in_si: float) -> tuple[tuple[str, Cell], ...]:
    """The error of something that moves, and its bound."""
    return (
        (f"{name} error [{unit}]", _rms(_errors, name, unit_in_si)),
        (f"  bound given all frames [{unit}]", _rms(_bound, name, unit_in_si)),
    )


def _drag(evaluation: Evaluation) -> str | None:
    body = evaluation.body
    return None if body.drag is None else f"{body.drag:.2e} ± {body.drag_std:.1e}"


def _nees(evaluation: Evaluation) -> str | None:
    nees = evaluation.nees
    return None if nees is None else f"{np.mean(nees.total) / nees.dof:.2f}"


def _block_nees(block: str) -> Cell:
    def cell(evaluation: Evaluation) -> str | None:
        mean = None if evaluation.nees is None else evaluation.nees.block_means.get(block)
        return None if mean is None else f"{mean:.2f}"

    return cell


def _nis(evaluation: Evaluation) -> str | None:
    return None if evaluation.nis_ratio is None else f"{evaluation.nis_ratio:.3f}"


def _runtime(evaluation: Evaluation) -> str | None:
    value = evaluation.milliseconds_per_frame
    return None if value is None else f"{value:.3g}"


BLOCK_NAMES: dict[str, str] = {
    "t": "position of g",
    "a": "attitude",
    "v": "velocity",
    "w": "rate",
    "c": "centre of mass",
    "s": "mass distribution",
    "d": "drag",
}
"""What the blocks of a state are called in the table."""

ROWS: tuple[tuple[str, Cell], ...] = (
    ("status", lambda evaluation: str(evaluation.history.status.verdict)),
    ("J smallest / largest", _moment(0)),
    ("J middle / largest", _moment(1)),
    ("errors of these", _moment_errors(_errors, "+")),
    ("  bound", _moment_errors(_bound, "")),
    ("largest error of a principal axis [deg]", _axes_angle(_errors)),
    ("  bound [deg]", _axes_angle(_bound)),
    ("centre of mass in g, error [mm]", _centre_error(_errors)),
    ("  bound [mm]", _centre_error(_bound)),
    ("drag [1/rad]", _drag),
    *_motion_rows("position", "mm", 1e-3),
    *_motion_rows("attitude", "deg", float(np.deg2rad(1.0))),
    *_motion_rows("velocity", "mm/s", 1e-3),
    *_motion_rows("rate", "deg/s", float(np.deg2rad(1.0))),
    ("NEES per dof", _nees),
    *((f"NEES per dof, {name}", _block_nees(block)) for block, name in BLOCK_NAMES.items()),
    ("NIS per dof", _nis),
    (
        "measurements accepted / rejected",
        lambda e: f"{e.history.accepted.sum()} / {e.history.rejected.sum()}",
    ),
    ("ms per frame (median)", _runtime),
)
"""Name and content of every row."""
