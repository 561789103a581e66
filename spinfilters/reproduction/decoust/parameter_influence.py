"""Chapter 3: how the parameters of the processing change edges, boundaries and surfaces of one cloud (Figures 3.3-3.7, Table 3.1).

The thesis prints pictures and says what they show; the numbers here are counts of points in its words.
"""

import time
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from spinfilters.lidar.scan import RayPattern
from spinfilters.plots.style import BLUE, GREY, RED, SKY, dot_handles, legend_below, tidy
from spinfilters.reproduction.decoust.cloud_features import (
    Parameters,
    find_bndry_points,
    find_edge_points,
    surf_segm,
)
from spinfilters.reproduction.decoust.snapshot_frames import PLACE
from spinfilters.reproduction.item import ComparedNumber, ItemResult, decoust_item
from spinfilters.simulation.lidar_scanner import LidarSettings, Scanner, Still, thesis_rotation
from spinfilters.simulation.lidar_sequence import mesh_of

POSE: Final = (30.0, 50.0, 0.0)
"""Euler angles z, y, x, deg: all three faces are well visible."""
EDGE, BOUNDARY = 1, 2
TIMES: Final = {5: 4.5, 10: 6.2, 16: 7.5, 50: 27.8}
"""Table 3.1: time by the largest neighbourhood; the unit is not printed, presumably s."""


@cache
def cloud() -> Float[np.ndarray, "n 3"]:
    """The cube at 500 m, 83 x 83 rays over 0.3 deg."""
    scanner = Scanner.of(mesh_of("cube"), LidarSettings(RayPattern((0.3, 0.3), (83, 83))))
    return scanner.scan(Still(thesis_rotation(*POSE), PLACE), 0.0, np.random.default_rng(0)).points


def make_variance_threshold() -> ItemResult:
    """Figure 3.3."""
    values = (1e-1, 1e-2, 1e-5, 1e-10)
    labels = [find_edge_points(cloud(), Parameters(surface_variance=value)).label for value in values]
    counts = _counts(labels, EDGE)
    numbers = [
        ComparedNumber(
            "edge points at 0.1 over those at 1e-5: many stay unknown",
            counts[0] / counts[2],
            expected=(0.0, 0.5),
        ),
        ComparedNumber(
            "edge points at 1e-10 over those at 1e-5: no change", counts[3] / counts[2], expected=(0.85, 1.15)
        ),
    ]
    return ItemResult(numbers, {"clouds": _clouds(labels, values, "threshold", {EDGE: BLUE})})


def make_edge_neighbours() -> ItemResult:
    """Figure 3.4."""
    values = tuple(TIMES)
    labels = [find_edge_points(cloud(), Parameters(edge_neighbors=value)).label for value in values]
    counts = _counts(labels, EDGE)
    return ItemResult(
        [
            ComparedNumber(
                "edge points with 50 neighbours over those with 16: no gain",
                counts[3] / counts[2],
                expected=(0.95, 1.05),
            ),
            ComparedNumber(
                "edge points with 10 neighbours over those with 16",
                counts[1] / counts[2],
                expected=(0.9, 1.1),
            ),
        ],
        {"clouds": _clouds(labels, values, "neighbours", {EDGE: BLUE})},
    )


def make_edge_times() -> ItemResult:
    """Table 3.1: processor time of the edge detection; each the least of three."""
    seconds = {}
    for count in TIMES:
        spent = []
        for _ in range(3):
            begin = time.process_time()
            find_edge_points(cloud(), Parameters(edge_neighbors=count))
            spent.append(time.process_time() - begin)
        seconds[count] = min(spent)
    numbers = [
        ComparedNumber(
            f"time with up to {count} neighbours",
            seconds[count],
            printed=printed,
            unit="s",
            tolerance=0.05,
            smaller_is_better=True,
            why=f"ours takes {1e6 * seconds[count] / len(cloud()):.2g} us for each of {len(cloud())} points",
        )
        for count, printed in TIMES.items()
    ]

    def power(times: Mapping[int, float]) -> float:
        """Exponent of the growth from 5 to 50 neighbours."""
        return float(np.log10(times[50] / times[5]))

    printed_offset = TIMES[5] - 5 * (TIMES[50] - TIMES[5]) / 45
    numbers.append(
        ComparedNumber(
            "time with 50 neighbours over that with 5",
            seconds[50] / seconds[5],
            printed=TIMES[50] / TIMES[5],
            tolerance=0.5,
            smaller_is_better=True,
            why=f"ours grows with the power {power(seconds):.2g} of the neighbours, as neighbourhoods of all sizes are "
            "decomposed; the "
            f"thesis' with {power(TIMES):.2g}: {printed_offset:.2g} s of each of its times do not depend on them",
        )
    )
    figure = Figure(figsize=(6.0, 3.8), layout="constrained")
    axes = figure.subplots()
    axes.loglog(list(TIMES), list(TIMES.values()), "o-", color=RED, label="printed")
    axes.loglog(list(seconds), list(seconds.values()), "s-", color=BLUE, label="ours")
    axes.set(xlabel="largest neighbourhood [points]", ylabel="time of the edge detection [s]")
    axes.set_xticks(list(TIMES), [str(count) for count in TIMES])
    axes.set_title("time by the size of the neighbourhood", loc="left", fontsize="medium")
    axes.legend(frameon=False)
    tidy(axes)
    return ItemResult(
        numbers,
        {"times": figure},
        {"times": [{"neighbours": n, "printed": p, "ours_s": seconds[n]} for n, p in TIMES.items()]},
    )


