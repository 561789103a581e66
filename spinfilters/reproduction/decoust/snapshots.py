"""Chapter 4: corners of a cube in two sequences of snapshots, its centre of rotation, and angles of transitions.

The processing is the thesis' own (`corners.py`, `scan_features.py`, `surfaces.py`), with the parameters of Table 3.2 on the traced
cube at 500 m. What it does not state is which edge points are taken "arbitrarily" for normals and boundary corners.
"""

from collections.abc import Sequence
from functools import cache, partial
from itertools import pairwise, product
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from spinfilters.plots.style import AXIS_COLOURS, BLACK, BLUE, GREEN, ORANGE, RED, legend_below, tidy
from spinfilters.reproduction.decoust.cloud_features import find_corner, planes_through
from spinfilters.reproduction.decoust.pose_bound import PoseBound, center_bound, noise_free, pose_bound
from spinfilters.reproduction.decoust.snapshot_frames import (
    PLACE,
    SEQUENCES,
    ProcessedSequence,
    best_fitting_sphere,
    processed_sequence,
    reference_frame,
    transition_errors,
)
from spinfilters.reproduction.item import ComparedNumber, ItemResult, decoust_item

CORNER_DIFFERENCES: Final = np.array(
    [[1e-5, -8e-5, -1e-6], [-0.05, 3.28, 1.71], [8.35, 0.98, -6.17], [-0.50, -1.06, -3.47]]
)
"""Table 4.1: corner and three boundary corners, differences of x, y, z, cm."""
CORNER_DISTANCES: Final = (8e-6, 0.37, 1.04, 0.37)
"""Table 4.1: the column of distances, cm as printed."""
SPHERES_OF_CORNERS: Final = np.array(
    [[499999.898, 499999.999, 500000.002], [1.08, 0.11, 0.03], [0.41, 0.05, 0.01], [865.59, 865.00, 866.02]]
)
"""Table 4.2: centre and radius, mm, from 4, 8 and 12 poses."""
SPHERES_WITH_BOUNDARY: Final = np.array(
    [
        [499944.746, 499954.445, 499964.481],
        [12.48, 7.81, 1.92],
        [-34.32, -20.71, -8.09],
        [806.16, 818.81, 827.27],
    ]
)
"""Table 4.3: the same with boundary corners."""
TRUE_SPHERE: Final = np.array([*(1000.0 * PLACE), 500.0 * np.sqrt(3.0)])
FIRST_ANGLES: Final = np.array(
    [
        [0.03, 0.04, 0.04, 7.18, 10.23, 10.75, 0.25, 0.35, 0.37],
        [1.51, 2.50, 2.66, 1.54, 2.55, 2.71, 1.72, 2.85, 3.03],
        [0.14, 0.28, 0.30, 4.21, 8.26, 8.82, 0.06, 0.12, 0.12],
        [0.07, 0.15, 0.17, 2.62, 6.18, 6.59, 0.01, 0.03, 0.03],
        [0.07, 0.19, 0.20, 0.14, 0.39, 0.42, 0.25, 0.70, 0.74],
        [0.17, 0.53, 0.56, 1.79, 5.78, 6.04, 0.08, 0.27, 0.28],
        [0.21, 0.70, 0.71, 0.03, 0.09, 0.09, 0.33, 1.09, 1.11],
        [0.75, 2.32, 2.31, 0.07, 0.21, 0.21, 0.44, 1.37, 1.37],
        [0.89, 2.40, 2.31, 0.63, 1.70, 1.64, 0.23, 0.63, 0.61],
        [1.30, 3.01, 2.77, 1.97, 4.55, 4.19, 0.38, 0.88, 0.81],
        [0.31, 0.62, 0.54, 1.06, 2.12, 1.85, 1.39, 2.78, 2.43],
        [0.71, 1.24, 1.02, 0.19, 0.34, 0.28, 0.74, 1.29, 1.06],
        [0.78, 1.22, 0.94, 1.35, 2.11, 1.63, 0.35, 0.55, 0.43],
    ]
)
"""Figure 4.13: errors of x, y, z for each boundary corner, deg."""
SECOND_ANGLES: Final = np.array(
    [
        [1.96, 3.56, 3.35, 0.07, 0.12, 0.11, 0.70, 1.28, 1.21],
        [1.22, 2.71, 2.62, 3.34, 7.41, 7.16, 1.82, 4.02, 3.89],
        [0.83, 2.35, 2.31, 0.72, 2.04, 2.01, 1.02, 2.89, 2.85],
        [0.52, 2.05, 2.05, 0.63, 2.46, 2.45, 0.32, 1.25, 1.24],
        [0.21, 1.28, 1.28, 0.05, 0.33, 0.33, 0.24, 1.46, 1.47],
        [0.04, 0.45, 0.45, 0.03, 0.31, 0.31, 0.06, 0.69, 0.70],
        [0.10, 1.09, 1.09, 0.19, 2.07, 2.06, 0.06, 0.61, 0.61],
        [0.71, 4.21, 4.15, 0.45, 2.66, 2.62, 0.55, 3.23, 3.18],
        [1.43, 5.55, 5.37, 1.12, 4.34, 4.20, 0.67, 2.59, 2.51],
        [1.80, 5.20, 4.92, 0.10, 0.29, 0.27, 0.00, 0.00, 0.00],
        [0.58, 1.34, 1.23, 0.14, 0.33, 0.30, 1.34, 3.09, 2.84],
        [0.59, 1.15, 1.02, 1.34, 2.59, 2.31, 1.58, 3.06, 2.72],
        [0.27, 0.44, 0.38, 2.41, 4.04, 3.47, 2.88, 4.83, 4.15],
        [1.61, 2.40, 1.98, 2.43, 3.61, 2.98, 1.64, 2.44, 2.02],
        [1.95, 2.62, 2.08, 1.20, 1.61, 1.28, 3.67, 4.92, 3.91],
    ]
)
"""Figure 4.16: the same of the second sequence."""
DIGITS: Final = 0.015
"""Deg: two printed decimals, and the rounding of what was subtracted."""
CHOICE: Final[str] = (
    "the thesis takes boundary corners from edge points that it does not name; one ray further on the edge, 3.2 cm at 500 m, turns "
    "an axis by 1.8 deg for each metre between the points"
)

