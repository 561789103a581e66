"""The command ``live``: filter and smoother side by side on measurements as they arrive."""

import os
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Final, TextIO

from spinfilters.cli.command import Command
from spinfilters.cli.common_options import (
    FigureOptions,
    draws_figures,
    print_document,
    prints_document,
    prints_text,
)
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import reason
from spinfilters.live.live_arguments import LiveArguments

if TYPE_CHECKING:
    from spinfilters.live.answer import Answer, AnswerWriter, CourseRecorder
    from spinfilters.live.executive import Executive
    from spinfilters.live.live_options import LiveOptions
    from spinfilters.live.sources import Source
    from spinfilters.settings.run_settings import Settings

MIB: Final = 1 << 20


def live(options: LiveArguments) -> int:
    """Estimate every epoch until measurements end; exit code 1 after missed deadlines, else 0."""
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
        return _answer_epochs(options, nowhere if prints_document() else sys.stdout)


def _answer_epochs(options: LiveArguments, target: TextIO) -> int:
    from spinfilters.cli.interrupts import require_uninterrupted, until_interrupted
    from spinfilters.io.output_files import write_json
    from spinfilters.live.answer import AnswerWriter, CourseRecorder
    from spinfilters.live.executive import Executive
    from spinfilters.live.kept_epochs import KeptEpochs, LastAnswer, final_verdict
    from spinfilters.live.live_options import live_setup
    from spinfilters.live.sources import Replay, open_lines
    from spinfilters.run.readers import read_dataset

    settings = options.stated.read()
    dataset = read_dataset(options.dataset, None)
    lines = None if options.input is None else open_lines(options.input, dataset.log.sensors)
    setup = live_setup(dataset, settings, options.filter)
    require_uninterrupted()
    kept = KeptEpochs(dataset, setup.time)
    executive = Executive(setup, _live_options(options, settings), kept.keep)
    source: Source = lines or Replay(dataset.log, setup.time, options.speed)
    if options.summary:  # a place that cannot be written is said now, not when the run is over
        write_json(Path(options.summary), executive.summary.document())
    course = CourseRecorder(executive.summary.deadline)
    writer = AnswerWriter(options.format, target)
    last = None
    try:
        with ExitStack() as stack:
            stack.callback(writer.close)
            show = _answer_printer(stack, options, executive, writer)
            for answer in executive.run(until_interrupted(source.epochs())):
                show(answer)
                course.keep(answer)
                last = answer
        writer.require_written()
        require_uninterrupted()
        if last is not None:
            estimator = "smoother" if last.source == "smoother" else options.filter
            answered = LastAnswer(last.time, last.belief, estimator)
            executive.summary.final = final_verdict(kept, settings, answered)
    except KeyboardInterrupt:
        pass
    except BrokenPipeError:  # the reader of the answers has gone
        _close_output()
    except OSError as error:
        if error is not writer.broken:
            raise
        _close_output()
        raise InputError(
            f"the answers cannot be written ({reason(error)}); free disk space or write them elsewhere"
        ) from None
    executive.summary.events.update(source.losses)
    if writer.dropped:
        executive.summary.events["answer not read"] += writer.dropped
    if prints_text():
        print(executive.summary.text(), file=sys.stderr)
    print_document(executive.summary.document())
    if options.summary:
        _write_summary(Path(options.summary), executive, course)
    return 1 if executive.summary.missed else 0


def _close_output() -> None:
    """Let what waits to be written vanish, so that Python's end does not fail of it again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _write_summary(path: Path, executive: "Executive", course: "CourseRecorder") -> None:
    """Write the counts, and a picture of the course beside them."""
    from spinfilters.io.output_files import write_json
    from spinfilters.plots.live_course import live_figure
    from spinfilters.plots.style import draw_figure

    write_json(path, executive.summary.document())
    picture = path.with_name(path.name.removesuffix(".json") + ".png")
    if draws_figures():
        draw_figure(lambda: live_figure(course.course()), picture)


def _live_options(options: LiveArguments, settings: "Settings") -> "LiveOptions":
    from spinfilters.live.live_options import LONG_RUN, LiveOptions
    from spinfilters.live.smoother_process import SupervisionOptions

    memory = 0 if options.smoother_memory is None else int(options.smoother_memory * MIB)
    return LiveOptions(
        deadline=options.deadline_ms / 1e3,
        ahead=options.predict,
        smoother=not options.no_smoother,
        supervision=SupervisionOptions(options.patience),
        sliding=settings.smoother.options(LONG_RUN),
        landmarks=settings.landmarks,
        memory=memory,
    )


def _answer_printer(
    stack: ExitStack, options: LiveArguments, executive: "Executive", writer: "AnswerWriter"
) -> "Callable[[Answer], None]":
    """Function that shows an answer: as a line, in a table, or both where they do not share one terminal."""
    if not options.view:
        return writer.write
    from spinfilters.live.terminal_view import TerminalView

    view = stack.enter_context(TerminalView(executive.summary))
    if sys.stdout.isatty():
        return view.show

    def show(answer: "Answer") -> None:
        """Write an answer and show it."""
        writer.write(answer)
        view.show(answer)

    return show


COMMAND = Command(
    "live",
    LiveArguments,
    live,
    "DATASET states sensors, noise and camera, and its first epochs initialise the filter. Without --input the later measurements "
    "of DATASET are replayed at their own pace. With it, lines `sensor,time_s,columns...` come from a pipe, a socket or a growing "
    "file. Answers go to standard output, counts to standard error at the end. With --json only the counts go to standard output.",
    common=FigureOptions,
)
