"""The command ``lidar``: simulated scans of a body, and how many are needed."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from spinfilters.cli.command import Command, CommandGroup
from spinfilters.cli.common_options import FigureOptions, draw, print_document
from spinfilters.core.errors import InputError
from spinfilters.io.stated_values import Argument, ArgumentGroup, NumberRange
from spinfilters.simulation.scan_arguments import ScanArguments

if TYPE_CHECKING:
    from spinfilters.lidar.scan import Scan
    from spinfilters.simulation.lidar_sequence import ScannedScene


@dataclass(frozen=True, kw_only=True)
class ScanOutput:
    """What is written of a scan."""

    format: Annotated[tuple[Literal["ply", "pcd", "csv"], ...], Argument("file format of a single scan")] = (
        "ply",
    )
    misses: Annotated[bool, Argument("write rays without a return too, with their flag")] = False


@dataclass(frozen=True, kw_only=True)
class ScanCommandArguments(ScanArguments):
    """Arguments of ``lidar scan``."""

    output: Annotated[str, Argument("folder of the scan or data set", short="-o", metavar="FOLDER")]
    written: Annotated[ScanOutput, ArgumentGroup("output")] = field(default_factory=ScanOutput)


def scan(options: ScanCommandArguments) -> int:
    """Simulate one scan, or a sequence as a data set."""
    from spinfilters.cli.console import wide_console
    from spinfilters.io.output_files import refuse_foreign
    from spinfilters.simulation.lidar_sequence import ScannedScene

    folder, name = Path(options.output), f"{COMMAND.name} {SCAN.name}"
    refuse_foreign(folder, name)
    scene = ScannedScene.of(options)
    console = wide_console()
    for line in (scene.size_sentence, *(f"{scene.mesh.name}: {remark}" for remark in scene.mesh.remarks)):
        console.print(line, highlight=False, soft_wrap=True)
    write = _write_scan if options.body.scans is None else _write_sequence
    said = write(options, scene, folder, name)
    console.print(f"{said} in {folder}", highlight=False, soft_wrap=True)
    print_document({"folder": str(folder), "written": said, **scene.metadata, "seed": options.seed})
    return 0


def _write_scan(options: ScanCommandArguments, scene: "ScannedScene", folder: Path, name: str) -> str:
    """Write one scan of the body at rest; a sentence on it."""
    import numpy as np

    from spinfilters.io.output_files import output_folder
    from spinfilters.lidar.scan import write_scan
    from spinfilters.plots.measurement_figures import scan_figure

    found = scene.scanner.scan(scene.at_rest, 0.0, np.random.default_rng(options.seed))
    found = _with_metadata(found, options, scene)
    if not found.is_return.any():
        raise InputError(
            f"none of {len(found)} rays met {scene.mesh.name}; point the lidar at it, or give a wider --fov"
        )
    with output_folder(folder, name) as place:
        for ending in dict.fromkeys(options.written.format):
            write_scan(place / f"scan.{ending}", found, options.written.misses)
        draw(lambda: scan_figure(found, Path(scene.mesh.name).name), place / "scan.png")
    causes = [word for word in ("too weak", "saturated", "dust") if found.metadata[word]]
    lost = "".join(f", {found.metadata[word]} {word}" for word in causes)
    return f"{np.count_nonzero(found.is_return)} of {len(found)} rays returned{lost}"


def _write_sequence(options: ScanCommandArguments, scene: "ScannedScene", folder: Path, name: str) -> str:
    """Write a data set of scans of the tumbling body; a sentence on it."""
    import numpy as np

    from spinfilters.cli.console import progress_bars
    from spinfilters.io.output_files import output_folder
    from spinfilters.lidar.scan_streams import KIND, POINTS_KIND
    from spinfilters.plots.measurement_figures import scan_figure
    from spinfilters.simulation.lidar_sequence import scan_sequence, scan_times, truth_of, write_sequence

    body = options.body
    motion = scene.tumbling(body.rate_rpm, body.velocity)
    begin, epochs = scan_times(body.scans or 1, body.interval, options.beams.scan_seconds)
    with progress_bars() as report:
        scans = scan_sequence(
            scene.scanner, motion, begin, options.seed, lambda done, total: report("scans", done, total)
        )
    scans = [_with_metadata(each, options, scene) for each in scans]
    description = (
        f"{len(scans)} simulated scans of {scene.mesh.name} at {body.interval} s, seed {options.seed}"
    )
    counts = [int(np.count_nonzero(each.is_return)) for each in scans]
    with output_folder(folder, name) as place:
        kind = POINTS_KIND if body.points else KIND
        write_sequence(place, scans, truth_of(motion, epochs), description, kind)
        best = scans[counts.index(max(counts))]
        draw(lambda: scan_figure(best, Path(scene.mesh.name).name), place / "scan.png")
    return f"{len(scans)} scans of {min(counts)} to {max(counts)} points"


def _with_metadata(found: "Scan", options: ScanCommandArguments, scene: "ScannedScene") -> "Scan":
    return replace(found, metadata={**found.metadata, **scene.metadata, "seed": options.seed})


@dataclass(frozen=True, kw_only=True)
class NeededArguments:
    """Arguments of ``lidar needed``."""

    scans: Annotated[
        str,
        Argument("data set of scans, such as 'lidar scan --scans' writes", positional=True, metavar="FOLDER"),
    ]
    output: Annotated[str, Argument("folder of the picture", short="-o", metavar="FOLDER")]
    attitude_deg: Annotated[
        float, NumberRange(1e-9, 180.0, "deg"), Argument("standard deviation of the mean attitude")
    ] = 0.01


def needed(options: NeededArguments) -> int:
    """Print how many scans an attitude of a given accuracy takes, with a picture."""
    import numpy as np

    from spinfilters.cli.console import wide_console
    from spinfilters.io.output_files import output_folder, refuse_foreign
    from spinfilters.lidar.scan_pose import attitude_stds, scans_needed
    from spinfilters.lidar.scan_streams import registered_scans
    from spinfilters.plots.measurement_figures import scan_accuracy_figure

    folder, place, name = Path(options.scans), Path(options.output), f"{COMMAND.name} {NEEDED.name}"
    wanted = np.deg2rad(options.attitude_deg)
    refuse_foreign(place, name)
    found = registered_scans(folder)
    stds, count = attitude_stds(found.poses), scans_needed(found.poses, wanted)
    with output_folder(place, name) as written:
        draw(lambda: scan_accuracy_figure(stds, wanted, count, folder.name), written / "scans_needed.png")
    console = wide_console()
    for remark in dict.fromkeys((*found.doubts, *found.remarks)):
        console.print(f"{folder}: {remark}", highlight=False, soft_wrap=True)
    console.print(
        f"{count} scans like these for an attitude of {options.attitude_deg:g} deg (1 sigma); these {len(stds)} "
        f"together: {np.rad2deg(stds[-1]):.2g} deg; picture in {place}",
        highlight=False,
        soft_wrap=True,
    )
    print_document(
        {
            "scans_needed": count,
            "attitude_std_deg": options.attitude_deg,
            "scans": len(stds),
            "attitude_std_of_all_deg": float(np.rad2deg(stds[-1])),
        }
    )
    return 0


SCAN = Command(
    "scan",
    ScanCommandArguments,
    scan,
    "Writes scan.ply, scan.png and metadata; with --scans a data set of scans of the tumbling body, with truth, for "
    "'spinfilters compare'. Frame of the lidar: x along its axis, y towards elevation, z towards azimuth.",
    help="scan a mesh with a simulated lidar",
    common=FigureOptions,
)
NEEDED = Command(
    "needed",
    NeededArguments,
    needed,
    "Registers the scans of a data set of kind lidar-scans and estimates how many like them a mean attitude of the accuracy takes; "
    "writes scans_needed.png.",
    help="how many scans an attitude of a given accuracy takes",
    common=FigureOptions,
)
COMMAND = CommandGroup("lidar", (SCAN, NEEDED))
