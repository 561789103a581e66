"""``spinfilters observe``: what a sensor determines of a motion, with proof and bounds."""

import argparse
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from observability.analysis_report import Report, title
from observability.bound_study import study
from observability.cases import InputSizes
from observability.exact_numbers import as_floats
from spinfilters.api.analysis import OBSERVE, KnownInputs, ObservabilityResult
from spinfilters.api.analysis import observe as observed
from spinfilters.cli.console import wide_console
from spinfilters.io.output_files import output_folder, refuse_foreign, write_json
from spinfilters.plots.observability_figures import conditioning_figure, study_figure
from spinfilters.plots.style import save_figure


def observe(options: argparse.Namespace) -> int:
    """Analyse, bound, write text, JSON and a picture, print the text."""
    folder = Path(options.output)
    refuse_foreign(folder, OBSERVE)
    found = _observed(options)
    with output_folder(folder, OBSERVE) as place:
        found.write(place)
        if options.study:
            _study(found.report, options, place)
    wide_console().print(f"{found}\nwritten to {folder}", highlight=False, soft_wrap=True)
    return 0


def _observed(options: argparse.Namespace) -> ObservabilityResult:
    sizes = InputSizes(options.torque_size, options.manoeuvre_size, options.input_period)
    return observed(
        ",".join(options.sensor),
        rate_rpm=options.rate_rpm,
        moments=options.moments,
        frames=options.frames,
        interval=options.interval,
        landmarks=options.landmarks,
        known_map=options.known_map,
        chart=options.chart,
        unknowns=options.unknowns,
        known=KnownInputs(options.torque or (), options.manoeuvre or (), sizes),
    )


def _study(report: Report, options: argparse.Namespace, folder: Path) -> None:
    case, console = report.case, Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("study")
        found = study(
            case,
            options.frames,
            options.interval,
            lambda done, total: progress.update(task, completed=done, total=total),
        )
    write_json(folder / "study.json", found.document())
    save_figure(study_figure(found, title(case)), folder / "study.png")
    save_figure(conditioning_figure(as_floats(case.motion.rate)), folder / "conditioning.png")
