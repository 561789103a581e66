"""``spinfilters condition``: how well conditioned covariances are, by time step and units."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from rich.table import Table

from observability.conditioning import (
    BEST_CONDITION,
    CovarianceConditioning,
    best_time_step,
    best_velocity_unit,
    condition_number,
    conditions_over,
    covariance_conditioning,
    double_integrator_covariance,
    improves,
    jacobi_scaling,
    noise_covariance,
    scaled,
    suggest_scaling,
)
from spinfilters.cli.console import wide_console
from spinfilters.core.conventions import RPM
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text
from spinfilters.io.output_files import output_folder, refuse_foreign, write_json, write_text
from spinfilters.models.rotation_integrator import IntegrationError
from spinfilters.plots.observability_figures import TIME_STEPS, conditioning_figure, covariance_figure
from spinfilters.plots.style import save_figure
from spinfilters.run.array_files import read_history
from spinfilters.run.run_folder import HISTORY_FILE

COMMAND = "condition"
RESULT_FILE, TABLE_FILE, PICTURE_FILE = "condition.json", "condition.csv", "condition.png"
TIME_STEP, RATE_RPM = 0.5, (0.5, 10.0, 0.5)


class Findings(NamedTuple):
    """What the command writes and prints: ``condition.json``, lines of ``condition.csv``, a table and a picture."""

    document: dict[str, Any]
    lines: list[str]
    table: Table
    figure: Figure


def condition(options: argparse.Namespace) -> int:
    """Compute, write JSON, CSV and a picture, print the table."""
    folder = Path(options.output)
    refuse_foreign(folder, COMMAND)
    found = _of_time_step(options) if options.run is None else _of_run(options)
    with output_folder(folder, COMMAND) as place:
        write_text(place / TABLE_FILE, "".join(f"{line}\n" for line in found.lines))
        save_figure(found.figure, place / PICTURE_FILE)
        write_json(place / RESULT_FILE, found.document)
    console = wide_console()
    console.print(found.table)
    console.print(
        "\n".join([*found.document["text"], f"written to {folder}"]), highlight=False, soft_wrap=True
    )
    return 0


def _of_time_step(options: argparse.Namespace) -> Findings:
    dt = TIME_STEP if options.time_step is None else options.time_step
    alpha = best_velocity_unit(dt) if options.alpha is None else options.alpha
    rate = RPM * np.array(options.rate_rpm or RATE_RPM)
    try:
        rows = _noise_rows(dt, alpha, rate)
    except IntegrationError as error:
        raise InputError(f"{error}; give a shorter --time-step or a slower --rate-rpm") from None
    text = _sentences(dt, alpha, rate)
    document = {
        "time_step_s": dt,
        "alpha_per_s": alpha,
        "rate_rad_s": rate.tolist(),
        "best_time_step_s": best_time_step(alpha),
        "best_alpha_per_s": best_velocity_unit(dt),
        "best_condition_number": float(BEST_CONDITION),
        "condition_numbers": {f"{noise}, {units}": value for noise, units, value in rows},
        "text": text,
    }
    table = Table("process noise over the time step", "units", "condition number")
    for noise, units, value in rows:
        table.add_row(noise, units, f"{value:.4g}")
    return Findings(document, _sweep(alpha, rate), table, conditioning_figure(rate, dt, alpha))


def _noise_rows(dt: float, alpha: float, rate: Float[np.ndarray, " 3"]) -> list[tuple[str, str, float]]:
    """(what, units, condition number)."""
    line, turn, whole = "position and velocity", "attitude and rate", "pose and its velocities"
    suggestion, covariance = suggest_scaling(dt, rate), noise_covariance(dt, rate)
    return [
        (line, "SI", condition_number(double_integrator_covariance(dt))),
        (line, f"velocity in {alpha:.4g} m/s", condition_number(double_integrator_covariance(dt, alpha))),
        (turn, "SI", suggestion.before),
        (turn, f"rate in {suggestion.rate:.4g} rad/s", suggestion.after),
        (whole, "SI", condition_number(covariance)),
        (whole, "own deviations (Jacobi)", condition_number(scaled(covariance, jacobi_scaling(covariance)))),
    ]


def _sentences(dt: float, alpha: float, rate: Float[np.ndarray, " 3"]) -> list[str]:
    best, value = best_time_step(alpha), condition_number(double_integrator_covariance(dt, alpha))
    return [
        f"With alpha = {alpha:.4g} 1/s the best time step is sqrt(3)/alpha = {best:.4g} s, with a condition number of "
        f"{BEST_CONDITION:.2f}; at {dt:g} s it is {value:.4g}.",
        f"For a time step of {dt:g} s the best alpha is sqrt(3)/dt = {best_velocity_unit(dt):.4g} 1/s.",
        f"At a body rate of {float(np.linalg.norm(rate)):.3g} rad/s: {suggest_scaling(dt, rate)}.",
    ]


def _sweep(alpha: float, rate: Float[np.ndarray, " 3"]) -> list[str]:
    """Lines of the CSV: condition numbers over the time steps of the picture."""
    lines = ["time_step_s,position_velocity_si,position_velocity_alpha,whole_si,whole_jacobi"]
    for dt, *whole in zip(TIME_STEPS.tolist(), *conditions_over(TIME_STEPS, rate), strict=True):
        line = [condition_number(double_integrator_covariance(dt, unit)) for unit in (1.0, alpha)]
        lines.append(",".join(_cell(value) for value in (dt, *line, *whole)))
    return lines


def _cell(value: float) -> str:
    """Cell of a CSV file; empty for what is not finite."""
    return f"{value:.9g}" if np.isfinite(value) else ""


def _of_run(options: argparse.Namespace) -> Findings:
    if any(value is not None for value in (options.time_step, options.alpha, options.rate_rpm)):
        raise InputError(
            "a run has its own time steps and rates; give RUN, or --time-step, --alpha and --rate-rpm"
        )
    found = [_conditioning_of(path) for path in _histories(Path(options.run))]
    lines = ["estimator,time_s,si,one_unit_per_block,own_deviations"]
    table = Table("covariance of", "epochs", "units", "condition number: median", "largest")
    for each in found:
        for row in zip(each.time, each.plain, each.fixed, each.jacobi, strict=True):
            lines.append(",".join([each.name, *map(_cell, row)]))
        for units, values in _kinds(each):
            table.add_row(each.name, str(len(values)), units, *map(_shown, _summary(values)))
    document = {
        "run": str(options.run),
        "estimators": {each.name: _document(each) for each in found},
        "text": [_improvement(each) for each in found],
    }
    return Findings(document, lines, table, covariance_figure(found))


def _histories(run: Path) -> list[Path]:
    if not run.is_dir():
        raise InputError(f"{path_text(run)}: no such folder; give a run folder made by compare or estimate")
    paths = sorted(run.glob(f"*/{HISTORY_FILE}"))
    if not paths:
        raise InputError(
            f"{path_text(run)}: holds no {HISTORY_FILE} of an estimator; give a run folder made by compare or estimate"
        )
    return paths


def _conditioning_of(path: Path) -> CovarianceConditioning:
    history = read_history(path)
    return covariance_conditioning(history.name, history.layout, history.time, history.factor)


def _kinds(each: CovarianceConditioning) -> Sequence[tuple[str, Float[np.ndarray, " n"]]]:
    return (
        ("SI", each.plain),
        ("one unit per block", each.fixed),
        ("every component's own deviation", each.jacobi),
    )


def _summary(values: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """Median and largest of the epochs that have a number; NaN where none has."""
    finite = values[np.isfinite(values)]
    return (float(np.median(finite)), float(finite.max())) if finite.size else (np.nan, np.nan)


def _shown(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "-"


def _document(each: CovarianceConditioning) -> dict[str, Any]:
    found: dict[str, Any] = {"units_of_blocks": each.units, "epochs": len(each.time)}
    found["epochs_without_a_number"] = int(np.sum(~np.isfinite(each.plain)))
    for units, values in _kinds(each):
        median, largest = _summary(values)
        found[units] = {"median": median, "largest": largest}
    return found


def _improvement(each: CovarianceConditioning) -> str:
    before, after = _summary(each.plain)[0], _summary(each.fixed)[0]
    if not np.isfinite(before):
        return f"{each.name}: no epoch has a finite covariance of positive variances."
    units = ", ".join(f"{block} {unit:.2g}" for block, unit in each.units.items())
    if not improves(before, after):
        return f"{each.name}: no units of whole blocks improve on SI ({before:.3g} in the median; {after:.3g} with {units})."
    return f"{each.name}: blocks in units of {units} (SI) take the median condition number from {before:.3g} to {after:.3g}."
