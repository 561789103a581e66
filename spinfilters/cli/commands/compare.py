"""The command ``compare``: estimators on a recording or on each of its segments, written and printed.

What estimates, and what prints its results, is imported once there is a data set: a mistake in the arguments or the recording is
refused in half the time.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

from spinfilters.api.arguments import RunArguments
from spinfilters.cli.command import Command
from spinfilters.cli.common_options import PrintingOptions, print_document, print_json_file, prints_text
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import value_text
from spinfilters.io.stated_values import Argument, ArgumentGroup, ReadingOptions
from spinfilters.settings.settings_arguments import SettingsArguments
from spinfilters.simulation.scenario_record import SEED

if TYPE_CHECKING:
    from spinfilters.io.dataset import Dataset
    from spinfilters.run.estimation import Comparison, Progress
    from spinfilters.run.segment_choice import SegmentChoice
    from spinfilters.run.segment_runs import SegmentResult
    from spinfilters.settings.run_settings import Settings

NAMES: Final = (
    "mekf, ukf, smoother, smoother-latest, iekf, rts, invariant, ekf-joint, smoother-lag-1, smoother-lag-2, smoother-lag-5, "
    "smoother-lag-10, smoother-lag-20, smoother-lag-50, filterpy-ekf, filterpy-ukf, embedded, embedded-double, posterior"
)
"""Names for the help, which loads no estimator; a test compares them with the table."""
RECORDING: Final = "a recording: data set folder, stereo images, log of a phone or robot, table with named columns, ROS bag, TUM"
_FLIGHTS_PRINTED: Final = 4


@dataclass(frozen=True, kw_only=True)
class ComparisonArguments(RunArguments):
    """What ``compare`` and ``estimate`` have in common."""

    output: Annotated[str, Argument("run folder", short="-o", metavar="RUN")] = "runs/latest"
    segment: Annotated[
        str | None,
        Argument(
            "one segment by number or times in s; all: every marked one; auto: every free flight found",
            metavar="N|START:END|all|auto",
        ),
    ] = None
    drag: Annotated[bool, Argument("estimate an aerodynamic drag coefficient too")] = False
    drag_law: Annotated[
        Literal["quadratic", "linear", "auto"] | None,
        Argument("law of --drag: quadratic in the rate (default), linear, or auto: the likelier, if any"),
    ] = None
    stated: Annotated[SettingsArguments, ArgumentGroup()] = field(default_factory=SettingsArguments)
    reading: Annotated[ReadingOptions, ArgumentGroup("what the recording does not state")] = field(
        default_factory=ReadingOptions
    )


@dataclass(frozen=True, kw_only=True)
class CompareArguments:
    """Arguments of ``compare``."""

    dataset: Annotated[str | None, Argument(RECORDING, positional=True, metavar="DATASET")] = None
    estimators: Annotated[
        str | None,
        Argument(
            f"{NAMES} (default: mekf,ukf,smoother; filterpy's too with --known-map)",
            metavar="A,B",
        ),
    ] = None
    seed: Annotated[int, SEED, Argument("seed of the bundled example")] = 0
    known_map: Annotated[bool, Argument("give the estimators the map of the bundled example")] = False
    how: Annotated[ComparisonArguments, ArgumentGroup()] = field(default_factory=ComparisonArguments)


def compare(options: CompareArguments) -> int:
    """Run the estimators, write the run folder and its figures, print the table."""
    settings = settings_of(options)
    optional_outputs = options.how.optional_outputs
    choice = _segment_choice(options.how.segment)
    if choice is not None and choice.several and options.dataset is not None:
        if optional_outputs is not None:
            optional_outputs.require_one_run()
        return _compare_segments(options.dataset, choice.several, settings, options.how)
    dataset = _read_with_bar(options, choice)
    from spinfilters.cli.console import progress_bars, wide_console  # a refused recording needs no estimators
    from spinfilters.run.comparison_run import RunOutput, compare_into

    folder = Path(options.how.output)
    with progress_bars() as report:
        output = RunOutput(folder, options.how.resume, optional_outputs, not options.how.no_figures)
        written = compare_into(dataset, settings, output, report)
    if not prints_text():
        return _without_table(written.comparison, folder)
    if written.comparison is None:
        rest = f"made {', '.join(written.completed)}" if written.completed else "nothing is left to do"
        wide_console().print(f"run folder: {folder} is complete, {rest}", highlight=False, soft_wrap=True)
    else:
        _print_comparison(written.comparison, folder)
        if options.dataset is not None and choice is None:
            _print_flights(written.comparison)
    optional_outputs = written.optional_outputs
    if optional_outputs is not None:
        for line in (*optional_outputs.sentences(folder), optional_outputs.lacking(folder)):
            if line is not None:
                wide_console().print(line, highlight=False, soft_wrap=True)
    return 0


def _read_with_bar(options: CompareArguments, choice: "SegmentChoice | None") -> "Dataset":
    """The data set, with a bar from the first second on where somebody watches."""
    if not sys.stderr.isatty():  # a refused recording needs no bars
        return _dataset(options, choice, lambda *_: None)
    from spinfilters.cli.console import progress_bars

    with progress_bars() as report:
        report("simulating" if options.dataset is None else "reading", 0, 1)
        return _dataset(options, choice, report)


def _without_table(comparison: "Comparison | None", folder: Path) -> int:
    """Print the summary as JSON, or nothing. InputError: the run was interrupted."""
    if comparison is not None and comparison.interrupted:
        raise InputError(f"interrupted; the finished part is in {folder}, --resume continues from it")
    from spinfilters.run.run_summary import SUMMARY_FILE

    print_json_file(folder / SUMMARY_FILE)
    return 0


def settings_of(options: CompareArguments) -> "Settings":
    """Settings of a comparison: those of its config file, changed by its options.

    Raises
    ------
    InputError
        A config file that cannot be used, an unknown estimator.
    """
    from spinfilters.run.estimators import estimator_entries
    from spinfilters.settings.run_settings import (
        DEFAULT_ESTIMATORS,
        names_in,
    )

    how = options.how
    settings = how.stated.of_file()
    if options.estimators is not None:
        settings = replace(settings, estimators=names_in(options.estimators))
    elif options.known_map and how.stated.file is None:
        entries = estimator_entries().values()
        baselines = (entry.name for entry in entries if entry.is_baseline and not entry.holds_landmarks)
        settings = replace(settings, estimators=(*DEFAULT_ESTIMATORS, *baselines))
    if how.drag or how.drag_law:
        law = how.drag_law or settings.process.drag or True  # a law of the config file stays
        settings = replace(settings, process=replace(settings.process, drag=law))
    if how.verdict is not None:
        settings = replace(settings, verdict=how.verdict)
    if how.from_truth is not None:
        drawn = replace(settings.initialisation, from_truth=True, draw=how.from_truth, mean={})
        settings = replace(settings, initialisation=drawn)
    return how.stated.changed(settings)


def _segment_choice(text: str | None) -> "SegmentChoice | None":
    if text is None:
        return None
    from spinfilters.run.segment_choice import segment_choice

    return segment_choice(text)


def _dataset(options: CompareArguments, choice: "SegmentChoice | None", report: "Progress") -> "Dataset":
    """The recording, a segment of it, or the bundled example."""
    stated = options.how.reading
    if options.dataset is None:
        stated.require_only((), "the bundled example")
        if choice is not None:
            raise InputError(
                f"--segment {value_text(options.how.segment)} needs a recording; give its folder as DATASET"
            )
        from spinfilters.simulation.scenario import Scenario, simulate, without_map

        example = simulate(Scenario(seed=options.seed))
        return example if options.known_map else without_map(example)
    if options.known_map:
        raise InputError(
            "--known-map is for the bundled example; the known map of a data set is its landmarks.csv"
        )
    if choice is not None:
        from spinfilters.run.segment_choice import read_chosen

        return read_chosen(options.dataset, choice, stated)
    return _recording(options.dataset, stated, report)


def _recording(path: str, stated: ReadingOptions, report: "Progress") -> "Dataset":
    """The data set of a path, or of the tracks of its stereo images, with losses."""
    from spinfilters.io.dataset_reader import IMAGES, has_images
    from spinfilters.run.readers import read_dataset

    path, stated = _unpacked(path, stated)
    if not has_images(path):
        return read_dataset(path, options=stated)
    stated.require_only((), IMAGES)
    from spinfilters.cli.console import wide_console
    from spinfilters.vision.track_images import track_images

    tracked = track_images(Path(path), progress=report)
    for line in tracked.losses.sentences():
        wide_console().print(line, highlight=False, soft_wrap=True)
    return tracked.dataset


def _unpacked(path: str, stated: ReadingOptions) -> tuple[str, ReadingOptions]:
    """The folder of a bag's images or clouds, with a line that says where it is; any other path as it is."""
    from spinfilters.run.bag_recording import unpacked_recording

    found, options = unpacked_recording(path, stated)
    if found == path:
        return path, stated
    from spinfilters.cli.console import wide_console

    wide_console().print(f"unpacked into {found}", highlight=False, soft_wrap=True)
    return str(found), options


