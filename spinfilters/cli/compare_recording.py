"""``spinfilters compare`` and ``estimate``.

Estimators, and what prints their results, are imported once there is a data set: a mistake in the arguments or the recording is
told in half the time. So is what only some calls need: segments, the bundled example, tracks of images.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from spinfilters.cli.command import reading_options
from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_reader import IMAGES, has_images
from spinfilters.io.input_file import value_text
from spinfilters.io.stated_values import ReadingOptions
from spinfilters.run.estimators import estimator_entries
from spinfilters.run.readers import read_dataset
from spinfilters.settings.run_settings import Settings, names_in, read_settings

if TYPE_CHECKING:
    from spinfilters.run.optional_outputs import OptionalOutputs
    from spinfilters.run.segment_choice import SegmentChoice


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
    from spinfilters.cli.comparison_output import compare_and_print  # a refused recording needs no estimators

    compare_and_print(dataset, settings, options, optional_outputs)
    return 0


def _segment_choice(options: argparse.Namespace) -> "SegmentChoice | None":
    if options.segment is None:
        return None
    from spinfilters.run.segment_choice import segment_choice

    return segment_choice(options.segment)


def _additions(options: argparse.Namespace) -> "OptionalOutputs | None":
    """Optional outputs that were asked for, or None."""
    if options.predict is None and not options.convergence and not options.explain:
        return None
    from spinfilters.run.optional_outputs import OptionalOutputs

    return OptionalOutputs(options.predict, options.convergence, options.explain)


def _compare_segments(options: argparse.Namespace, which: str, folder: Path, settings: Settings) -> int:
    from spinfilters.cli.compare_segments import compare_segments

    return compare_segments(options.dataset, which, folder, settings, reading_options(options))


def _settings(options: argparse.Namespace) -> Settings:
    settings = read_settings(Path(options.config)) if options.config else Settings()
    if options.estimators is not None:
        settings = replace(settings, estimators=names_in(options.estimators))
    elif options.known_map and not options.config:
        entries = estimator_entries().values()
        names = tuple(entry.name for entry in entries if entry.is_default or entry.is_baseline)
        settings = replace(settings, estimators=names)
    if options.drag or options.drag_law:
        law = options.drag_law or settings.process.drag or True  # a law of the config file stays
        settings = replace(settings, process=replace(settings.process, drag=law))
    if options.verdict is not None:
        settings = replace(settings, verdict=options.verdict)
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
        from spinfilters.run.segment_choice import read_chosen

        return read_chosen(options.dataset, choice, stated)
    return _recording(options.dataset, stated)


def _recording(path: str, stated: ReadingOptions) -> Dataset:
    """The data set of a path, or of the tracks of its stereo images, with losses."""
    if not has_images(path):
        return read_dataset(path, options=stated)
    stated.require_only((), IMAGES)
    from spinfilters.cli.console import progress_bars, wide_console
    from spinfilters.vision.track_images import track_images

    with progress_bars() as report:
        tracked = track_images(Path(path), progress=report)
    for line in tracked.losses.sentences():
        wide_console().print(line, highlight=False, soft_wrap=True)
    return tracked.dataset
