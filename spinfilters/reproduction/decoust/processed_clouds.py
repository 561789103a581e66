"""Pictures of the processing: edges, boundaries, corners and labelled edges (Table 3.2, Figures 3.8 to 3.10, 4.3 to 4.15).

The thesis prints pictures; the numbers here are what its text says of them, and what a picture of a cube must show.
"""

import time
from collections.abc import Sequence
from functools import cache, partial
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from spinfilters.lidar.mesh import TriangleMesh, box
from spinfilters.lidar.scan import LidarNoise, RayPattern
from spinfilters.plots.scene import draw_wires, equal_scales, space_figure
from spinfilters.plots.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY, tidy
from spinfilters.reproduction.decoust.cloud_features import (
    BOUNDARY,
    EDGE,
    SURFACE,
    Parameters,
    PointFeatures,
    SnapshotFeatures,
    find_bndry_points,
    find_edge_points,
    snapshot_features,
)
from spinfilters.reproduction.decoust.pose_bound import noise_free, pose_bound
from spinfilters.reproduction.decoust.snapshot_frames import (
    PLACE,
    SEQUENCES,
    ProcessedSequence,
    Sphere,
    best_fitting_sphere,
)
from spinfilters.reproduction.decoust.snapshots import corners_bound, edges_bound, sequence
from spinfilters.reproduction.item import ComparedNumber, ItemResult, decoust_item
from spinfilters.simulation.lidar_scanner import LidarSettings, Scanner, Still, thesis_rotation
from spinfilters.simulation.lidar_sequence import RANGE_NOISE, preset_of, spacecraft

WELL, BARELY = (30.0, 50.0, 0.0), (6.0, 10.0, 0.0)
"""Euler angles z, y, x, deg, in which all faces of the cube are well visible, and in which two are hardly."""
PRINTED: Final = {
    "field of view [deg]": 2.0,
    "rays in either angle": 551.0,
    "distance [m]": 500.0,
    "threshold of the surface variance": 1e-5,
    "threshold of chi": 0.8,
    "tolerance of normals": 1e-3,
    "largest neighbourhood, edges": 16.0,
    "largest neighbourhood, chi": 25.0,
    "clusters, at most": 10.0,
}
"""Table 3.2."""
EDGE_COLOURS: Final = (BLUE, PURPLE, SKY)
BOUNDARY_COLOURS: Final = (ORANGE, GREEN, SKY)
"""Of boundary corners 1 to 3, as in Figure 4.12."""
WORST: Final = 0.1
"""Error of a corner, m, from which it is a "bad corner", which the thesis leaves out of the sphere."""
Pose = tuple[float, float, float]


def make_parameters() -> ItemResult:
    """Table 3.2: the parameters that this processing has by default, and those of the preset."""
    own, pattern = Parameters(), preset_of("table-3.2").pattern
    values = (
        pattern.field_of_view[0],
        float(pattern.rays[0]),
        preset_of("table-3.2").translation[0],
        own.surface_variance,
        own.chi,
        own.normal_tolerance,
        float(own.edge_neighbors),
        float(own.boundary_neighbors),
        float(own.clusters),
    )
    rows = [
        ComparedNumber(what, ours, printed=printed, given=True)
        for (what, printed), ours in zip(PRINTED.items(), values, strict=True)
    ]
    figure = Figure(figsize=(7.5, 6.0), layout="constrained")
    axes = figure.subplots()
    draw_labels(axes, labelled(traced("cube", WELL, 551)), 3.0)
    axes.set_title("the cube at (30, 50, 0) deg by these parameters", fontsize="medium")
    axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return ItemResult(
        rows,
        {"labels": figure},
        note="The text of section 3.3 shows chi = 0.6 as the best value; the table has 0.8.",
    )


@cache
def traced(mesh: str, pose: Pose, rays: int, noise: LidarNoise | None = None) -> Float[np.ndarray, "n 3"]:
    """Points of the cube or the spacecraft at 500 m, 2 deg of view, m."""
    body: TriangleMesh = spacecraft() if mesh == "spacecraft" else box()
    settings = LidarSettings(RayPattern((2.0, 2.0), (rays, rays)), noise or LidarNoise())
    scanner = Scanner.of(body, settings)
    return scanner.scan(Still(thesis_rotation(*pose), PLACE), 0.0, np.random.default_rng(0)).points


