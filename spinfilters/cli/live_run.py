"""``spinfilters live``."""

import argparse
import os
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from spinfilters.cli.interrupts import require_uninterrupted, until_interrupted
from spinfilters.io.output_files import write_json
from spinfilters.live.answer import Answer, AnswerWriter, CourseRecorder
from spinfilters.live.executive import Executive
from spinfilters.live.live_options import LONG_RUN, LiveOptions, live_setup
from spinfilters.live.smoother_process import SupervisionOptions
from spinfilters.live.sources import Replay, Source, open_lines
from spinfilters.live.terminal_view import TerminalView
from spinfilters.plots.live_course import live_figure
from spinfilters.plots.style import draw_figure
from spinfilters.run.readers import read_dataset
from spinfilters.settings.run_settings import Settings, read_settings

MIB = 1 << 20


def live(options: argparse.Namespace) -> int:
    """Estimate every epoch until measurements end; exit code 1 after missed deadlines, else 0."""
    settings = read_settings(Path(options.config)) if options.config else Settings()
    dataset = read_dataset(options.dataset, None)
    lines = None if options.input is None else open_lines(options.input, dataset.log.sensors)
    setup = live_setup(dataset, settings, options.filter)
    require_uninterrupted()
    executive = Executive(setup, _options(options, settings))
    source: Source = lines or Replay(dataset.log, setup.time, options.speed)
    if options.summary:  # a place that cannot be written is said now, not when the run is over
        write_json(Path(options.summary), executive.summary.document())
    course = CourseRecorder(executive.summary.deadline)
    writer = AnswerWriter(options.format, sys.stdout)
    try:
        with ExitStack() as stack:
            stack.callback(writer.close)
            show = _shown(stack, options, executive, writer)
            for answer in executive.run(until_interrupted(source.epochs())):
                show(answer)
                course.keep(answer)
    except KeyboardInterrupt:
        pass
    except BrokenPipeError:  # nobody reads the answers any more
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    executive.summary.events.update(source.losses)
    if writer.dropped:
        executive.summary.events["answer not read"] += writer.dropped
    print(executive.summary.text(), file=sys.stderr)
    if options.summary:
        _write_summary(Path(options.summary), executive, course)
    return 1 if executive.summary.missed else 0


def _write_summary(path: Path, executive: Executive, course: CourseRecorder) -> None:
    """Counts, and a picture of the course beside them."""
    write_json(path, executive.summary.document())
    picture = path.with_name(path.name.removesuffix(".json") + ".png")
    draw_figure(lambda: live_figure(course.course()), picture)


def _options(options: argparse.Namespace, settings: Settings) -> LiveOptions:
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


def _shown(
    stack: ExitStack, options: argparse.Namespace, executive: Executive, writer: AnswerWriter
) -> Callable[[Answer], None]:
    """Function that shows an answer.

    A table and lines would spoil each other in one terminal.
    """
    if not options.view:
        return writer.write
    view = stack.enter_context(TerminalView(executive.summary))
    if sys.stdout.isatty():
        return view.show

    def show(answer: Answer) -> None:
        """Write an answer and show it."""
        writer.write(answer)
        view.show(answer)

    return show
