"""``spinfilters observe``: what a sensor can determine of a motion, proved, and how well."""

import argparse
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from observability.bounds.quantities import bounded_quantities, weak_direction_in_words
from observability.cases import Case
from observability.motions import Motion, motion
from observability.rational import as_floats
from observability.study import study
from observability.system import Input
from observability.wording import document, sentences
from spinfilters.cli.console import wide_console
from spinfilters.conventions import RPM
from spinfilters.errors import InputError
from spinfilters.logs.atomic_write import write_json, write_text
from spinfilters.logs.output_folder import output_folder, refuse_foreign
from spinfilters.plots.bounds import observability_figure, study_figure
from spinfilters.plots.conditioning import conditioning_figure
from spinfilters.plots.style import save_figure

COMMAND, RESULT_FILE = "observe", "observe.json"
MOST_FRAMES, MOST_LANDMARKS = 5000, 200
"""Beyond these the bound takes minutes and says nothing new."""
SHORTEST, LONGEST = 1e-6, 1e5
"""Interval in s: between those the numbers of all sensors are of a size that double precision holds."""
MOST_RPM, MOST_TURNS = 1e6, 100
"""Of the rate; and between frames: the motion is integrated step by step."""


def observe(options: argparse.Namespace) -> int:
    """Analyse, bound, write text, JSON and a picture, print the text."""
    case, folder = _case(options), Path(options.output)
    _refuse(options, folder)
    certificate = case.certificate()
    flight = case.flight(options.frames, options.interval)
    bound = case.bound(flight)
    quantities = bounded_quantities(bound, flight)
    final = {name: float(values[-1]) for name, values in quantities.items()}
    lines = [_title(case), *sentences(certificate), *_bound_lines(final, options)]
    lines.append(f"Least known: {weak_direction_in_words(bound)}.")
    with output_folder(folder, COMMAND) as place:
        write_text(place / "observe.txt", "\n".join(lines) + "\n")
        save_figure(
            observability_figure(certificate, flight.time, quantities, _title(case)), place / "observe.png"
        )
        written = {f"{name} [{unit}]": value for (name, unit), value in final.items()}
        write_json(place / RESULT_FILE, {"case": _title(case), **document(certificate), "bound": written})
        if options.study:
            _study(case, options, place)
    wide_console().print("\n".join([*lines, f"written to {folder}"]), highlight=False, soft_wrap=True)
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
    save_figure(study_figure(found, _title(case)), folder / "study.png")
    save_figure(conditioning_figure(as_floats(case.motion.rate)), folder / "conditioning.png")


def _case(options: argparse.Namespace) -> Case:
    inputs = [Input(f"torque about {axis}") for axis in options.torque or ()]
    inputs += [Input(f"inspector's acceleration along {axis}") for axis in options.manoeuvre or ()]
    return Case(
        sensor=options.sensor,
        landmarks=options.landmarks,
        known_map=options.known_map,
        chart=options.chart,
        motion=_motion(options),
        inputs=tuple(dict.fromkeys(inputs)),
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
    if options.landmarks > MOST_LANDMARKS:
        raise InputError(f"--landmarks {options.landmarks}; give at most {MOST_LANDMARKS}, more add no rank")
    refuse_foreign(folder, COMMAND)


def _title(case: Case) -> str:
    cameras = {"stereo": "a stereo pair", "monocular": "one camera"}
    if case.sensor in cameras:
        known = "known" if case.known_map else "unknown"
        landmarks = f"{case.landmarks} {known} landmark{'s' if case.landmarks > 1 else ''}"
        sensor = f"{cameras[case.sensor]} and {landmarks}"
    else:
        sensor = f"the sensor {case.sensor}"
    acting = f", known {' and '.join(case.inputs)}" if case.inputs else ""
    moments = " ".join(f"{float(moment):g}" for moment in case.motion.moments)
    return f"{sensor}, {case.motion.name}, moments {moments}{acting}, chart: {case.system.chart.name}"


def _bound_lines(final: dict[tuple[str, str], float], options: argparse.Namespace) -> list[str]:
    known = " without the known inputs" if options.torque or options.manoeuvre else ""
    when = f"Cramer-Rao bound after {options.frames} frames at {options.interval:g} s{known}:"
    return [
        when,
        *[
            f"  {name:<28} {value:.3g} {'' if unit == '1' else unit}".rstrip()
            for (name, unit), value in final.items()
        ],
    ]