def labelled(points: Float[np.ndarray, "n 3"]) -> PointFeatures:
    """Points with labels by the parameters of Table 3.2."""
    return find_bndry_points(find_edge_points(points, Parameters()), Parameters())


def make_spacecraft() -> ItemResult:
    """Figure 3.8: the spacecraft processed; its antenna has points taken for edge and boundary points."""
    begin = time.process_time()
    points = traced("spacecraft", BARELY, 551)
    seconds = time.process_time() - begin
    features = labelled(points)
    in_body = (points - PLACE) @ thesis_rotation(*BARELY)
    antenna = in_body[:, 2] > 2.5 + 1e-6
    rows = [
        ComparedNumber(
            f"points of the antenna taken for {name} points",
            float(np.count_nonzero(antenna & (features.label == kind))),
            expected=(1.0, np.inf),
        )
        for name, kind in (("edge", EDGE), ("boundary", BOUNDARY))
    ]
    rows += [
        ComparedNumber(
            "share of surface points on panels and box",
            float(np.mean(features.label[~antenna] == SURFACE)),
            expected=(0.5, 1.0),
        ),
        ComparedNumber(
            "time of the ray tracing, about five minutes",
            seconds,
            printed=300.0,
            unit="s",
            tolerance=30.0,
            smaller_is_better=True,
        ),
    ]
    figure = Figure(figsize=(7.5, 7.0), layout="constrained")
    axes = figure.add_subplot()
    draw_labels(axes, features, 1.0)
    axes.set_title("spacecraft at 500 m, 551 x 551 rays over 2 deg", fontsize="medium")
    axes.legend(frameon=False, loc="upper right", markerscale=4)
    return ItemResult(
        rows, {"labels": figure}, note="The drawing has no legible dimension; the spacecraft is our own."
    )


def draw_labels(axes: Axes, features: PointFeatures, size: float) -> None:
    """Points as the lidar sees them: surface (circles), edge (squares), boundary (triangles)."""
    for kind, name, colour, marker in (
        (SURFACE, "surface", GREY, "o"),
        (EDGE, "edge", BLUE, "s"),
        (BOUNDARY, "boundary", PURPLE, "^"),
    ):
        own = features.points[features.label == kind]
        axes.scatter(
            own[:, 2], own[:, 1], s=size * (1.0 if kind == SURFACE else 4.0), c=colour, marker=marker,
            linewidths=0, label=f"{name}: {len(own)}",
        )  # fmt: skip
    axes.set(xlabel="z [m]", ylabel="y [m]", aspect="equal")
    tidy(axes)


def make_resolution(pose: Pose, well: bool) -> ItemResult:
    """Figures 3.9 and 3.10: the cube by 501 and by 1001 rays."""
    clouds = [traced("cube", pose, rays) for rays in (501, 1001)]
    features = [labelled(points) for points in clouds]
    hidden = [_points_of_hidden_faces(points, pose) for points in clouds]
    shares = [float(np.mean(f.label[h] == SURFACE)) for f, h in zip(features, hidden, strict=True)]
    rows = [
        ComparedNumber(
            "points at 1001 rays over those at 501",
            len(clouds[1]) / len(clouds[0]),
            expected=(0.95 * (1000 / 500) ** 2, 1.05 * (1000 / 500) ** 2),
        ),
        ComparedNumber(
            "surface points of the two least visible faces, 1001 rays over 501: more with resolution",
            shares[1] / max(shares[0], 1e-9),
            expected=(1.0, np.inf),
        ),
        ComparedNumber(
            "share of surface points on these faces, 501 rays: "
            + ("fine" if well else "not very good results"),
            shares[0],
            expected=(0.7, 1.0) if well else (0.0, 0.7),
        ),
    ]
    figure = Figure(figsize=(10.0, 6.8), layout="constrained")
    for axes, found, rays in zip(figure.subplots(1, 2), features, (501, 1001), strict=True):
        draw_labels(axes, found, 6.0 * (501 / rays) ** 2)
        axes.set_title(f"cube at {pose} deg, {rays} x {rays} rays", fontsize="medium")
        axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(0.0, -0.2), ncols=2, fontsize="small")
    return ItemResult(rows, {"labels": figure})


