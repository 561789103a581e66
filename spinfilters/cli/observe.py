"""``spinfilters observe``: what a sensor can determine of a motion, proved, and how well."""

import argparse
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from observability.cases import Case, InputSizes
from observability.motions import Motion, motion
from observability.rational import as_floats
from observability.report import analyse
from observability.scope import title
from observability.study import study
from observability.system import Input
from spinfilters.cli.console import wide_console
from spinfilters.conventions import RPM
from spinfilters.errors import InputError
from spinfilters.logs.atomic_write import write_json, write_text
from spinfilters.logs.output_folder import output_folder, refuse_foreign
from spinfilters.plots.bounds import observability_figure, study_figure
from spinfilters.plots.conditioning import conditioning_figure
from spinfilters.plots.style import save_figure

COMMAND, RESULT_FILE = "observe", "observe.json"
MOST_FRAMES = 5000
"""Beyond it the bound takes minutes and says nothing new."""
SHORTEST, LONGEST = 1e-6, 1e5
"""Interval in s: between those the numbers of all sensors are of a size that double precision holds."""
MOST_RPM, MOST_TURNS = 1e6, 100
"""Of the rate; and between frames: the motion is integrated step by step."""


def observe(options: argparse.Namespace) -> int:
    """Analyse, bound, write text, JSON and a picture, print the text."""
    case, folder = _case(options), Path(options.output)
    _refuse(options, folder)
    found = analyse(case, options.frames, options.interval)
    with output_folder(folder, COMMAND) as place:
        write_text(place / "observe.txt", "\n".join(found.sentences) + "\n")
        save_figure(observability_figure(found, title(case)), place / "observe.png")
        write_json(place / RESULT_FILE, found.document())
        if options.study:
            _study(case, options, place)
    wide_console().print(
        "\n".join([*found.sentences, f"written to {folder}"]), highlight=False, soft_wrap=True
    )
    return 0


def _study(case: Case, options: argparse.Namespace, folder: Path) -> None:
    console = Console(stderr=True)
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


def _case(options: argparse.Namespace) -> Case:
    inputs = [Input(f"torque about {axis}") for axis in options.torque or ()]
    inputs += [Input(f"inspector's acceleration along {axis}") for axis in options.manoeuvre or ()]
    return Case(
        sensors=tuple(name for each in options.sensor for name in each.split(",") if name),
        landmarks=options.landmarks,
        known_map=options.known_map,
        chart=options.chart,
        unknowns=options.unknowns,
        motion=_motion(options),
        inputs=tuple(dict.fromkeys(inputs)),
        sizes=InputSizes(options.torque_size, options.manoeuvre_size, options.input_period),
    )


def _motion(options: argparse.Namespace) -> Motion:
    """Rates as given stay exact: 0 rpm about an axis is exactly 0."""
    rate = [round(rpm * RPM, 12) for rpm in options.rate_rpm]
    words = " ".join(f"{rpm:g}" for rpm in options.rate_rpm)
    return motion(f"{words} rpm", rate, options.moments)


def _refuse(options: argparse.Namespace, folder: Path) -> None:
    if not 1 <= options.frames <= MOST_FRAMES or not SHORTEST <= options.interval <= LONGEST:
        raise InputError(
            f"--frames {options.frames} --interval {options.interval}; give 1 to {MOST_FRAMES} frames and an interval of "
            f"{SHORTEST:g} to {LONGEST:g} s"
        )
    fastest = max(map(abs, options.rate_rpm))
    if fastest > MOST_RPM or fastest * options.interval / 60 > MOST_TURNS:
        raise InputError(
            f"--rate-rpm {' '.join(f'{rpm:g}' for rpm in options.rate_rpm)} at {options.interval:g} s; give rates of at most "
            f"{MOST_RPM:g} rpm and at most {MOST_TURNS} turns between frames"
        )
    refuse_foreign(folder, COMMAND)
