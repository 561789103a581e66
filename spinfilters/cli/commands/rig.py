"""The command ``rig``: how well a stereo rig can measure, before it is built."""

from dataclasses import dataclass
from typing import Annotated, Final

from spinfilters.cli.command import Command
from spinfilters.cli.common_options import PrintingOptions, print_document
from spinfilters.core.errors import InputError
from spinfilters.io.stated_values import Argument, NumberRange

SIZE: Final = NumberRange(2, 100_000, "px", whole=True)


@dataclass(frozen=True, kw_only=True)
class RigArguments:
    """Arguments of ``rig``; the defaults are the thesis' rig (Tweddle 2013, section 5.3)."""

    focal: Annotated[float, NumberRange(1, 1e6, "px"), Argument("focal length", metavar="PX")] = 466.7
    baseline: Annotated[float, NumberRange(1e-4, 1e3, "m"), Argument("between the cameras", metavar="M")] = (
        0.09
    )
    width: Annotated[int, SIZE, Argument("width of the images", metavar="PX")] = 640
    height: Annotated[int, SIZE, Argument("height of the images", metavar="PX")] = 480
    distance: Annotated[
        float, NumberRange(1e-3, 1e6, "m"), Argument("distance of the point", metavar="M")
    ] = 0.5
    pixel_std: Annotated[
        float, NumberRange(1e-3, 100, "px"), Argument("standard deviation of the noise", metavar="PX")
    ] = 1.0


def print_rig(options: RigArguments) -> int:
    """Print how well a rig measures at a distance."""
    from spinfilters.cli.console import wide_console
    from spinfilters.io.camera import PinholeCamera, StereoRig
    from spinfilters.vision.stereo_geometry import rig_accuracy

    focal, width, height = options.focal, options.width, options.height
    camera = PinholeCamera(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)
    found = rig_accuracy(StereoRig(camera, options.baseline), options.distance, options.pixel_std)
    if options.distance < found.nearest or options.distance >= found.farthest:
        raise InputError(
            f"--distance {options.distance:g} m is out of this rig's sight; "
            f"give one from {found.nearest:.4g} to {found.farthest:.4g} m"
        )
    by_column, by_row, std = (
        [f"{1e3 * value:.2f}" for value in each] for each in (found.by_column, found.by_row, found.std)
    )
    lines = [
        f"focal length {options.focal:g} px, baseline {options.baseline:g} m, images {options.width} x {options.height}",
        f"at {options.distance:g} m, half-way between the cameras:",
        f"  1 px in a column of the left image moves a point by [{', '.join(by_column)}] mm",
        f"  1 px in the rows moves it by [{', '.join(by_row)}] mm",
        f"  noise of {options.pixel_std:g} px gives standard deviations of [{', '.join(std)}] mm",
        f"nearest point in both images: {found.nearest:.4g} m; a disparity of 1 px: {found.farthest:.4g} m",
    ]
    for line in lines:
        wide_console().print(line, highlight=False, soft_wrap=True)
    print_document(
        {
            "by_column_m": found.by_column.tolist(),
            "by_row_m": found.by_row.tolist(),
            "std_m": found.std.tolist(),
            "nearest_m": found.nearest,
            "farthest_m": found.farthest,
        }
    )
    return 0


COMMAND = Command(
    "rig",
    RigArguments,
    print_rig,
    "Accuracy of triangulation half-way between the cameras' axes (Tweddle 2013, section 5.3); the defaults are the thesis' rig.",
    common=PrintingOptions,
)