def make_chi_threshold() -> ItemResult:
    """Figure 3.5."""
    values = (0.1, 0.6, 1.0, 1.6)
    labels = [_boundary(Parameters(chi=value)) for value in values]
    counts = _counts(labels, BOUNDARY)
    return ItemResult(
        [
            ComparedNumber(
                "boundary points at 0.1 over those at 0.6: too many",
                counts[0] / counts[1],
                expected=(1.5, np.inf),
            ),
            ComparedNumber(
                "boundary points at 1 over those at 0.6", counts[2] / counts[1], expected=(0.3, 0.95)
            ),
            ComparedNumber(
                "boundary points at 1.6 over those at 0.6: almost none",
                counts[3] / counts[1],
                expected=(0.0, 0.2),
            ),
        ],
        {"clouds": _clouds(labels, values, "chi", {BOUNDARY: RED})},
    )


def make_boundary_neighbours() -> ItemResult:
    """Figure 3.6."""
    values = (10, 35)
    labels = [_boundary(Parameters(boundary_neighbors=value)) for value in values]
    few, many = _counts(labels, BOUNDARY)
    return ItemResult(
        [
            ComparedNumber(
                "boundary points with 35 neighbours over those with 10: more",
                many / few,
                expected=(1.1, np.inf),
            )
        ],
        {"clouds": _clouds(labels, values, "neighbours", {BOUNDARY: RED})},
    )


def make_normal_tolerance() -> ItemResult:
    """Figure 3.7."""
    values = (1e-1, 1e-3, 1e-5)
    surfaces = []
    for value in values:
        parameters = Parameters(normal_tolerance=value)
        found = find_bndry_points(find_edge_points(cloud(), parameters), parameters)
        surfaces.append(surf_segm(found, parameters).of_point)
    counts = [float(len(set(each[each >= 0].tolist()))) for each in surfaces]
    figure = Figure(figsize=(max(3.2 * len(values), 7.0), 3.9), layout="constrained")
    for axes, number, value in zip(figure.subplots(1, len(values)), surfaces, values, strict=True):
        _scatter(
            axes, np.where(number < 0, GREY, np.array([f"C{k % 10}" for k in number])), f"tolerance {value:g}"
        )
    most = int(max(each.max() for each in surfaces)) + 1
    surface_colours = {f"surface {k + 1}": f"C{k}" for k in range(min(most, 10))}
    legend_below(figure, dot_handles(surface_colours | {"edge or boundary": GREY}))
    return ItemResult(
        [
            ComparedNumber(
                "surfaces at 0.1, as large a tolerance as the cube bears", counts[0], expected=(3.0, 3.0)
            ),
            ComparedNumber("surfaces at 1e-3, the value of the study", counts[1], expected=(3.0, 3.0)),
            ComparedNumber(
                "surfaces at 1e-5: many are said to be found",
                counts[2],
                expected=(4.0, np.inf),
                why=f"of the points of the surfaces at 1e-3 {_alike(surfaces[1]):.1%} have the normal of their surface "
                "within 1e-5, as "
                f"they have no noise; the others form no group of {Parameters().smallest_surface} points",
            ),
        ],
        {"clouds": figure},
    )


def _alike(numbers: Int[np.ndarray, " n"]) -> float:
    """Share of the points of all surfaces whose normals are the median one within 1e-5, signs apart."""
    normals = np.abs(find_edge_points(cloud(), Parameters()).normal)
    alike = [
        np.abs(normals[numbers == k] - np.median(normals[numbers == k], axis=0)).max(axis=1) < 1e-5
        for k in range(int(numbers.max()) + 1)
    ]
    return float(np.concatenate(alike).mean())


def _boundary(parameters: Parameters) -> Int[np.ndarray, " n"]:
    return find_bndry_points(find_edge_points(cloud(), parameters), parameters).label


def _counts(labels: Sequence[Int[np.ndarray, " n"]], kind: int) -> list[float]:
    return [float(np.count_nonzero(each == kind)) for each in labels]


def _clouds(
    labels: Sequence[Int[np.ndarray, " n"]], values: Sequence[float], name: str, colours: dict[int, str]
) -> Figure:
    """The cloud with the points of one label in colour, a panel a value."""
    figure = Figure(figsize=(max(3.2 * len(values), 7.0), 3.9), layout="constrained")
    for axes, label, value in zip(
        figure.subplots(1, len(values), squeeze=False)[0], labels, values, strict=True
    ):
        _scatter(axes, np.array([colours.get(int(each), SKY) for each in label]), f"{name} {value:g}")
    names = {EDGE: "edge", BOUNDARY: "boundary"}
    shown = {"other points": SKY} | {f"{names[kind]} points": colour for kind, colour in colours.items()}
    legend_below(figure, dot_handles(shown))
    return figure


def _scatter(axes: Axes, colours: np.ndarray, title: str) -> None:
    points = cloud()
    axes.scatter(points[:, 2], points[:, 1], c=colours.tolist(), s=6, linewidths=0)
    axes.set(title=title, xlabel="z [m]", ylabel="y [m]", aspect="equal")


PARAMETER_INFLUENCE: Final = (
    decoust_item(
        "Figure 3.3",
        "section 3.2.3",
        "Edges by the threshold of the surface variance",
        make_variance_threshold,
    ),
    decoust_item("Table 3.1", "p. 46", "Time by the size of the neighbourhood", make_edge_times, 2.0),
    decoust_item(
        "Figure 3.4", "section 3.2.3", "Edges by the size of the neighbourhood", make_edge_neighbours
    ),
    decoust_item("Figure 3.5", "section 3.3", "Boundaries by the threshold chi", make_chi_threshold, 2.0),
    decoust_item(
        "Figure 3.6", "section 3.3", "Boundaries by the size of the neighbourhood", make_boundary_neighbours
    ),
    decoust_item(
        "Figure 3.7", "section 3.4.1", "Surfaces by the tolerance of normals", make_normal_tolerance
    ),
)