def _points_of_hidden_faces(points: Float[np.ndarray, "n 3"], pose: Pose) -> np.ndarray:
    """Rows of points on the cube's faces other than the one with the most points."""
    face = np.abs((points - PLACE) @ thesis_rotation(*pose)).argmax(axis=1)
    return np.flatnonzero(face != np.bincount(face, minlength=3).argmax())


def make_corners(poses_with_noise: Sequence[Pose] = SEQUENCES[0]) -> ItemResult:
    """Figure 4.3, and the text: the corner is exact to 1e-10, and with noise to 1e-7."""
    poses = {"well visible": WELL, "two faces barely visible": BARELY}
    found = {name: snapshot_features(traced("cube", pose, 551), Parameters()) for name, pose in poses.items()}
    noisy = [
        snapshot_features(traced("cube", pose, 551, RANGE_NOISE), Parameters()) for pose in poses_with_noise
    ]
    errors = {
        name: np.inf if each is None else _corner_error(each, poses[name]) for name, each in found.items()
    }
    kept = [
        _corner_error(each, pose)
        for each, pose in zip(noisy, poses_with_noise, strict=True)
        if each is not None
    ]
    rows = [
        ComparedNumber(
            "error of the corner, all faces well visible",
            errors["well visible"],
            printed=1e-10,
            unit="m",
            tolerance=9e-11,
            smaller_is_better=True,
            why=f"normals of exact points are exact to rounding, {np.finfo(float).eps:.1g}",
            bound=noise_free(_corner_bound(WELL), "m"),
        ),
        ComparedNumber(
            "error of the corner, two faces barely visible: works well",
            errors["two faces barely visible"],
            expected=(0.0, 1e-3),
            unit="m",
            bound=noise_free(_corner_bound(BARELY), "m"),
        ),
        ComparedNumber(
            "least error of the corner with range noise of 0.01 m (3 sigma)",
            min(kept, default=np.inf),
            printed=1e-7,
            unit="m",
            bound=min(_corner_bound(pose) for pose in poses_with_noise),
            smaller_is_better=True,
            why=f"{len(noisy) - len(kept)} of {len(noisy)} snapshots lose a surface; noise of 3.3 mm among rays 32 mm apart "
            f"gives {min(kept, default=np.inf):.2g} m, so that 1e-7 m would take noise of "
            f"{1e9 * RANGE_NOISE.range_std * 1e-7 / min(kept, default=np.inf):.1g} nm",
        ),
    ]
    figure = Figure(figsize=(10.0, 7.2), layout="constrained")
    for axes, (name, each) in zip(figure.subplots(1, 2), found.items(), strict=True):
        if each is not None:
            draw_labels(axes, each.surfaces.features, 6.0)
            axes.plot(each.corner[2], each.corner[1], "o", color=GREEN, markersize=9, label="corner")
        axes.set_title(f"{name}: error {errors[name]:.1e} m", fontsize="medium")
        axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(0.0, -0.24), ncols=2, fontsize="small")
    return ItemResult(rows, {"corners": figure})


def _corner_bound(pose: Pose) -> float:
    """Least deviation of the corner next to the lidar with the noise of Figure 2.11, m."""
    corners = box().vertices @ thesis_rotation(*pose).T
    nearest = corners[np.linalg.norm(corners + PLACE, axis=1).argmin()]
    return pose_bound(traced("cube", pose, 551), pose).of_point(nearest)


def _corner_error(found: SnapshotFeatures, pose: Pose) -> float:
    """Distance of the corner from the nearest vertex of the cube, m."""
    vertices = box().vertices @ thesis_rotation(*pose).T + PLACE
    return float(np.linalg.norm(vertices - found.corner, axis=1).min())