CHOICES: Final = 2000
"""Drawn choices of the three points of a corner."""
OTHER_POINTS: Final = 3
"""Farthest points of an edge among which the thesis may have chosen."""
ONE_RAY: Final = 2.2
"""By what one ray at 500 m, 32 mm, turns an axis at a corner 0.82 m from the line to the centre, deg."""


@cache
def sequence(number: int) -> ProcessedSequence:
    """The first or the second sequence, processed once."""
    return processed_sequence(SEQUENCES[number])


def make_corner_errors() -> ItemResult:
    """Table 4.1: differences of the corner and three boundary corners at (6, 10, 0) deg."""
    found = sequence(0)
    corner = 100.0 * found.errors(found.corners)[0]
    boundary = np.array([100.0 * found.errors(found.boundary_corners[:, k])[0] for k in range(3)])
    numbers = [
        ComparedNumber(
            "corner, distance to the truth",
            float(np.linalg.norm(corner)),
            printed=float(np.linalg.norm(CORNER_DIFFERENCES[0])),
            unit="cm",
            tolerance=5e-6,
            smaller_is_better=True,
            why=_corner_choices(found),
            bound=corners_bound(found, "cm", [0]),
        )
    ]
    for k in range(1, 4):
        match = boundary[np.argmin(np.abs(boundary - CORNER_DIFFERENCES[k]).max(axis=1))]
        numbers += [
            ComparedNumber(
                f"boundary corner {k}, {axis}",
                float(ours),
                printed=float(printed),
                unit="cm",
                tolerance=0.005,
                bound=corners_bound(found, "cm", [0]),
            )
            for axis, ours, printed in zip("xyz", match, CORNER_DIFFERENCES[k], strict=True)
        ]
        numbers.append(
            ComparedNumber(
                f"boundary corner {k}, distance",
                float(np.linalg.norm(match)),
                printed=CORNER_DISTANCES[k],
                unit="cm",
                tolerance=0.005,
                bound=corners_bound(found, "cm", [0]),
                why="the printed distance is "
                f"{np.linalg.norm(CORNER_DIFFERENCES[k]) / CORNER_DISTANCES[k]:.3g} times smaller than the printed "
                "differences give",
            )
        )
    return ItemResult(numbers, {"differences": _differences_figure(corner, boundary)})


