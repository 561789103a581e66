"""The command ``observe``: what a sensor determines of a motion, with proof and bounds."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from spinfilters.api.arguments import ObserveArguments
from spinfilters.cli.command import Command
from spinfilters.cli.common_options import FigureOptions, draw, draws_figures, print_document, print_json_file
from spinfilters.core.errors import InputError
from spinfilters.io.argument_fields import given_fields
from spinfilters.io.stated_values import Argument, ArgumentGroup, NumberRange
from spinfilters.settings.settings_arguments import SettingsArguments

if TYPE_CHECKING:
    from observability.analysis_report import Report
    from observability.bound_section import StatedBound
    from observability.model_analysis import ModelAnalysis
    from spinfilters.api.analysis import ObservabilityResult
    from spinfilters.settings.run_settings import Settings

BODY_AXES: Final = (
    "x, y, z of the body's principal axes, fixed in the body and known in frame g; in every chart"
)
CAMERA_AXES: Final = (
    "x, y, z of the camera's axes at the first epoch (x right, y down, z forward); in every chart"
)

MODEL_OPTIONS: Final = ("model", "output", "execute", "symbols", "solutions")
"""Options that a model's file goes with; all others are of a tumbling body."""
RECORDING_OPTIONS: Final = ("recording", "segment", "stated", "output", "further")
"""Options that a recording goes with; all others are of a motion that is asked for."""


@dataclass(frozen=True, kw_only=True)
class ObserveCommandArguments(ObserveArguments):
    """Arguments of ``observe``: those of Python, known inputs axis by axis, and where the result goes."""

    model: Annotated[
        str | None,
        Argument(
            "your own equations instead of a tumbling body: states, parameters, equations, outputs; with a table bound, how well",
            positional=True,
            metavar="MODEL.toml",
        ),
    ] = None
    recording: Annotated[
        str | None,
        Argument(
            "a data set instead of a motion: what its measurements can determine, at the smoother's estimate",
            metavar="DATASET",
        ),
    ] = None
    segment: Annotated[
        str | None,
        Argument("segment of --recording, by its number or by its times in s", metavar="N|START:END"),
    ] = None
    output: Annotated[str, Argument("text, JSON and pictures", short="-o", metavar="FOLDER")] = "runs/observe"
    symbols: Annotated[
        bool,
        Argument(
            "for your own equations: print Lie derivatives, their gradients and null vectors as formulas"
        ),
    ] = False
    solutions: Annotated[
        bool,
        Argument("for your own equations: search for other values of the unknowns with the same outputs"),
    ] = False
    execute: Annotated[
        bool,
        Argument(
            "run MODEL as a Python program, and analyse the dictionary that it assigns to the name model"
        ),
    ] = False
    torque: Annotated[
        tuple[Literal["x", "y", "z"], ...], Argument(f"known torques about {BODY_AXES}", metavar="AXIS")
    ] = ()
    manoeuvre: Annotated[
        tuple[Literal["x", "y", "z"], ...],
        Argument(f"known accelerations of the inspector along {CAMERA_AXES}", metavar="AXIS"),
    ] = ()
    torque_size: Annotated[
        float,
        NumberRange(1e-6, 1e6, "N m"),
        Argument("amplitude of the torques in the bound, N m; --moments are then kg m^2", metavar="X"),
    ] = 0.1
    manoeuvre_size: Annotated[
        float,
        NumberRange(1e-6, 1e6, "m/s^2"),
        Argument("amplitude of the accelerations in the bound, m/s^2", metavar="X"),
    ] = 0.01
    input_period: Annotated[
        float,
        NumberRange(1e-6, 1e6, "s"),
        Argument("period of the first of them, s; each further one is faster", metavar="X"),
    ] = 20.0
    inputs: Annotated[
        str | None,
        Argument(
            "known inputs over time instead of cosines: a CSV with time_s, torque_x, torque_y, torque_z (N m) and acceleration_x, "
            "acceleration_y, acceleration_z (m/s^2), or some of them",
            metavar="FILE",
        ),
    ] = None
    stated: Annotated[SettingsArguments, ArgumentGroup()] = field(default_factory=SettingsArguments)
    study: Annotated[bool, Argument("maps of the bound against motion, duration, epochs, landmarks")] = False


