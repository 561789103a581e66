"""The table that sets estimators side by side."""

from collections.abc import Callable, Sequence

import numpy as np
from rich.markup import escape
from rich.table import Table

from spinfilters.evaluation.evaluation import Evaluation
from spinfilters.evaluation.rounding import with_uncertainty

Cell = Callable[[Evaluation], str | None]


def comparison_table(evaluations: Sequence[Evaluation]) -> Table:
    """One column per estimator; rows that no estimator can fill are left out.

    Errors are root mean squares over the second half of the time; NEES and NIS are per degree of freedom.
    """
    table = Table(title="Estimators on identical measurements", title_justify="left")
    table.add_column("")
    for evaluation in evaluations:
        table.add_column(evaluation.name.upper(), justify="right")
    for name, cell in ROWS:
        cells = [cell(evaluation) for evaluation in evaluations]
        if any(text is not None for text in cells):
            table.add_row(escape(name), *(text or "-" for text in cells))
    return table


def _moment(index: int) -> Cell:
    def cell(evaluation: Evaluation) -> str:
        body = evaluation.body
        return with_uncertainty(body.principal_moments[index], body.principal_moments_std[index])

    return cell


def _rms(field: str, unit_in_si: float) -> Cell:
    def cell(evaluation: Evaluation) -> str | None:
        if evaluation.errors is None:
            return None
        value = getattr(evaluation.errors.rms_second_half, field)
        return None if value is None else f"{value / unit_in_si:.3g}"

    return cell


def _moment_errors(evaluation: Evaluation) -> str | None:
    errors = None if evaluation.body_errors is None else evaluation.body_errors.principal_moments
    return None if errors is None else f"{errors[0]:+.2g}, {errors[1]:+.2g}"


def _axes_angle(evaluation: Evaluation) -> str | None:
    angle = None if evaluation.body_errors is None else evaluation.body_errors.axes_angle
    return None if angle is None else f"{np.rad2deg(angle.max()):.3g}"


def _centre_error(evaluation: Evaluation) -> str | None:
    error = None if evaluation.body_errors is None else evaluation.body_errors.center_of_mass_g
    return None if error is None else f"{1e3 * np.linalg.norm(error):.3g}"


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
    ("errors of these", _moment_errors),
    ("largest error of a principal axis [deg]", _axes_angle),
    ("centre of mass in g, error [mm]", _centre_error),
    ("drag [1/rad]", _drag),
    ("position error [mm]", _rms("position", 1e-3)),
    ("attitude error [deg]", _rms("attitude", float(np.deg2rad(1.0)))),
    ("velocity error [mm/s]", _rms("velocity", 1e-3)),
    ("rate error [deg/s]", _rms("rate", float(np.deg2rad(1.0)))),
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
