"""``spinfilters compare`` and ``estimate``.

What draws is imported where it draws: matplotlib would be a third of the time before the first epoch. So is what cuts a recording
into segments, looks for free flights, or simulates the example: most calls need none of it.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from spinfilters.cli.arguments import reading_options
from spinfilters.cli.console import progress_bars, wide_console
from spinfilters.data.dataset import Dataset
from spinfilters.data.dataset_reader import has_images, read_dataset
from spinfilters.data.input_file import value_text
from spinfilters.data.stated_values import ReadingOptions
from spinfilters.errors import InputError
from spinfilters.evaluation.comparison import comparison_table
from spinfilters.pipeline.comparison_run import RunOutput, compare_into
from spinfilters.pipeline.conditions import conditions_of
from spinfilters.pipeline.estimation import Comparison
from spinfilters.pipeline.estimator_entry import estimator_entries, listed_names
from spinfilters.runs.run_folder import REPORT_FILE
from spinfilters.settings.run_settings import Settings, read_settings
from spinfilters.state.status import verdict_sentences

_FLIGHTS_TOLD = 4

if TYPE_CHECKING:
    from spinfilters.pipeline.optional_outputs import OptionalOutputs
    from spinfilters.pipeline.segment_choice import SegmentChoice


def compare(options: argparse.Namespace) -> int:
    """Run the estimators, write the run folder and its figures, print the table."""
    settings = _settings(options)
    folder, optional_outputs = Path(options.output), _additions(options)
    choice = _segment_choice(options)
    if choice is not None and choice.several and options.dataset is not None:
        if optional_outputs is not None:
            optional_outputs.require_one_run()
        return _compare_segments(options, choice.several, folder, settings)
    dataset = _dataset(options, choice)
    with progress_bars() as report:
        written = compare_into(
            dataset, settings, RunOutput(folder, bool(options.resume), optional_outputs), report
        )
    if written.comparison is None:
        rest = f"made {', '.join(written.completed)}" if written.completed else "nothing is left to do"
        wide_console().print(f"run folder: {folder} is complete, {rest}", highlight=False, soft_wrap=True)
    else:
        _print_comparison(written.comparison, folder)
        _print_flights(written.comparison, options)
    _print_lacking(folder, optional_outputs)
    return 0


def _segment_choice(options: argparse.Namespace) -> "SegmentChoice | None":
    if options.segment is None:
        return None
    from spinfilters.pipeline.segment_choice import segment_choice

    return segment_choice(options.segment)


def _additions(options: argparse.Namespace) -> "OptionalOutputs | None":
    """Optional outputs that were asked for, or None."""
    if options.predict is None and not options.convergence and not options.explain:
        return None
    from spinfilters.pipeline.optional_outputs import OptionalOutputs

    return OptionalOutputs(options.predict, options.convergence, options.explain)


def _compare_segments(options: argparse.Namespace, which: str, folder: Path, settings: Settings) -> int:
    from spinfilters.cli.segments import compare_segments

    return compare_segments(options.dataset, which, folder, settings, reading_options(options))


def _print_comparison(comparison: Comparison, folder: Path) -> None:
    console = wide_console()
    conditions = conditions_of(comparison.setup).sentences
    console.print(comparison_table(comparison.evaluations, conditions))
    for sentence in verdict_sentences({each.name: each.history.status for each in comparison.evaluations}):
        console.print(sentence, highlight=False)
    if comparison.interrupted:
        raise InputError(
            f"interrupted; what was estimated is in {folder}, run the command again with --resume to go on from there"
        )
    console.print(f"run folder: {folder}   (look at {folder / REPORT_FILE})", highlight=False, soft_wrap=True)


def _print_flights(comparison: Comparison, options: argparse.Namespace) -> None:
    """Print a hint where only part of a recording is free flight.

    The hint comes only if the whole of it is not ok.
    """
    is_whole = options.dataset is not None and options.segment is None
    if not is_whole or all(each.history.status.verdict == "ok" for each in comparison.evaluations):
        return
    from spinfilters.flight.free_flight import flights_within

    flights = flights_within(comparison.setup.dataset)
    if flights:
        stretches = ", ".join(f"{flight.start:.3f}:{flight.end:.3f}" for flight in flights[:_FLIGHTS_TOLD])
        more = ", ..." if len(flights) > _FLIGHTS_TOLD else ""
        wide_console().print(
            f"only part of the recording is free flight ({stretches}{more} s): compare that with --segment auto",
            highlight=False,
            soft_wrap=True,
        )


def _print_lacking(folder: Path, optional_outputs: "OptionalOutputs | None") -> None:
    if optional_outputs is not None:
        for line in optional_outputs.sentences(folder):
            wide_console().print(line, highlight=False, soft_wrap=True)
    lacking = None if optional_outputs is None else optional_outputs.lacking(folder)
    if lacking is not None:
        wide_console().print(lacking, highlight=False, soft_wrap=True)


def _settings(options: argparse.Namespace) -> Settings:
    settings = read_settings(Path(options.config)) if options.config else Settings()
    if options.estimators is not None:
        settings = replace(settings, estimators=listed_names(options.estimators))
    elif options.known_map and not options.config:
        entries = estimator_entries().values()
        names = tuple(entry.name for entry in entries if entry.is_default or entry.is_baseline)
        settings = replace(settings, estimators=names)
    if options.drag:
        settings = replace(settings, process=replace(settings.process, drag=True))
    return settings


def _dataset(options: argparse.Namespace, choice: "SegmentChoice | None") -> Dataset:
    if options.dataset is None:
        reading_options(options).require_only((), "the bundled example")
        if options.segment is not None:
            raise InputError(
                f"--segment {value_text(options.segment)} needs a recording; give its folder as DATASET"
            )
        from spinfilters.simulation.scenario import Scenario, simulate, without_map

        example = simulate(Scenario.common_workload(seed=options.seed))
        return example if options.known_map else without_map(example)
    if options.known_map:
        raise InputError(
            "--known-map is for the bundled example; the known map of a data set is its landmarks.csv"
        )
    stated = reading_options(options)
    if choice is not None:
        from spinfilters.pipeline.segment_choice import read_chosen

        return read_chosen(options.dataset, choice, stated)
    return _recording(options.dataset, stated)


def _recording(path: str, stated: ReadingOptions) -> Dataset:
    """The data set of a path, or of the tracks of its stereo images, with losses."""
    if not has_images(path):
        return read_dataset(path, options=stated)
    from spinfilters.vision.track_images import track_images

    with progress_bars() as report:
        tracked = track_images(Path(path), progress=report)
    for line in tracked.losses.sentences():
        wide_console().print(line, highlight=False, soft_wrap=True)
    return tracked.dataset