def make_edges() -> ItemResult:
    """Figure 4.5: labelled edges of six snapshots."""
    found, shown = sequence(0), (0, 2, 4, 6, 8, 10)
    figure = Figure(figsize=(10.0, 7.4), layout="constrained")
    labelled_edges, lengths = [], []
    for axes, k in zip(figure.subplots(2, 3).ravel(), shown, strict=True):
        each = found.snapshots[k]
        axes.set_title(f"snapshot {k + 1}: {SEQUENCES[0][k]} deg", fontsize="medium")
        if each is None:
            continue
        points = each.surfaces.features.points
        axes.scatter(points[:, 2], points[:, 1], s=1.5, c=GREY, linewidths=0)
        for edge, colour in zip(each.edges, EDGE_COLOURS, strict=True):
            axes.scatter(edge[:, 2], edge[:, 1], s=10, c=colour, linewidths=0)
        axes.plot(each.corner[2], each.corner[1], "o", color=GREEN, markersize=7)
        axes.set(xlabel="z [m]", ylabel="y [m]", aspect="equal")
        tidy(axes)
        labelled_edges.append(sum(len(edge) > 0 for edge in each.edges))
        lengths += [np.linalg.norm(corner - each.corner) for corner in each.boundary_corners]
    rows = [
        ComparedNumber(
            "labelled edges of every snapshot, fewest", float(min(labelled_edges)), expected=(3.0, 3.0)
        ),
        ComparedNumber(
            "length of a labelled edge of the cube of 1 m, median",
            float(np.median(lengths)),
            expected=(0.9, 1.05),
            unit="m",
            bound=edges_bound(found),
        ),
    ]
    return ItemResult(rows, {"edges": figure})


def make_positions() -> ItemResult:
    """Figure 4.6: theoretical and measured corners over the attitudes (3 to 45, 5 to 75, 0) deg."""
    found = sequence(0)
    axes_figure = Figure(figsize=(7.0, 6.4), layout="constrained")
    axes = axes_figure.add_subplot()
    for points, colour, label in (
        (found.corners, PURPLE, "corner"),
        (found.boundary_corners[:, 0], BLUE, "boundary corner"),
        *((found.boundary_corners[:, k], BLUE, None) for k in (1, 2)),
    ):
        true = found.nearest_vertices(points)
        axes.plot(true[:, 2], true[:, 1], "o", color=colour, markersize=5, label=label and f"{label}, true")
        axes.plot(
            points[:, 2], points[:, 1], "D", color=colour, markerfacecolor="none", markersize=9,
            label=label and f"{label}, measured",
        )  # fmt: skip
    axes.set(xlabel="z [m]", ylabel="y [m]", aspect="equal", title="corners of the first sequence")
    axes.legend(frameon=False)
    tidy(axes)
    corner = np.linalg.norm(found.errors(found.corners), axis=1)
    boundary = np.concatenate(
        [np.linalg.norm(found.errors(found.boundary_corners[:, k]), axis=1) for k in range(3)]
    )
    return ItemResult(
        [
            ComparedNumber(
                "largest distance of a corner from its true place: no difference in the picture",
                float(np.nanmax(corner)),
                expected=(0.0, 0.01),
                unit="m",
                bound=corners_bound(found, "m"),
            ),
            ComparedNumber(
                "median distance of a boundary corner: a few rays",
                float(np.nanmedian(boundary)),
                expected=(0.005, 0.1),
                unit="m",
                bound=corners_bound(found, "m"),
            ),
        ],
        {"positions": axes_figure},
    )


def make_sphere() -> ItemResult:
    """Figure 4.8: the sphere through the corners."""
    found = sequence(0)
    points = found.corners[:12]
    points = points[np.isfinite(points).all(axis=1)]
    sphere = best_fitting_sphere(points)
    off = np.abs(np.linalg.norm(points - sphere.centre, axis=1) - sphere.radius)
    without = best_fitting_sphere(points[1:]).radius
    first = 1000 * float(np.linalg.norm(found.errors(found.corners)[0]))
    rows = [
        ComparedNumber(
            "largest distance of a fitted corner from the sphere",
            float(off.max()),
            expected=(0.0, 1e-3),
            unit="m",
            bound=corners_bound(found, "m"),
        ),
        ComparedNumber(
            "radius of the sphere",
            1000 * sphere.radius,
            printed=866.02,
            unit="mm",
            tolerance=0.05,
            bound=corners_bound(found, "mm"),
            why=f"the first corner, of barely visible faces, is {first:.2g} mm off, and "
            f"the fit amplifies errors {sphere.amplification:.2g} times; without it the radius is {1000 * without:.2f} mm",
        ),
    ]
    return ItemResult(rows, {"sphere": _corners_figure(found, sphere)})