def _corner_choices(found: ProcessedSequence) -> str:
    """How far the corner of the first snapshot depends on the arbitrary points of its three faces."""
    snapshot = found.snapshots[0]
    assert snapshot is not None
    surfaces, generator = snapshot.surfaces, np.random.default_rng(0)
    members = [np.flatnonzero(surfaces.of_point == number) for number in surfaces.largest()]
    true, errors = found.nearest_vertices(found.corners)[0], []
    for _ in range(CHOICES):
        corner = find_corner(planes_through(surfaces, [int(generator.choice(own)) for own in members]))
        errors.append(np.inf if corner is None else 100.0 * float(np.linalg.norm(corner - true)))
    printed, ours = (
        float(np.linalg.norm(CORNER_DIFFERENCES[0])),
        100.0 * float(np.linalg.norm(snapshot.corner - true)),
    )
    shares = [np.mean(np.array(errors) <= each) for each in (printed, ours)]
    return (
        f"the planes go through points that the text calls arbitrary: {CHOICES} choices give {min(errors):.1g} to "
        f"{max(errors):.1g} cm, {shares[0]:.0%} of them at most the printed error and {shares[1]:.0%} "
        "at most ours, which takes the first point of "
        f"each face. Normals of the face with {len(members[2])} points are wrong by up to 0.005 deg, where a neighbourhood reaches "
        "across an edge and stays below the threshold of the variance"
    )


def make_corner_distances() -> ItemResult:
    """Figure 4.7: distances to the true corners over the snapshots."""
    found = sequence(0)
    named = {
        "corner": found.corners,
        **{f"boundary corner {k + 1}": found.boundary_corners[:, k] for k in range(3)},
    }
    distances = {name: np.linalg.norm(found.errors(points), axis=1) for name, points in named.items()}
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes = figure.add_subplot()
    for name, values in distances.items():
        axes.plot(np.arange(1, len(values) + 1), values, marker="o", label=name)
    axes.set(
        xlabel="snapshot", ylabel="distance to the true corner [m]", title="corners over the first sequence"
    )
    axes.legend(frameon=False)
    tidy(axes)
    boundary = np.stack([values for name, values in distances.items() if name != "corner"])
    numbers = [
        ComparedNumber(
            "largest distance of the corner",
            float(np.nanmax(distances["corner"])),
            expected=(0.0, 1e-3),
            unit="m",
            bound=corners_bound(found, "m"),
        ),
        ComparedNumber(
            "largest distance of a boundary corner",
            float(np.nanmax(boundary)),
            expected=(0.03, 0.3),
            unit="m",
            bound=corners_bound(found, "m"),
        ),
    ]
    table = [
        {
            "snapshot": k + 1,
            **{name.replace(" ", "_") + "_m": float(values[k]) for name, values in distances.items()},
        }
        for k in range(len(found.corners))
    ]
    return ItemResult(numbers, {"distances": figure}, {"distances": table})


def make_spheres(with_boundary: bool) -> ItemResult:
    """Tables 4.2 and 4.3: the centre of rotation from 4, 8 and 12 poses, with the first snapshot and without."""
    found, printed = sequence(0), SPHERES_WITH_BOUNDARY if with_boundary else SPHERES_OF_CORNERS
    first = 100.0 * float(np.linalg.norm(found.errors(found.corners)[0]))
    worse = first / float(np.linalg.norm(CORNER_DIFFERENCES[0]))
    numbers, table = [], []
    for begin, words in ((0, ""), (1, " from the second snapshot on")):
        for column, count in enumerate((4, 8, 12)):
            chosen = slice(begin, begin + count)
            points = found.corners[chosen]
            if with_boundary:
                points = np.concatenate([points, found.boundary_corners[chosen].reshape(-1, 3)])
            sphere = best_fitting_sphere(points[np.isfinite(points).all(axis=1)])
            ours = 1000.0 * np.array([*sphere.centre, sphere.radius]) - TRUE_SPHERE
            theirs = printed[:, column] - TRUE_SPHERE
            limit = 1000.0 * center_bound([each for each in bounds(0)[chosen] if each is not None])
            for name, mine, other, bound in (
                (
                    "centre",
                    float(np.linalg.norm(ours[:3])),
                    float(np.linalg.norm(theirs[:3])),
                    noise_free(limit, "mm"),
                ),
                (
                    "radius",
                    abs(float(ours[3])),
                    abs(float(theirs[3])),
                    "0: of a known shape",
                ),
            ):
                numbers.append(
                    ComparedNumber(
                        f"error of the {name}, {count} poses{words}",
                        mine,
                        printed=other,
                        unit="mm",
                        tolerance=0.02,
                        bound=bound,
                        smaller_is_better=True,
                        why=f"the fit amplifies errors of corners {sphere.amplification:.3g} times; that of the first snapshot, "
                        f"{worse:.3g} times the printed one, depends on the points that its planes go through (see Table 4.1)",
                    )
                )
            table.append(
                {
                    "poses": count,
                    "from_snapshot": begin + 1,
                    "printed_centre_error_mm": float(np.linalg.norm(theirs[:3])),
                    "centre_error_mm": float(np.linalg.norm(ours[:3])),
                    "printed_radius_error_mm": abs(float(theirs[3])),
                    "radius_error_mm": abs(float(ours[3])),
                }
            )
    return ItemResult(
        numbers,
        {"centres": _centres_figure(table)},
        {"spheres": table},
        "The printed radius 865.00 of 8 poses does not fit its neighbours 865.59 and 866.02.",
    )


