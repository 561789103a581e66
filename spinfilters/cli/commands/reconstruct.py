"""The command ``reconstruct``: a dense model of the body of a run made of stereo images."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from spinfilters.cli.command import Command
from spinfilters.cli.common_options import PrintingOptions, print_document
from spinfilters.io.stated_values import Argument, NumberRange

if TYPE_CHECKING:
    from spinfilters.run.reconstruction import Reconstruction


@dataclass(frozen=True, kw_only=True)
class ReconstructArguments:
    """Arguments of ``reconstruct``."""

    run: Annotated[
        str, Argument("folder made by compare or estimate from stereo images", positional=True, metavar="RUN")
    ]
    images: Annotated[
        str | None,
        Argument("folder of the stereo images, if they have moved", metavar="FOLDER"),
    ] = None
    voxels: Annotated[
        int, NumberRange(16, 256, whole=True), Argument("along each axis of the volume", metavar="N")
    ] = 128


def reconstruct(options: ReconstructArguments) -> int:
    """Write the dense model of a run folder, and its report."""
    from spinfilters.cli.console import progress_bars
    from spinfilters.run.reconstruction import reconstruct as reconstruct_run
    from spinfilters.run.run_folder import read_figure_data, refuse_foreign_run
    from spinfilters.run.run_lock import locked_run
    from spinfilters.run.run_report import write_run_report
    from spinfilters.run.run_summary import read_summary

    folder = Path(options.run)
    images = None if options.images is None else Path(options.images)
    read_summary(folder)
    refuse_foreign_run(folder)
    with locked_run(folder), progress_bars() as report:
        made = reconstruct_run(folder, images, options.voxels, report)
        write_run_report(read_figure_data(folder), folder)
    _print(made, folder)
    print_document(made.document)
    return 0


def _print(made: "Reconstruction", folder: Path) -> None:
    from spinfilters.cli.console import wide_console
    from spinfilters.run.run_folder import REPORT_FILE

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


COMMAND = Command(
    "reconstruct",
    ReconstructArguments,
    reconstruct,
    "Depth of every stereo pair, fused into one surface in principal axes by the motion that the run estimated. Writes "
    "RUN/reconstruction/model.ply, reconstruction.json (dimensions with standard deviations), reprojection.gif, and "
    "RUN/report.html with the model to turn.",
    common=PrintingOptions,
)
