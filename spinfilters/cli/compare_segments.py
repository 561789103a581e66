"""``spinfilters compare --segment all`` or ``auto``: every segment of a recording, and what they say together."""

from collections.abc import Sequence
from pathlib import Path

from spinfilters.cli.console import progress_bars, wide_console
from spinfilters.core.errors import InputError
from spinfilters.io.output_files import made_folder
from spinfilters.io.stated_values import ReadingOptions
from spinfilters.run.run_folder import refuse_foreign_run
from spinfilters.run.run_lock import locked_run
from spinfilters.run.segment_choice import read_several
from spinfilters.run.segment_runs import (
    SegmentResult,
    pool,
    pool_accelerations,
    run_segments,
    segment_medians,
    segment_table,
    throws_picture,
    write_segments,
)
from spinfilters.settings.run_settings import Settings


def compare_segments(
    recording: str, which: str, folder: Path, settings: Settings, options: ReadingOptions
) -> int:
    """Run the estimators on every segment.

    Write their folders and a picture of all, print the medians.
    """
    refused: list[SegmentResult] = []
    datasets = read_several(
        recording, which, options, lambda number, why: refused.append(SegmentResult(number, None, why))
    )
    refuse_foreign_run(folder)
    with made_folder(folder), locked_run(folder):
        with progress_bars() as report:
            results = run_segments(
                datasets, folder, settings, lambda done, total: report("segments", done, total)
            )
        interrupted = len(results) < len(datasets)
        results = sorted([*refused, *results], key=lambda result: result.number)
        write_segments(folder, results, settings)
    _print_results(results, settings)
    if interrupted:
        raise InputError(
            f"interrupted after {len(results)} of {len(datasets) + len(refused)} segments; run the command again to go on"
        )
    picture = folder / throws_picture(settings.estimators[0])
    look = f"   (look at {picture})" if picture.exists() else ""
    wide_console().print(f"run folder: {folder}{look}", soft_wrap=True)
    return 0


def _print_results(results: Sequence[SegmentResult], settings: Settings) -> None:
    """Table of the segments, medians and pooled ratios."""
    console = wide_console()
    console.print(segment_table(results, settings))
    for name, (first, second, good, total) in segment_medians(results, settings).items():
        medians = f"median J1/J3 {first:.4f}, J2/J3 {second:.4f} of {good} segments that are ok, of {total}"
        console.print(f"{name}: {medians if good else f'none of {total} segments is ok'}", highlight=False)
    for pools in (pool(results, settings), pool_accelerations(results, settings)):
        for name, pooled in pools.items():
            if pooled is not None:
                console.print(f"{name}: {pooled.sentence}", highlight=False, soft_wrap=True)