def _print_comparison(comparison: "Comparison", folder: Path) -> None:
    from spinfilters.cli.console import wide_console
    from spinfilters.evaluation.comparison_table import comparison_table
    from spinfilters.evaluation.spin_regime import spin_verdict
    from spinfilters.models.status import verdict_sentences
    from spinfilters.run.run_folder import REPORT_FILE

    console = wide_console()
    console.print(comparison_table(comparison.evaluations, comparison.conditions.sentences))
    for sentence in verdict_sentences({each.name: each.history.status for each in comparison.evaluations}):
        console.print(sentence, highlight=False)
    spin = next(filter(None, map(spin_verdict, reversed(comparison.evaluations))), None)
    if spin is not None:
        console.print(f"Rate: {spin.sentence}.", highlight=False)
    if comparison.interrupted:
        raise InputError(
            f"interrupted; what was estimated is in {folder}, run the command again with --resume to continue"
        )
    look = f"   (look at {folder / REPORT_FILE})" if (folder / REPORT_FILE).exists() else ""
    console.print(f"run folder: {folder}{look}", highlight=False, soft_wrap=True)


def _print_flights(comparison: "Comparison") -> None:
    """Print a hint where only part of a recording is free flight and not every estimator is ok."""
    if all(each.history.status.verdict == "ok" for each in comparison.evaluations):
        return
    from spinfilters.cli.console import wide_console
    from spinfilters.run.free_flight import flights_within

    flights = flights_within(comparison.setup.dataset)
    if flights:
        printed = flights[:_FLIGHTS_PRINTED]
        stretches = ", ".join(f"{flight.start:.3f}:{flight.end:.3f}" for flight in printed)
        more = ", ..." if len(flights) > len(printed) else ""
        wide_console().print(
            f"only part of the recording is free flight ({stretches}{more} s): compare that with --segment auto",
            highlight=False,
            soft_wrap=True,
        )


