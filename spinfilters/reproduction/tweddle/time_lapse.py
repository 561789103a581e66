"""Figure 6-15 and the text of section 6.3: pairs of the recording with the estimated axes, and what the front end found in it."""

from functools import partial
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.io.camera import StereoRig
from spinfilters.io.truth import Truth
from spinfilters.models.body import BodyEstimate
from spinfilters.plots.style import BLUE, GREY, ORANGE, PRINCIPAL_NAMES, RED, SKY, legend_below, tidy
from spinfilters.reproduction.item import ComparedNumber, Item, ItemResult, tweddle_item
from spinfilters.reproduction.tweddle.replaced_recordings import (
    FEW_PAIRS,
    PAIRS,
    RENDERED,
    TIME_LAPSE,
    RenderedRecording,
    bound_cell,
    rendered_recording,
)
from spinfilters.vision.depth_map import textured_pixels

LENGTH: Final = 0.14
"""m, of a drawn axis."""
ASSOCIATION: Final = 196.0 + 74.0
"""s, of all stages of the association of 115 pairs (section 6.8)."""
THESIS_PAIRS, THESIS_FACTORS, THESIS_LANDMARKS = 115, 24723, 2447
SHOWN_COLOURS: Final = (RED, ORANGE, SKY)
"""Of the axes, in the order of their moments; bright enough for dark images."""
SHOWN_PX: Final = 160.0
"""Half width of the part of an image that is shown."""
SECONDS: Final = 40.0
"""Of the rendered recording, which all its items share."""


def make_time_lapse(pairs: int = PAIRS) -> ItemResult:
    """Figure 6-15: four pairs with the principal axes where the estimate puts them, and the true ones."""
    found = rendered_recording(pairs)
    estimated, true = (projected(found.rig, each) for each in axis_ends(found))
    off = np.linalg.norm(estimated[:, :, 1:] - true[:, :, 1:], axis=-1)
    rows = [
        ComparedNumber(
            "ends of the drawn axes off the true ones, root mean square over 4 pairs",
            float(np.sqrt(np.mean(off**2))),
            expected=(0.0, 8.0),
            unit="px",
            bound=bound_cell(_pixels_of_axes(found, found.bounded_body)),
            why="the axes are less certain than the attitude: their stated deviations are "
            f"{_pixels_of_axes(found, found.evaluation.body):.2g} px at the ends",
        )
    ]
    figure = Figure(figsize=(9.0, 13.0), layout="constrained")
    for row, (panels, pair) in enumerate(zip(figure.subplots(len(TIME_LAPSE), 2), found.pairs, strict=True)):
        time = found.evaluation.trajectory.time[TIME_LAPSE[row]]
        for side, (axes, image, name) in enumerate(zip(panels, pair, ("left", "right"), strict=True)):
            axes.imshow(image, cmap="gray", vmin=0, vmax=255)
            _draw_axes(axes, estimated[side, row], true[side, row])
            axes.set_title(f"{name} image at {time:.1f} s", loc="left", fontsize="medium")
            u, v = estimated[side, row, 0]
            axes.set(xlim=(u - SHOWN_PX, u + SHOWN_PX), ylim=(v + 0.75 * SHOWN_PX, v - 0.75 * SHOWN_PX))
            axes.set_axis_off()
    handles = [
        Line2D([], [], color=colour, linewidth=2.2, label=f"{name} axis")
        for name, colour in zip(PRINCIPAL_NAMES, SHOWN_COLOURS, strict=True)
    ]
    true_handle = Line2D([], [], color=GREY, linewidth=1.0, linestyle=(0, (2, 2)), label="true axes (white)")
    legend_below(figure, [*handles, true_handle])
    return ItemResult(rows, {"time-lapse": figure}, note=RENDERED)


def _pixels_of_axes(found: RenderedRecording, body: BodyEstimate | None) -> float | None:
    """Deviation of the ends of the axes across them, px, at the median distance; root mean square over the axes."""
    if body is None:
        return None
    z = float(np.median(found.evaluation.trajectory.position[:, 2]))
    # an end moves by the rotation about the two other axes, of which the image shows two of three directions
    std = float(np.sqrt(2.0 / 3.0 * np.trace(body.principal_axes_cov) * 2.0 / 3.0))
    return float(found.rig.left.intrinsics[0]) * LENGTH * std / z


def axis_ends(found: RenderedRecording) -> tuple[Float[np.ndarray, "e 4 3"], Float[np.ndarray, "e 4 3"]]:
    """Centre of mass and ends of the principal axes at the epochs of the time-lapse, estimated and true.

    Parameters
    ----------
    found : RenderedRecording
        With its estimate and its truth.

    Returns
    -------
    estimated, true : (e, 4, 3) float array
        m, camera axes; the true axes in the order and with the signs of the estimated ones.
    """
    trajectory, body, truth = found.evaluation.trajectory, found.evaluation.body, found.truth
    chosen = list(TIME_LAPSE)
    R = matrix_from_quaternion(trajectory.q_ig[chosen]) @ body.principal_axes_g.T
    return _ends(trajectory.position[chosen], R), _true_ends(truth, trajectory.time[chosen], R)