def make_sequence(number: int) -> ItemResult:
    """Figures 4.12 and 4.15: attitudes of a sequence, and its corners in space."""
    found, attitudes = sequence(number), SEQUENCES[number]
    steps = np.diff(np.array(attitudes), axis=0)
    errors = np.linalg.norm(found.errors(found.corners), axis=1)
    first = ((6.0, 10.0, 0.0), (111.0, 185.0, 0.0))[number]
    rows = [
        ComparedNumber("snapshots", float(len(attitudes)), printed=(14.0, 16.0)[number], given=True),
        *(
            ComparedNumber(f"first attitude, {axis}", ours, printed=printed, unit="deg", given=True)
            for axis, ours, printed in zip("zyx", attitudes[0], first, strict=True)
        ),
        ComparedNumber("step about z", float(steps[:, 0].mean()), printed=3.0, unit="deg", given=True),
        ComparedNumber("step about y", float(steps[:, 1].mean()), printed=5.0, unit="deg", given=True),
        ComparedNumber(
            "largest distance of a corner from its true place, bad ones left out",
            1000 * float(errors[errors < WORST].max()),
            expected=(0.0, 1.0),
            unit="mm",
            bound=corners_bound(found, "mm"),
            why=f"{len(errors) - int(np.count_nonzero(errors < WORST))} of {len(errors)} snapshots are left out",
        ),
    ]
    table = [
        {"t": k + 1, "z_deg": pose[0], "y_deg": pose[1], "x_deg": pose[2]} for k, pose in enumerate(attitudes)
    ]
    sphere = best_fitting_sphere(found.corners[errors < WORST])
    left_out = len(errors) - int(np.count_nonzero(errors < WORST))
    return ItemResult(
        rows,
        {"corners": _corners_figure(found, sphere)},
        {"attitudes": table},
        note=f"{left_out} snapshots without a corner, or with one that is {WORST:g} m off or more, are left out of the sphere.",
    )


def _corners_figure(found: ProcessedSequence, sphere: Sphere) -> Figure:
    """Corners, boundary corners and the fitted sphere in space, m about the true centre."""
    figure, axes = space_figure(7.0, 6.4)
    draw_wires(axes, np.full(3, sphere.radius), GREY)
    boundary = [(found.boundary_corners[:, k], f"boundary corner {k + 1}") for k in range(3)]
    for (points, name), colour in zip(
        ((found.corners, "corner"), *boundary), (PURPLE, *BOUNDARY_COLOURS), strict=True
    ):
        shown = (points - PLACE)[:, [0, 2, 1]]
        shown = shown[np.linalg.norm(shown, axis=1) < 1.2 * sphere.radius]
        axes.plot(*shown.T, "o", color=colour, markersize=5, label=name, zorder=4)
    axes.plot(
        *(sphere.centre - PLACE)[[0, 2, 1]], "+", color=RED, markersize=12, label="fitted centre", zorder=5
    )
    equal_scales(axes, sphere.radius * np.array([[-1.0, -1, -1], [1, 1, 1]]))
    axes.set(xlabel="x - 500 [m]", ylabel="z [m]", zlabel="y [m]")
    axes.view_init(elev=20, azim=-150)
    axes.set_title("corners about the centre of rotation", fontsize="medium", color=BLACK)
    axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(-0.1, 1.0))
    return figure


PROCESSED_CLOUDS: Final = (
    decoust_item("Table 3.2", "p. 53", "Parameters of the processing", make_parameters),
    decoust_item("Figure 3.8", "section 3.5.1", "Spacecraft processed", make_spacecraft, 2.0),
    decoust_item(
        "Figure 3.9",
        "section 3.5.2",
        "Resolution where all faces are well visible",
        partial(make_resolution, WELL, True),
        1.0,
    ),
    decoust_item(
        "Figure 3.10",
        "section 3.5.2",
        "Resolution where two faces are barely visible",
        partial(make_resolution, BARELY, False),
        1.0,
    ),
    decoust_item(
        "Figure 4.3",
        "section 4.1.1",
        "Corners, without noise and with",
        make_corners,
        5.0,
        partial(make_corners, SEQUENCES[0][:3]),
    ),
    decoust_item("Figure 4.5", "section 4.1.2", "Labelled edges", make_edges, 2.0),
    decoust_item("Figure 4.6", "section 4.1.4", "Theoretical and measured corners", make_positions, 2.0),
    decoust_item("Figure 4.8", "section 4.2.2", "Sphere through the corners", make_sphere, 2.0),
    decoust_item(
        "Figure 4.12", "section 4.4", "Attitudes and corners, first sequence", partial(make_sequence, 0), 2.0
    ),
    decoust_item(
        "Figure 4.15", "section 4.4", "Attitudes and corners, second sequence", partial(make_sequence, 1), 2.0
    ),
)