def _centres_figure(table: list[dict[str, float | int | str]]) -> Figure:
    """Error of the centre over the number of poses: printed, ours, and ours without the first snapshot."""
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    curves = (
        ("printed", RED, "printed_centre_error_mm", 1),
        ("ours", BLUE, "centre_error_mm", 1),
        ("ours, from the second snapshot on", GREEN, "centre_error_mm", 2),
    )
    for name, colour, key, begin in curves:
        own = [row for row in table if row["from_snapshot"] == begin]
        axes.semilogy(
            [row["poses"] for row in own], [row[key] for row in own], "o-", color=colour, label=name
        )
    axes.set(xlabel="poses", ylabel="error of the centre [mm]", xticks=[4, 8, 12])
    axes.set_title("centre of rotation", loc="left", fontsize="medium")
    axes.legend(frameon=False)
    tidy(axes)
    return figure


def _differences_figure(corner: Float[np.ndarray, "3"], boundary: Float[np.ndarray, "3 3"]) -> Figure:
    """Differences of the corner and of the boundary corners by axis, printed and ours."""
    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    panels = figure.subplots(1, 4)
    for k, axes in enumerate(panels):
        printed = CORNER_DIFFERENCES[k]
        ours = corner if k == 0 else boundary[np.argmin(np.abs(boundary - printed).max(axis=1))]
        places = np.arange(3)
        axes.bar(places - 0.18, printed, 0.34, color=ORANGE, label="printed")
        axes.bar(places + 0.18, ours, 0.34, color=BLUE, label="ours")
        axes.axhline(0.0, color=BLACK, linewidth=0.8)
        axes.set_xticks(places, list("xyz"))
        axes.set_title(f"boundary corner {k}" if k else "corner", loc="left", fontsize="medium")
        tidy(axes)
    panels[0].set_ylabel("true minus measured [cm]")
    legend_below(figure, panels[0].get_legend_handles_labels()[0])
    return figure


@cache
def bounds(number: int) -> list[PoseBound | None]:
    """Of every snapshot of a sequence with the noise of Figure 2.11; None where the processing found no corner."""
    return [
        None if each is None else pose_bound(each.surfaces.features.points, pose)
        for each, pose in zip(sequence(number).snapshots, SEQUENCES[number], strict=True)
    ]


def corners_bound(found: ProcessedSequence, unit: str, chosen: Sequence[int] | None = None) -> str:
    """Cell of the bound of corners: median over the snapshots, or of the chosen ones.

    Parameters
    ----------
    found : ProcessedSequence
        The first or the second sequence.
    unit : str
        m, cm or mm.
    chosen : sequence of int or None
        Indices of snapshots; None for all.
    """
    return noise_free({"m": 1.0, "cm": 100.0, "mm": 1000.0}[unit] * _corner_deviation(found, chosen), unit)


def edges_bound(found: ProcessedSequence) -> str:
    """Cell of the bound of the length between two corners, m."""
    return noise_free(np.sqrt(2.0) * _corner_deviation(found, None), "m")


