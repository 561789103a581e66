"""Figures 2-13, 2-16 and 2-17, Table 5.1: what a stereo rig makes of its pictures, and what that of the Goggles can see.

Undistortion, matches of a stereo sequence and a depth map are of sections 2.8 to 2.10, what the rig can measure of section 5.3 (Eqs
5.1, 5.2). The photographs are of the space station. The same steps run on rendered pairs, whose truth is known: a board of straight
lines before a distorting rig, and a turning body with texture.
"""

import math
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from spinfilters.io.camera import PinholeCamera, StereoRig
from spinfilters.plots.measurement_figures import disparities_figure, matches_figure
from spinfilters.plots.style import BLUE, GREEN, RED, tidy
from spinfilters.reproduction.item import ComparedNumber, Item, ItemResult, tweddle_item
from spinfilters.reproduction.tweddle.camera_checkout import BOARD, rigs
from spinfilters.simulation.board_images import board_images, projected
from spinfilters.simulation.image_sequence import ImageScenario, Imaging, render
from spinfilters.simulation.scenario import Scenario
from spinfilters.vision.depth_map import disparity_map, local_disparity_map, textured_pixels
from spinfilters.vision.rectification import Rectification
from spinfilters.vision.stereo_geometry import rig_accuracy
from spinfilters.vision.track_images import track_images
from spinfilters.vision.tracked_pairs import TrackedPair, tracked_pairs

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


RENDERED: Final = "The photographs are not printed as data: rendered pairs with known truth take their place."
SMOOTH: Final = 2.0
"""Grey levels between neighbours, about twice the noise, below which blocks have nothing to match."""
LARGEST: Final = 128
"""Disparity up to which matches are looked for, px."""


@cache
def followed() -> list[TrackedPair]:
    """Two successive pairs, 0.5 s apart, of a rendered turning body, with their tracks."""
    scenario = ImageScenario(
        Scenario(radius_m=0.11, epochs=5, interval=0.5, rate_rpm=(0.5, 4.0, 0.5)),
        imaging=Imaging(oversampling=1, stars=0),
    )
    with TemporaryDirectory() as place:
        render(scenario, Path(place))
        (stream,) = track_images(Path(place)).dataset.log.streams
        return list(tracked_pairs(Path(place), stream))


def make_undistortion() -> ItemResult:
    """Figure 2-13: a pair before and after undistortion and rectification."""
    rig, _ = rigs()
    pose = np.eye(3), np.array([-0.055, -0.05, 0.36])
    left, right = projected(rig, BOARD.points, pose)
    generator = np.random.default_rng(13)
    raw = [images[0] for images in board_images([pose], rig, BOARD, generator)]
    rectification = Rectification(rig)
    straight, moved = rectification.points(left, right)
    after = rectification.images(raw[0], raw[1])
    rows = [
        ComparedNumber(
            "before: largest bend of a line of the board", _bend(left), expected=(1.0, np.inf), unit="px"
        ),
        ComparedNumber(
            "after: largest bend of a line of the board", _bend(straight), expected=(0.0, 0.05), unit="px"
        ),
        ComparedNumber(
            "before: rows of the same point differ by up to",
            float(np.abs(left[:, 1] - right[:, 1]).max()),
            expected=(1.0, np.inf),
            unit="px",
        ),
        ComparedNumber(
            "after: rows of the same point differ by up to",
            float(np.abs(straight[:, 1] - moved[:, 1]).max()),
            expected=(0.0, 0.05),
            unit="px",
        ),
    ]
    figure = Figure(figsize=(10.0, 8.2), layout="constrained")
    for axes, images, (a, b), title in zip(
        figure.subplots(2, 1),
        (raw, after),
        ((left, right), (straight, moved)),
        ("before undistortion", "after undistortion and rectification"),
        strict=True,
    ):
        width = images[0].shape[1]
        axes.imshow(np.hstack(images), cmap="gray", vmin=0, vmax=255)
        for points, shift in ((a, 0), (b, width)):
            ends = points[[0, BOARD.columns - 1]] + [shift, 0]
            axes.plot(*ends.T, color=RED, linewidth=1.0)
        axes.plot([a[0, 0], b[0, 0] + width], [a[0, 1], b[0, 1]], color=GREEN, linewidth=1.0)
        axes.set_title(f"{title}: a straight line (red), one point in both images (green)", loc="left")
        axes.set_axis_off()
    return ItemResult(rows, {"undistortion": figure}, note=RENDERED)


def _bend(points: np.ndarray) -> float:
    """Largest distance of the board's upper corners from the line through the outer two, px."""
    line = points[: BOARD.columns]
    along = (line[-1] - line[0]) / np.linalg.norm(line[-1] - line[0])
    off = line - line[0]
    return float(np.abs(off[:, 0] * along[1] - off[:, 1] * along[0]).max())


def make_matches() -> ItemResult:
    """Figure 2-16: stereo matches are horizontal, features move together."""
    pairs = followed()
    last = pairs[-1]
    moves = last.before[:, :2] - last.before[:, 2:]
    rows = [
        ComparedNumber("stereo matches of a pair", float(len(last.values)), expected=(30.0, np.inf)),
        ComparedNumber(
            "features followed from the pair before", float(len(last.before)), expected=(15.0, np.inf)
        ),
        ComparedNumber(
            "median move of a feature in 0.5 s",
            float(np.median(np.linalg.norm(moves, axis=1))),
            expected=(1.0, 200.0),
            unit="px",
        ),
    ]
    note = f"{RENDERED} SIFT takes the place of SURF. `spinfilters track --figures` draws any sequence."
    return ItemResult(rows, {"matches": matches_figure(pairs)}, note=note)


def make_depth() -> ItemResult:
    """Figure 2-17: image and depth map, by local and by global matching."""
    pair = followed()[-1]
    body = textured_pixels(pair.left)
    maps = {
        name: np.where(body, match(pair.left, pair.right, LARGEST), np.nan)
        for name, match in (("global", disparity_map), ("local", local_disparity_map))
    }
    at = np.rint(pair.values[:, :2]).astype(int)
    sparse = pair.values[:, 0] - pair.values[:, 2]
    slopes = np.hypot(*np.gradient(pair.left.astype(float)))
    smooth = float(np.mean(slopes[body] < SMOOTH))
    rows = []
    for name, found in maps.items():
        rows.append(
            ComparedNumber(
                f"{name} matching: share of the body that is filled",
                float(np.isfinite(found[body]).mean()),
                expected=(0.5, 1.0),
                why=f"{smooth:.0%} of the body's pixels differ from their neighbours by less than {SMOOTH:g} grey levels",
            )
        )
        off = np.abs(found[at[:, 1], at[:, 0]] - sparse)
        rows.append(
            ComparedNumber(
                f"{name} matching: median difference from matched features",
                float(np.nanmedian(off)),
                expected=(0.0, 1.0),
                unit="px",
            )
        )
    note = f"{RENDERED} Semi-global matching takes the place of Geiger's; `spinfilters depth LEFT RIGHT` does any pair."
    shown = disparities_figure(
        pair.left, {f"disparity, {name} matching": found for name, found in maps.items()}
    )
    return ItemResult(rows, {"depth": shown}, note=note)


STEREO_PICTURES: Final[tuple[Item, ...]] = (
    tweddle_item(
        "Figure 2-13", "section 2.8", "A pair before and after undistortion", make_undistortion, 1.0
    ),
    tweddle_item("Figure 2-16", "section 2.9", "Stereo and frame-to-frame matches", make_matches, 2.0),
    tweddle_item("Figure 2-17", "section 2.10", "An image and its depth map", make_depth, 2.0),
)
