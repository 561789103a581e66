"""``spinfilters lidar needed``."""

import argparse
from pathlib import Path
from typing import Final

import numpy as np

from spinfilters.cli.console import wide_console
from spinfilters.data.output_folder import output_folder, refuse_foreign
from spinfilters.lidar.scan_accuracy import attitude_stds, scans_needed
from spinfilters.lidar.scan_streams import registered_scans
from spinfilters.plots.lidar_scan import scan_accuracy_figure
from spinfilters.plots.style import save_figure

NEEDED: Final = "lidar needed"


def needed(options: argparse.Namespace) -> int:
    """Print how many scans an attitude of a given accuracy takes, with a picture."""
    folder, place, asked = Path(options.scans), Path(options.output), np.deg2rad(options.attitude_deg)
    refuse_foreign(place, NEEDED)
    found = registered_scans(folder)
    stds, count = attitude_stds(found.poses), scans_needed(found.poses, asked)
    with output_folder(place, NEEDED) as written:
        save_figure(scan_accuracy_figure(stds, asked, count, folder.name), written / "scans_needed.png")
    console = wide_console()
    for remark in dict.fromkeys((*found.doubts, *found.remarks)):
        console.print(f"{folder}: {remark}", highlight=False, soft_wrap=True)
    console.print(
        f"{count} scans like these for an attitude of {options.attitude_deg:g} deg (1 sigma); these {len(stds)} "
        f"together: {np.rad2deg(stds[-1]):.2g} deg; picture in {place}",
        highlight=False,
        soft_wrap=True,
    )
    return 0
