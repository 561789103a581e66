"""``spinfilters reconstruct``."""

import argparse
from pathlib import Path

from spinfilters.cli.console import progress_bars, wide_console
from spinfilters.pipeline.run_reconstruction import Reconstruction
from spinfilters.pipeline.run_reconstruction import reconstruct as reconstruct_run
from spinfilters.pipeline.run_report import write_run_report
from spinfilters.runs.run_folder import REPORT_FILE, read_figure_data, refuse_foreign_run
from spinfilters.runs.run_lock import locked_run
from spinfilters.runs.run_summary import read_summary


def reconstruct(options: argparse.Namespace) -> int:
    """Write the dense model of a run folder, and its report."""
    folder = Path(options.run)
    images = None if options.images is None else Path(options.images)
    read_summary(folder)
    refuse_foreign_run(folder)
    with locked_run(folder), progress_bars() as report:
        made = reconstruct_run(folder, images, options.voxels, report)
        write_run_report(read_figure_data(folder), folder)
    _print(made, folder)
    return 0


def _print(made: Reconstruction, folder: Path) -> None:
    dimensions = made.model.dimensions
    sizes = zip("xyz", 1e3 * dimensions.extents, 1e3 * dimensions.std, strict=True)
    extents = ", ".join(f"{axis} {size:.1f} +- {std:.1f} mm" for axis, size, std in sizes)
    lines = [
        *made.losses.sentences(),
        f"extents along the principal axes: {extents}",
        *dimensions.sentences,
        f"surface of {len(made.model.triangles)} triangles in {folder}   (look at {folder / REPORT_FILE})",
    ]
    for line in lines:
        wide_console().print(line, highlight=False, soft_wrap=True)