def observe(options: ObserveCommandArguments) -> int:
    """Analyse, bound, write text, JSON and a picture, print the text."""
    if options.model is not None:
        return _observe_model(options, options.model)
    if options.execute:
        raise InputError(
            "--execute runs a model's program; give it, as in: spinfilters observe model.py --execute"
        )
    if options.symbols or options.solutions:
        raise InputError("--symbols and --solutions are of your own equations; give a model's file")
    from spinfilters.cli.console import wide_console
    from spinfilters.io.output_files import output_folder, refuse_foreign

    folder = Path(options.output)
    refuse_foreign(folder, COMMAND.name)
    if options.segment is not None and options.recording is None:
        raise InputError("--segment is of a recording; give --recording DATASET")
    found = (
        _observed(options) if options.recording is None else _observed_recording(options, options.recording)
    )
    with output_folder(folder, COMMAND.name) as place:
        found.write(place, draws_figures())
        if options.study:
            _write_study(found.report, options, place)
    wide_console().print(f"{found}\nwritten to {folder}", highlight=False, soft_wrap=True)
    print_document(found.document)
    return 0


def _observe_model(options: ObserveCommandArguments, model: str) -> int:
    """Analyse a model's file and bound what it asks for, write text, JSON, picture and page, print the text."""
    from observability.bound_section import stated_bound
    from observability.model_analysis import analyse
    from spinfilters.cli.console import progress_bars, wide_console
    from spinfilters.io.output_files import output_folder, refuse_foreign

    _refuse_others(
        options,
        MODEL_OPTIONS,
        "is of a tumbling body; leave it out, a model's file holds all of its equations and outputs",
    )
    folder, path = Path(options.output), Path(model)
    refuse_foreign(folder, COMMAND.name)
    document = _program(path) if options.execute else _document(path)
    name = _title(path, document)
    found = analyse(document, name=name)
    with progress_bars() as show, output_folder(folder, COMMAND.name) as place:
        stated = stated_bound(document, name, path.parent, show)
        text = _write_model(found, stated, options, place)
    wide_console().print(f"{text}\nwritten to {folder}", highlight=False, markup=False, soft_wrap=True)
    print_json_file(folder / "observability.json")
    return 0


def _refuse_others(options: ObserveCommandArguments, known: tuple[str, ...], why: str) -> None:
    """InputError: an option that is given and not among those known."""
    for each in given_fields(ObserveCommandArguments):
        if each.path[0] not in known and reduce(getattr, each.path, options) != each.default:
            raise InputError(f"{each.flag} {why}")


def _observed_recording(options: ObserveCommandArguments, recording: str) -> "ObservabilityResult":
    from spinfilters.api.recorded_observability import observe_recording
    from spinfilters.cli.console import progress_bars

    _refuse_others(
        options, RECORDING_OPTIONS, "is of a motion that is asked for; leave it out with --recording"
    )
    with progress_bars() as show:
        return observe_recording(
            recording, _settings(options), options.segment, further=options.further, progress=show
        )


def _title(path: Path, document: Mapping[str, Any]) -> str:
    """The file, and the name that it gives its system, for titles and complaints."""
    from spinfilters.io.input_file import value_text

    own = document.get("name")
    return f"{path.name} ({value_text(own)[1:-1]})" if isinstance(own, str) and own.strip() else path.name


def _document(path: Path) -> Mapping[str, Any]:
    from observability.model_analysis import read_model

    return read_model(path)


def _program(path: Path) -> Mapping[str, Any]:
    """The dictionary ``model`` of a Python program, which is run as the user asks."""
    from runpy import run_path

    try:
        document = run_path(str(path)).get("model")
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
    except SystemExit as stop:
        raise InputError(
            f"{path} ends itself with exit({'' if stop.code is None else repr(stop.code)}) before its model can be taken; "
            "leave the exit out"
        ) from None
    except Exception as error:
        raise InputError(
            f"{path} stops with {type(error).__name__}: {error}; run it with Python to see where"
        ) from None
    if not isinstance(document, Mapping):
        raise InputError(f"{path} gives no model; assign a dictionary of formulas to the name model")
    return document


