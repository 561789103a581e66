"""The command ``depth``: disparity, and depth where the rig is known, of any one rectified or raw stereo pair."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from spinfilters.cli.command import Command
from spinfilters.cli.common_options import FigureOptions, draw, print_document
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text
from spinfilters.io.stated_values import Argument, NumberRange


@dataclass(frozen=True, kw_only=True)
class DepthArguments:
    """Arguments of ``depth``."""

    left: Annotated[str, Argument("left image", positional=True, metavar="LEFT")]
    right: Annotated[str, Argument("right image", positional=True, metavar="RIGHT")]
    rig: Annotated[
        str | None,
        Argument("folder of the calibration; without it the pair is taken as rectified", metavar="FOLDER"),
    ] = None
    largest: Annotated[
        int,
        NumberRange(16, 4096, "px", whole=True),
        Argument("largest disparity of a match", metavar="PX"),
    ] = 128
    output: Annotated[str, Argument("arrays and picture", short="-o", metavar="OUT")]


def depth(options: DepthArguments) -> int:
    """Write disparities by local and by global matching, depth where there is a rig, and a picture."""
    import numpy as np

    from spinfilters.cli.console import wide_console
    from spinfilters.io.output_files import output_folder, refuse_foreign
    from spinfilters.plots.measurement_figures import disparities_figure
    from spinfilters.run.array_files import write_arrays
    from spinfilters.vision.depth_map import disparity_map, local_disparity_map, textured_pixels
    from spinfilters.vision.image_folder import read_image
    from spinfilters.vision.rectification import Rectification, read_raw_rig

    folder, paths = Path(options.output), (Path(options.left), Path(options.right))
    images = []
    for path in paths:
        image, cause = read_image(path)
        if image is None:
            raise InputError(f"{path_text(path)}: {cause or 'not an image'}; give an image")
        images.append(image)
    left, right = images
    if left.shape != right.shape or options.largest >= left.shape[1]:
        raise InputError(
            f"{path_text(paths[1])}: is {right.shape[1]} x {right.shape[0]} px, the other {left.shape[1]} x {left.shape[0]} px, "
            f"disparities up to {options.largest} px; give two images of one size, wider than that"
        )
    refuse_foreign(folder, COMMAND.name)
    scale = None
    if options.rig is not None:
        rectification = Rectification(read_raw_rig(Path(options.rig)))
        if rectification.rig.size != left.shape[::-1]:
            raise InputError(
                f"{path_text(paths[0])}: is not of the size of the calibration; give the cameras' own images"
            )
        left, right = rectification.images(left, right)
        scale = rectification.stereo.left.fx * rectification.stereo.baseline_m
    textured = textured_pixels(left)
    maps = {
        name: np.where(textured, match(left, right, options.largest), np.nan)
        for name, match in (("local", local_disparity_map), ("global", disparity_map))
    }
    with output_folder(folder, COMMAND.name) as place:
        arrays = {f"disparity_{name}_px": values for name, values in maps.items()}
        titles = {f"disparity, {name} matching": values for name, values in maps.items()}
        unit = "px"
        if scale is not None:
            with np.errstate(divide="ignore", invalid="ignore"):
                depths = {name: np.where(values > 0, scale / values, np.nan) for name, values in maps.items()}
            arrays |= {f"depth_{name}_m": values for name, values in depths.items()}
            titles, unit = {f"depth, {name} matching": values for name, values in depths.items()}, "m"
        write_arrays(place / "depth.npz", arrays)
        draw(lambda: disparities_figure(left, titles, unit), place / "depth.png")
    filled = {name: float(np.isfinite(values).mean()) for name, values in maps.items()}
    lines = [f"{name} matching fills {100 * share:.1f} % of the image" for name, share in filled.items()]
    wide_console().print("\n".join([*lines, f"written to {folder}"]), highlight=False, soft_wrap=True)
    print_document({"folder": str(folder), "filled": filled})
    return 0


COMMAND = Command(
    "depth",
    DepthArguments,
    depth,
    "Local matching compares blocks (OpenCV's sums of absolute differences). Global matching makes neighbours agree (semi-global "
    "matching, Hirschmueller 2008). Section 2.10 of Tweddle (2013) compares both. Pixels without texture are left out. "
    "depth.npz has a disparity map of each; with --rig also the depth in metres.",
    common=FigureOptions,
)