def _compare_segments(recording: str, which: str, settings: "Settings", options: ComparisonArguments) -> int:
    """Run the estimators on every segment; write their folders and a picture of all, print the medians."""
    from spinfilters.cli.console import progress_bars, wide_console
    from spinfilters.io.output_files import made_folder
    from spinfilters.run.run_folder import refuse_foreign_run
    from spinfilters.run.run_lock import locked_run
    from spinfilters.run.segment_choice import read_several
    from spinfilters.run.segment_runs import SegmentResult, run_segments, throws_picture, write_segments

    folder, refused = Path(options.output), list[SegmentResult]()
    datasets = read_several(
        recording,
        which,
        options.reading,
        lambda number, why: refused.append(SegmentResult(number, None, why)),
    )
    refuse_foreign_run(folder)
    with made_folder(folder), locked_run(folder):
        with progress_bars() as report:
            results = run_segments(
                datasets, folder, settings, lambda done, total: report("segments", done, total)
            )
        interrupted = len(results) < len(datasets)
        results = sorted([*refused, *results], key=lambda result: result.number)
        document = write_segments(folder, results, settings, not options.no_figures)
    _print_segments(results, settings)
    print_document(document)
    if interrupted:
        raise InputError(
            f"interrupted after {len(results)} of {len(datasets) + len(refused)} segments; run the command again to continue"
        )
    picture = folder / throws_picture(settings.estimators[0])
    look = f"   (look at {picture})" if picture.exists() else ""
    wide_console().print(f"run folder: {folder}{look}", soft_wrap=True)
    return 0


def _print_segments(results: "Sequence[SegmentResult]", settings: "Settings") -> None:
    """Print the table of the segments, medians and pooled ratios."""
    from spinfilters.cli.console import wide_console
    from spinfilters.run.segment_runs import pool, pool_accelerations, segment_medians, segment_table

    console = wide_console()
    console.print(segment_table(results, settings))
    for name, (first, second, good, total) in segment_medians(results, settings).items():
        medians = f"median J1/J3 {first:.4f}, J2/J3 {second:.4f} of {good} segments that are ok, of {total}"
        console.print(f"{name}: {medians if good else f'none of {total} segments is ok'}", highlight=False)
    for pools in (pool(results, settings), pool_accelerations(results, settings)):
        for name, pooled in pools.items():
            if pooled is not None:
                console.print(f"{name}: {pooled.sentence}", highlight=False, soft_wrap=True)


COMMAND = Command(
    "compare",
    CompareArguments,
    compare,
    "Without DATASET the bundled example is simulated, the thesis' own problem. A stereo camera with 1 px of noise tracks unknown "
    "landmarks on a SPHERES-like body that rotates at 10 rpm about its intermediate axis. There are 115 epochs at 0.5 s. "
    "Disturbances are 0.001 (m/s^2)/sqrt(Hz) and 0.001 (rad/s^2)/sqrt(Hz).",
    common=PrintingOptions,
)