def _true_ends(
    truth: Truth, time: Float[np.ndarray, " e"], estimated: Float[np.ndarray, "e 3 3"]
) -> Float[np.ndarray, "e 4 3"]:
    assert truth.principal_axes_g is not None
    assert truth.principal_moments is not None
    rows = np.abs(truth.time[:, np.newaxis] - time).argmin(axis=0)
    axes = truth.principal_axes_g[np.argsort(truth.principal_moments)]
    R = matrix_from_quaternion(truth.q_ig[rows]) @ axes.T
    signs = np.sign(np.einsum("eij,eij->j", R, estimated))
    return _ends(truth.center_of_mass[rows], R * signs)


def _ends(place: Float[np.ndarray, "e 3"], R: Float[np.ndarray, "e 3 3"]) -> Float[np.ndarray, "e 4 3"]:
    ends = place[:, np.newaxis] + LENGTH * np.swapaxes(R, 1, 2)
    return np.concatenate([place[:, np.newaxis], ends], axis=1)


def projected(rig: StereoRig, points: Float[np.ndarray, "e k 3"]) -> Float[np.ndarray, "2 e k 2"]:
    """Pixels of points (m, axes of the left camera) in the left and the right rectified image."""
    fx, fy, cx, cy = rig.left.intrinsics
    sides = []
    for shift in (0.0, rig.baseline_m):
        x, y, z = np.moveaxis(points, -1, 0)
        sides.append(np.stack([fx * (x - shift) / z + cx, fy * y / z + cy], axis=-1))
    return np.stack(sides)


def _draw_axes(axes: Axes, estimated: Float[np.ndarray, "4 2"], true: Float[np.ndarray, "4 2"]) -> None:
    for k, colour in enumerate(SHOWN_COLOURS, start=1):
        axes.plot(*estimated[[0, k]].T, color=colour, linewidth=2.2)
        axes.plot(*true[[0, k]].T, color="white", linewidth=1.0, linestyle=(0, (2, 2)))


def make_association(pairs: int = PAIRS) -> ItemResult:
    """Section 6.3: how long the association takes, and what it finds."""
    found = rendered_recording(pairs)
    covered = float(np.mean([textured_pixels(left).mean() for left, _ in found.pairs]))
    rate = np.linalg.norm(found.evaluation.trajectory.rate_i, axis=1)
    turned = float(np.degrees(np.mean(rate) * np.median(np.diff(found.evaluation.trajectory.time))))
    other = (
        f"the rendered satellite covers {covered:.1%} of an image and turns by {turned:.0f} deg between pairs, the thesis' "
        "by 30 deg at "
        "10 rpm; features are SIFT instead of SURF"
    )
    rows = [
        ComparedNumber(
            "association of a stereo pair, all stages",
            found.association_s / pairs,
            printed=ASSOCIATION / THESIS_PAIRS,
            unit="s",
            smaller_is_better=True,
            why=f"{found.observations / found.association_s:.0f} observations are found in a second of the processor; the "
            "thesis' machine "
            f"found {THESIS_FACTORS / ASSOCIATION:.0f}",
        ),
        ComparedNumber(
            "stereo observations of a pair",
            found.observations / pairs,
            printed=THESIS_FACTORS / THESIS_PAIRS,
            tolerance=20.0,
            why=other,
        ),
        ComparedNumber(
            "landmarks that come in with a pair",
            found.landmarks / pairs,
            printed=THESIS_LANDMARKS / THESIS_PAIRS,
            tolerance=2.0,
            why=other,
        ),
        ComparedNumber(
            "observations of a landmark",
            found.observations / found.landmarks,
            printed=THESIS_FACTORS / THESIS_LANDMARKS,
            tolerance=1.0,
            why=other,
        ),
    ]
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    number = np.arange(1, len(found.seen) + 1)
    for axes, values, printed, label in (
        (upper, found.seen, THESIS_FACTORS / THESIS_PAIRS, "observations"),
        (lower, found.new, THESIS_LANDMARKS / THESIS_PAIRS, "new landmarks"),
    ):
        axes.bar(number[: len(values)], values, color=BLUE, label="ours")
        axes.axhline(printed, color=RED, linestyle="--", label="mean of the thesis")
        axes.set_ylabel(f"{label} of a pair")
        tidy(axes)
    legend_below(figure, upper.get_legend_handles_labels()[0])
    lower.set_xlabel("stereo pair")
    figure.suptitle("what the front end finds in a pair")
    return ItemResult(rows, {"association": figure}, note=RENDERED)


TIME_LAPSES: Final[tuple[Item, ...]] = (
    tweddle_item(
        "Figure 6-15",
        "section 6.5.1",
        "Time-lapse of pairs with axes",
        make_time_lapse,
        SECONDS,
        partial(make_time_lapse, FEW_PAIRS),
    ),
    tweddle_item(
        "Section 6.3",
        "with 6.8, text",
        "Association: its time and what it finds",
        make_association,
        3.0,
        partial(make_association, FEW_PAIRS),
    ),
)
