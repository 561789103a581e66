"""The command ``plot``."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from spinfilters.cli.command import Command, Panels, PrintWidth
from spinfilters.cli.common_options import PrintingOptions, print_document
from spinfilters.core.errors import InputError
from spinfilters.io.stated_values import Argument

if TYPE_CHECKING:
    from spinfilters.plots.figures import FigureData


@dataclass(frozen=True, kw_only=True)
class PlotArguments:
    """Arguments of ``plot``."""

    run: Annotated[str, Argument("folder made by compare or estimate", positional=True, metavar="RUN")]
    output: Annotated[
        str | None,
        Argument("print figures into this folder and leave the run as it is", short="-o", metavar="FOLDER"),
    ] = None
    format: Annotated[Literal["png", "svg", "pdf"], Argument("file format of printed figures")] = "pdf"
    panels: Panels = False
    width: PrintWidth = None
    figures: Annotated[
        str | None, Argument("names of the figures to print, with commas", metavar="NAMES")
    ] = None


def draw_again(options: PlotArguments) -> int:
    """Draw the figures of a run folder again and write its report, or print figures into a folder."""
    from spinfilters.cli.console import progress_bars, wide_console
    from spinfilters.plots.figures import draw_run
    from spinfilters.run.optional_outputs import draw_optional_outputs
    from spinfilters.run.run_folder import read_figure_data
    from spinfilters.run.run_lock import locked_run
    from spinfilters.run.run_report import write_run_report

    folder = Path(options.run)
    figure_data = read_figure_data(folder)
    if options.output is not None:
        return _print_figures(folder, figure_data, options)
    if options.panels or options.width is not None or options.figures is not None:
        raise InputError("--panels, --width and --figures are of printed figures; give a folder with -o")
    with locked_run(folder), progress_bars() as report:
        drawn = draw_run(figure_data, folder, lambda done, total: report("figures", done, total))
        drawn += draw_optional_outputs(folder, figure_data.evaluations, figure_data.dataset.truth)
        write_run_report(figure_data, folder)
    wide_console().print(f"{len(drawn)} figures and the report in {folder}", highlight=False, soft_wrap=True)
    print_document({"folder": str(folder), "figures": len(drawn)})
    return 0


def _print_figures(run: Path, figure_data: "FigureData", options: PlotArguments) -> int:
    """Write figures as a paper prints them."""
    from spinfilters.cli.console import wide_console
    from spinfilters.io.output_files import output_folder, refuse_foreign, write_bytes
    from spinfilters.plots.figures import drawn_figure, figure_names
    from spinfilters.plots.printing import PrintStyle, printed_figure
    from spinfilters.plots.style import drawn
    from spinfilters.run.optional_outputs import optional_figures

    folder = Path(str(options.output))
    style = PrintStyle(options.format, options.width, options.panels)
    own, asked = figure_names(figure_data), options.figures.split(",") if options.figures else []
    pictures = {}
    if not asked or set(asked) - set(own):  # else a reference would be fitted for nothing
        pictures = optional_figures(run, figure_data.evaluations, figure_data.dataset.truth)
    further = {Path(name).stem: draw for name, draw in pictures.items()}
    names = asked or [*own, *further]
    refuse_foreign(folder, COMMAND.name)
    count = 0
    with output_folder(folder, COMMAND.name) as place:
        for name in names:
            known = name in further and name not in own
            figure = drawn(further[name], name) if known else drawn_figure(figure_data, name, further)
            for file, content in printed_figure(figure, name, style).items():
                write_bytes(place / file, content)
                count += 1
    wide_console().print(f"{count} files in {folder}", highlight=False, soft_wrap=True)
    print_document({"folder": str(folder), "files": count})
    return 0


COMMAND = Command(
    "plot",
    PlotArguments,
    draw_again,
    "Without -o the figures and the report of the run are made again. With -o, figures are printed for a paper: as PDF, SVG or "
    "PNG, at a column's width. On demand each panel is a file; shared legends are files of their own.",
    common=PrintingOptions,
)
