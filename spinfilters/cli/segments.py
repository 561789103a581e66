"""``spinfilters compare --segment all``."""

from pathlib import Path

from spinfilters.cli.console import progress_bars, wide_console
from spinfilters.data.dataset import read_segments
from spinfilters.errors import InputError
from spinfilters.pipeline.segments import (
    SegmentResult,
    run_segments,
    segment_medians,
    segment_table,
    throws_picture,
    write_segments,
)
from spinfilters.runs.run_folder import open_run_folder
from spinfilters.runs.run_lock import locked_run
from spinfilters.settings.run_settings import Settings


def compare_segments(recording: str, folder: Path, settings: Settings) -> int:
    """Run the estimators on every segment, write their folders and a picture of all, print the medians."""
    refused: list[SegmentResult] = []
    datasets = read_segments(recording, lambda number, why: refused.append(SegmentResult(number, None, why)))
    open_run_folder(folder)
    with locked_run(folder):
        with progress_bars() as report:
            results = run_segments(
                datasets, folder, settings, lambda done, total: report("segments", done, total)
            )
        interrupted = len(results) < len(datasets)
        results = sorted([*refused, *results], key=lambda result: result.number)
        write_segments(folder, results, settings)
    console = wide_console()
    console.print(segment_table(results, settings))
    for name, (first, second, good, total) in segment_medians(results, settings).items():
        console.print(
            f"{name}: median J1/J3 {first:.4f}, J2/J3 {second:.4f} of {good} segments that are ok, of {total}",
            highlight=False,
        )
    if interrupted:
        raise InputError(
            f"interrupted after {len(results)} of {len(datasets) + len(refused)} segments; run the command again to go on"
        )
    picture = folder / throws_picture(settings.estimators[0])
    look = f"   (look at {picture})" if picture.exists() else ""
    console.print(f"run folder: {folder}{look}", soft_wrap=True)
    return 0
