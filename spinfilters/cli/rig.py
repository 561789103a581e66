"""``spinfilters rig``."""

import argparse

from spinfilters.cli.console import wide_console
from spinfilters.data.camera import PinholeCamera, StereoRig
from spinfilters.errors import InputError
from spinfilters.vision.rig_accuracy import rig_accuracy


def rig(options: argparse.Namespace) -> int:
    """Print how well a rig measures at a distance."""
    focal, width, height = options.focal, options.width, options.height
    camera = PinholeCamera(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)
    pair = StereoRig(camera, options.baseline)
    found = rig_accuracy(pair, options.distance, options.pixel_std)
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
    return 0