def _corner_deviation(found: ProcessedSequence, chosen: Sequence[int] | None) -> float:
    number = next(k for k in range(len(SEQUENCES)) if found is sequence(k))
    rows = range(len(found.snapshots)) if chosen is None else chosen
    true = found.nearest_vertices(found.corners) - PLACE
    found_bounds = bounds(number)
    return float(
        np.median([each.of_point(true[row]) for row in rows if (each := found_bounds[row]) is not None])
    )


def _transition_bound(number: int) -> str:
    """Cell of the bound of an axis' angle between snapshots: root mean square over axes and transitions."""
    pairs = [(a, b) for a, b in pairwise(bounds(number)) if a is not None and b is not None]
    # an axis is turned by the two components of a rotation across it: two thirds of the trace
    squares = [2.0 / 3.0 * np.trace(a.attitude + b.attitude) for a, b in pairs]
    return noise_free(float(np.rad2deg(np.sqrt(np.mean(squares)))), "deg")


def make_transitions(number: int, printed: Float[np.ndarray, "n 9"]) -> ItemResult:
    """Figures 4.13 and 4.16: angles between true and measured axes of each transition."""
    found = sequence(number)
    theirs = printed.reshape(-1, 3, 3)
    ours = np.stack([found.transition_errors(k) for k in range(3)], axis=1)
    gap = np.abs(theirs[:, :, np.newaxis] - ours[:, np.newaxis]).max(
        axis=3
    )  # (transition, printed triple, our triple)
    least = np.nan_to_num(gap, nan=np.inf).min(axis=2)
    equal, largest = int(np.count_nonzero(least < DIGITS)), float(least[np.isfinite(least)].max(initial=0.0))
    numbers = [
        ComparedNumber(
            f"triples that agree within {DIGITS} deg, of {3 * len(theirs)}",
            float(equal),
            printed=float(3 * len(theirs)),
            why=f"{CHOICE}. {_causes(number, theirs)}; the largest gap of a triple is {largest:.2g} deg",
            bound="a count",
        ),
        ComparedNumber(
            "median angle, all axes",
            float(np.nanmedian(ours)),
            printed=float(np.median(theirs)),
            unit="deg",
            tolerance=0.1,
            bound=_transition_bound(number),
            smaller_is_better=True,
        ),
        ComparedNumber(
            "largest angle",
            float(np.nanmax(ours)),
            printed=float(theirs.max()),
            unit="deg",
            tolerance=0.1,
            bound=_transition_bound(number),
            smaller_is_better=True,
        ),
    ]
    return ItemResult(
        numbers, {"transitions": _transition_figure(found)}, {"transitions": _transition_table(ours, theirs)}
    )


def _causes(number: int, theirs: Float[np.ndarray, "n 3 3"]) -> str:
    """Of the triples that differ, how many have no corner here, agree with other edge points, or lie within one ray."""
    found, counts = sequence(number), np.zeros(5, dtype=int)
    for t, printed in enumerate(theirs):
        choices = [_transition_choices(found, t, points) for points in (1, OTHER_POINTS)]
        for triple in printed:
            gaps = [np.abs(each - triple).max(axis=1).min(initial=np.inf) for each in choices]
            kind = 0 if gaps[0] < DIGITS else 1 if not len(choices[0]) else 2 if gaps[1] < DIGITS else 3
            counts[4 if kind == 3 and gaps[0] > ONE_RAY else kind] += 1
    _, lost, other, near, far = counts.tolist()
    return (
        f"Of the triples that differ {lost} belong to snapshots without a corner here, {other} agree when one of the "
        f"{OTHER_POINTS} farthest points of the edge is taken, {near} differ by less than one ray does ({ONE_RAY:g} deg), "
        f"{far} by more"
    )


def _transition_choices(found: ProcessedSequence, t: int, points: int) -> Float[np.ndarray, "c 3"]:
    """Angles of transition ``t`` with each of the farthest ``points`` of an edge as boundary corners, deg."""
    angles = []
    for k in range(3):
        frames = []
        for row in (t, t + 1):
            snapshot, end = found.snapshots[row], found.boundary_corners[row, k]
            if snapshot is None or not np.isfinite(end).all():
                break
            edge = next(each for each in snapshot.edges if len(each) and np.array_equal(each[0], end))
            frames.append([_frames_of(found, row, snapshot.corner, point) for point in edge[:points]])
        if len(frames) == 2:
            angles += [
                transition_errors(np.array([a[0], b[0]]), np.array([a[1], b[1]]))[0]
                for a, b in product(*frames)
            ]
    return np.array(angles).reshape(-1, 3)


