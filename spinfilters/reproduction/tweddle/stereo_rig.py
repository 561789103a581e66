"""Table 5.1 and its text: what the stereo rig of the Goggles can see and measure (section 5.3, Eqs 5.1, 5.2)."""

import math
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from spinfilters.io.camera import PinholeCamera, StereoRig
from spinfilters.plots.style import BLUE, GREEN, RED, tidy
from spinfilters.reproduction.item import ComparedNumber, ItemResult, tweddle_item
from spinfilters.vision.stereo_geometry import rig_accuracy

PIXEL, FOCAL, BASELINE, DISTANCE = 6e-6, 2.8e-3, 0.09, 0.5
"""Size of a pixel, focal length, baseline and distance of the object, m."""
COLUMNS, ROWS = {752: 4.51, 640: 3.84}, 480
"""Columns of the imager and of the used image, with the printed width of the sensor in mm."""


def make_rig_numbers() -> ItemResult:
    """Angles of view, nearest and farthest distance, and what an error of one pixel does."""
    horizontal, vertical = (_angle_of_view(count * PIXEL) for count in (640, ROWS))
    one_pixel = math.atan(PIXEL / FOCAL)
    rig = StereoRig(PinholeCamera(FOCAL / PIXEL, FOCAL / PIXEL, 319.5, 239.5, 640, 480), BASELINE)
    found = rig_accuracy(rig, DISTANCE, 1.0)
    by_column, by_row = 1e3 * np.asarray(found.by_column), 1e3 * np.asarray(found.by_row)
    rows = [
        *(
            ComparedNumber(
                f"width of the sensor, {n} pixels", 1e3 * n * PIXEL, printed=mm, unit="mm", tolerance=0.005
            )
            for n, mm in COLUMNS.items()
        ),
        ComparedNumber(
            "horizontal angle of view", math.degrees(horizontal), printed=68.9, unit="deg", tolerance=0.05
        ),
        ComparedNumber(
            "vertical angle of view",
            math.degrees(vertical),
            printed=54.4,
            unit="deg",
            tolerance=0.05,
        ),
        ComparedNumber(
            "nearest distance (Eq. 5.2)",
            100.0 * _distance(horizontal),
            printed=6.56,
            unit="cm",
            tolerance=0.005,
        ),
        ComparedNumber(
            "angle of one pixel", math.degrees(one_pixel), printed=0.123, unit="deg", tolerance=0.0005
        ),
        ComparedNumber(
            "farthest distance (Eq. 5.2)", _distance(one_pixel), printed=42.0, unit="m", tolerance=0.05
        ),
        *(
            ComparedNumber(
                f"1 px in a column moves the point along {axis}",
                abs(float(ours)),
                printed=printed,
                unit="mm",
                tolerance=0.05,
            )
            for axis, ours, printed in zip("xyz", by_column, (0.5, 0.0, 5.9), strict=True)
        ),
        *(
            ComparedNumber(
                f"1 px in the rows moves the point along {axis}",
                abs(float(ours)),
                printed=printed,
                unit="mm",
                tolerance=0.05,
            )
            for axis, ours, printed in zip("xyz", by_row, (0.0, 1.1, 0.0), strict=True)
        ),
    ]
    return ItemResult(rows, {"accuracy": _figure(rig)})


def _angle_of_view(size: float) -> float:
    """Eq. 5.1, rad."""
    return 2.0 * math.atan(size / (2.0 * FOCAL))


def _distance(angle: float) -> float:
    """Eq. 5.2, m."""
    return BASELINE / 2.0 / math.tan(angle / 2.0)


def _figure(rig: StereoRig) -> Figure:
    """Deviations of a point along the three axes over its distance, for a noise of one pixel."""
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    distances = np.geomspace(0.1, 5.0, 60)
    std = 1e3 * np.array([rig_accuracy(rig, float(each), 1.0).std for each in distances])
    for k, (name, colour) in enumerate(
        zip(("x, across", "y, down", "z, forward"), (BLUE, RED, GREEN), strict=True)
    ):
        axes.loglog(distances, std[:, k], color=colour, label=name)
    axes.axvline(DISTANCE, color="0.5", linewidth=0.8)
    axes.set(
        xlabel="distance [m]",
        ylabel="deviation for 1 px of noise [mm]",
        title="what the rig of Table 5.1 measures",
    )
    axes.legend(frameon=False)
    tidy(axes)
    return figure


STEREO_RIG: Final = tweddle_item(
    "Table 5.1",
    "with its text, section 5.3",
    "Angles of view, distances and accuracy of the stereo rig",
    make_rig_numbers,
)
