"""The command ``condition``: how well conditioned covariances are, by time step and units."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from spinfilters.cli.command import Command
from spinfilters.cli.common_options import FigureOptions, draw, print_document
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text
from spinfilters.io.stated_values import Argument, NumberRange
from spinfilters.simulation.scenario_record import Rates

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from observability.conditioning import ConditioningReport

TIME_STEP: Final = 0.5
RATE_RPM: Final = (0.5, 10.0, 0.5)


@dataclass(frozen=True, kw_only=True)
class ConditionArguments:
    """Arguments of ``condition``; the motion is for process noise alone, a run has its own."""

    run: Annotated[
        str | None, Argument("run folder made by compare or estimate", positional=True, metavar="RUN")
    ] = None
    output: Annotated[str, Argument("JSON, CSV and picture", short="-o", metavar="FOLDER")] = "runs/condition"
    time_step: Annotated[
        float | None, NumberRange(1e-6, 1e6, "s"), Argument(f"s (default {TIME_STEP:g})", metavar="DT")
    ] = None
    alpha: Annotated[
        float | None,
        NumberRange(1e-6, 1e6, "1/s"),
        Argument("unit of velocity over that of position, 1/s (default sqrt(3)/DT, the best)", metavar="A"),
    ] = None
    rate_rpm: Annotated[
        Rates | None,
        Argument("body rate about the principal axes x, y, z (default 0.5 10 0.5)", metavar=("X", "Y", "Z")),
    ] = None


def condition(options: ConditionArguments) -> int:
    """Compute, write JSON, CSV and a picture, print the table."""
    from rich.table import Table

    from spinfilters.cli.console import wide_console
    from spinfilters.io.output_files import output_folder, refuse_foreign, write_json, write_text

    folder = Path(options.output)
    refuse_foreign(folder, COMMAND.name)
    report, figure = _of_time_step(options) if options.run is None else _of_run(options, Path(options.run))
    with output_folder(folder, COMMAND.name) as place:
        write_text(place / "condition.csv", "".join(f"{line}\n" for line in report.lines))
        draw(figure, place / "condition.png")
        write_json(place / "condition.json", report.document)
    table = Table(*report.headings)
    for row in report.rows:
        table.add_row(*row)
    console = wide_console()
    console.print(table)
    console.print("\n".join([*report.sentences, f"written to {folder}"]), highlight=False, soft_wrap=True)
    print_document(report.document)
    return 0


def _of_time_step(options: ConditionArguments) -> "tuple[ConditioningReport, Callable[[], Figure]]":
    import numpy as np

    from observability.conditioning import best_velocity_unit, noise_report
    from spinfilters.core.conventions import RPM
    from spinfilters.models.rotation_integrator import IntegrationError
    from spinfilters.plots.observability_figures import conditioning_figure

    dt = TIME_STEP if options.time_step is None else options.time_step
    alpha = best_velocity_unit(dt) if options.alpha is None else options.alpha
    rate = RPM * np.array(options.rate_rpm or RATE_RPM)
    try:
        report = noise_report(dt, alpha, rate)
    except IntegrationError as error:
        raise InputError(f"{error}; give a shorter --time-step or a slower --rate-rpm") from None
    return report, lambda: conditioning_figure(rate, dt, alpha)


def _of_run(options: ConditionArguments, run: Path) -> "tuple[ConditioningReport, Callable[[], Figure]]":
    from observability.conditioning import covariance_conditioning, covariance_report
    from spinfilters.plots.observability_figures import covariance_figure
    from spinfilters.run.array_files import read_history
    from spinfilters.run.run_folder import HISTORY_FILE

    if any(value is not None for value in (options.time_step, options.alpha, options.rate_rpm)):
        raise InputError(
            "a run has its own time steps and rates; give RUN, or --time-step, --alpha and --rate-rpm"
        )
    if not run.is_dir():
        raise InputError(f"{path_text(run)}: no such folder; give a run folder made by compare or estimate")
    paths = sorted(run.glob(f"*/{HISTORY_FILE}"))
    if not paths:
        raise InputError(
            f"{path_text(run)}: holds no {HISTORY_FILE} of an estimator; give a run folder made by compare or estimate"
        )
    found = [
        covariance_conditioning(each.name, each.layout, each.time, each.factor)
        for each in map(read_history, paths)
    ]
    return covariance_report(str(run), found), lambda: covariance_figure(found)


COMMAND = Command(
    "condition",
    ConditionArguments,
    condition,
    "Without RUN: condition number of the process noise of a time step, velocity in units of alpha (section 4.9 of the thesis). "
    "The best is 13.93, at dt = sqrt(3)/alpha. Also that of the whole pose and its velocities at a body rate. With RUN: condition "
    "number of every estimator's own covariance over its epochs, and the units that improve it.",
    common=FigureOptions,
)