def _frames_of(
    found: ProcessedSequence, row: int, corner: Float[np.ndarray, "3"], end: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"]]:
    """Measured and true frame of a snapshot with one boundary corner."""
    vertices = found.vertices[row]
    true = [vertices[np.linalg.norm(vertices - each, axis=1).argmin()] for each in (corner, end)]
    return reference_frame(PLACE, corner, end), reference_frame(PLACE, true[0], true[1])


def make_transition_curves(number: int, printed: Float[np.ndarray, "n 9"]) -> ItemResult:
    """Figures 4.14 and 4.17: the x axis has smaller errors than the other two."""
    found = sequence(number)
    ours = np.stack([found.transition_errors(k) for k in range(3)], axis=1)
    theirs = printed.reshape(-1, 3, 3)
    ratio, shown = (
        float(np.nanmedian(each[:, :, 0]) / np.nanmedian(each[:, :, 1:])) for each in (ours, theirs)
    )
    return ItemResult(
        [
            ComparedNumber(
                "median error of x over that of y and z",
                ratio,
                printed=shown,
                tolerance=0.1,
                bound="a ratio of errors",
                why=f"{np.isfinite(ours[:, :, 0]).sum()} triples of ours against {theirs[:, :, 0].size} printed ones, of "
                "other edge "
                "points (Figures 4.13 and 4.16)",
            ),
        ],
        {"transitions": _transition_figure(found)},
    )


def _transition_figure(found: ProcessedSequence) -> Figure:
    """Angle errors of x, y and z by transition, one panel per boundary corner."""
    figure = Figure(figsize=(7.0, 7.4), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    for k, axes in enumerate(panels):
        for values, colour in zip(found.transition_errors(k).T, AXIS_COLOURS, strict=True):
            axes.plot(np.arange(1, len(values) + 1), values, marker="o", color=colour)
        axes.set(ylabel="error [deg]", title=f"boundary corner {k + 1}")
        tidy(axes)
    panels[-1].set_xlabel("transition")
    names = zip("xyz", AXIS_COLOURS, strict=True)
    legend_below(
        figure, [Line2D([], [], color=colour, marker="o", label=f"axis {name}") for name, colour in names]
    )
    return figure


def _transition_table(
    ours: Float[np.ndarray, "n 3 3"], theirs: Float[np.ndarray, "n 3 3"]
) -> list[dict[str, float | int | str]]:
    return [
        {
            "transition": k + 1,
            **{
                f"printed_bc{b + 1}_{a}_deg": float(theirs[k, b, i])
                for b in range(3)
                for i, a in enumerate("xyz")
            },
            **{
                f"ours_bc{b + 1}_{a}_deg": float(ours[k, b, i]) for b in range(3) for i, a in enumerate("xyz")
            },
        }
        for k in range(len(theirs))
    ]


SNAPSHOTS: Final = (
    decoust_item(
        "Table 4.1", "p. 67", "Corner and boundary corners at (6, 10, 0) deg", make_corner_errors, 2.0
    ),
    decoust_item("Figure 4.7", "section 4.1.4", "Distances to the true corners", make_corner_distances),
    decoust_item(
        "Table 4.2", "p. 71", "Centre of rotation from corners", partial(make_spheres, with_boundary=False)
    ),
    decoust_item(
        "Table 4.3",
        "p. 72",
        "Centre of rotation with boundary corners",
        partial(make_spheres, with_boundary=True),
    ),
    decoust_item(
        "Figure 4.13",
        "p. 77",
        "Angles of transitions, first sequence",
        partial(make_transitions, 0, FIRST_ANGLES),
    ),
    decoust_item(
        "Figure 4.14",
        "section 4.3",
        "Curves of Figure 4.13",
        partial(make_transition_curves, 0, FIRST_ANGLES),
    ),
    decoust_item(
        "Figure 4.16",
        "p. 80",
        "Angles of transitions, second sequence",
        partial(make_transitions, 1, SECOND_ANGLES),
        2.0,
    ),
    decoust_item(
        "Figure 4.17",
        "section 4.3",
        "Curves of Figure 4.16",
        partial(make_transition_curves, 1, SECOND_ANGLES),
    ),
)