def _write_model(
    found: "ModelAnalysis", stated: "StatedBound | None", options: ObserveCommandArguments, folder: Path
) -> str:
    """Everything about a model; the text."""
    from html import escape

    from spinfilters.io.output_files import write_json, write_text
    from spinfilters.plots.model_figures import model_figure
    from spinfilters.plots.page import image, page
    from spinfilters.plots.style import draw_figure

    lines, document, sections = (
        list(found.sentences),
        found.document(),
        {"Observability": found._repr_html_()},
    )
    if options.solutions:
        lines += found.isolated_solutions.sentences
        document["isolated_solutions"] = found.isolated_solutions.document()
        sections["Other solutions"] = f"<p>{escape(' '.join(found.isolated_solutions.sentences))}</p>"
    if options.symbols:
        formulas = found.symbols_in_words()
        lines += ["", formulas]
        document["observability_matrix"] = found.observability_matrix().document()
        sections["Formulas"] = f"<pre>{escape(formulas)}</pre>"
    if stated is not None:
        lines += ["", *stated.sentences]
        document["bound"] = stated.document()
        for name, each in stated.bounds.items():
            sections[f"How well: {name}" if name else "How well"] = each._repr_html_()
        sections["Gain"] = f"<pre>{escape(chr(10).join(stated.gain_sentences))}</pre>"
    write_text(folder / "observe.txt", "\n".join(lines) + "\n")
    write_json(folder / "observability.json", document)
    if draws_figures():
        picture = folder / "observability.png"
        draw_figure(lambda: model_figure(found, stated), picture)
        sections["Picture"] = image(picture.read_bytes(), "ranks, unknowns, bounds and gains")
    write_text(folder / "observability.html", page(sections, f"Observability of {found.model.name}"))
    return "\n".join(lines)


def _observed(options: ObserveCommandArguments) -> "ObservabilityResult":
    from observability.cases import InputSizes
    from spinfilters.api.analysis import KnownInputs
    from spinfilters.api.analysis import observe as observed
    from spinfilters.cli.console import progress_bars

    sizes = InputSizes(options.torque_size, options.manoeuvre_size, options.input_period)
    with progress_bars() as show:
        return observed(
            ",".join(options.sensors),
            rate_rpm=options.motion.rate_rpm,
            moments=options.motion.principal_moments,
            frames=options.motion.epochs,
            interval=options.motion.interval,
            landmarks=options.landmarks,
            known_map=options.known_map,
            chart=options.chart,
            unknowns=options.unknowns,
            known=KnownInputs(options.torque, options.manoeuvre, sizes, options.inputs),
            settings=_settings(options),
            further=options.further,
            progress=show,
        )


def _settings(options: ObserveCommandArguments) -> "Settings | None":
    """Settings of the file and the keys; None where neither is given."""
    stated = options.stated
    return stated.read() if stated.file is not None or stated.set else None


def _write_study(report: "Report", options: ObserveCommandArguments, folder: Path) -> None:
    from observability.analysis_report import title
    from observability.bound_study import study
    from observability.exact_numbers import as_floats
    from spinfilters.cli.console import progress_bars
    from spinfilters.io.output_files import write_json
    from spinfilters.plots.observability_figures import conditioning_figure, study_figure

    case, motion = report.case, options.motion
    with progress_bars() as show:
        found = study(case, motion.epochs, motion.interval, lambda done, total: show("study", done, total))
    write_json(folder / "study.json", found.document())
    draw(lambda: study_figure(found, title(case)), folder / "study.png")
    draw(lambda: conditioning_figure(as_floats(case.motion.rate)), folder / "conditioning.png")


COMMAND = Command("observe", ObserveCommandArguments, observe, common=FigureOptions)
