"""The command ``plot``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from spinfilters.cli.command import Command
from spinfilters.io.stated_values import Argument


@dataclass(frozen=True, kw_only=True)
class PlotArguments:
    """Arguments of ``plot``."""

    run: Annotated[str, Argument("folder made by compare or estimate", positional=True, metavar="RUN")]


def draw_again(options: PlotArguments) -> int:
    """Draw the figures of a run folder again, and write its report."""
    from spinfilters.cli.console import progress_bars, wide_console
    from spinfilters.plots.figures import draw_run
    from spinfilters.run.optional_outputs import draw_optional_outputs
    from spinfilters.run.run_folder import read_figure_data
    from spinfilters.run.run_lock import locked_run
    from spinfilters.run.run_report import write_run_report

    folder = Path(options.run)
    figure_data = read_figure_data(folder)
    with locked_run(folder), progress_bars() as report:
        drawn = draw_run(figure_data, folder, lambda done, total: report("figures", done, total))
        drawn += draw_optional_outputs(folder, figure_data.evaluations, figure_data.dataset.truth)
        write_run_report(figure_data, folder)
    wide_console().print(f"{len(drawn)} figures and the report in {folder}", highlight=False, soft_wrap=True)
    return 0


COMMAND = Command("plot", PlotArguments, draw_again)
