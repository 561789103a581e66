"""``spinfilters compare --segment all``."""

from pathlib import Path

from spinfilters.cli.console import progress_bars, wide_console
from spinfilters.errors import InputError
from spinfilters.logs.dataset import Dataset
from spinfilters.workflow.run_folder import open_run_folder
from spinfilters.workflow.segments import run_segments, segment_medians, segment_table, write_segments
from spinfilters.workflow.settings import Settings


def compare_segments(datasets: list[Dataset], folder: Path, settings: Settings) -> int:
    """Run the estimators on every segment, write their folders and a picture of all, print the medians."""
    open_run_folder(folder)
    with progress_bars() as report:
        results = run_segments(
            datasets, folder, settings, lambda done, total: report("segments", done, total)
        )
    write_segments(folder, results, settings)
    console = wide_console()
    console.print(segment_table(results, settings))
    for name, (first, second, good, total) in segment_medians(results, settings).items():
        console.print(
            f"{name}: median J1/J3 {first:.4f}, J2/J3 {second:.4f} of {good} segments that are ok, of {total}",
            highlight=False,
        )
    if len(results) < len(datasets):
        raise InputError(
            f"interrupted after {len(results)} of {len(datasets)} segments; run the command again to go on from there"
        )
    console.print(
        f"run folder: {folder}   (look at {folder / f'throws-{settings.estimators[0]}.png'})", soft_wrap=True
    )
    return 0
