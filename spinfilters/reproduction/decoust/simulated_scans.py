"""Chapter 2: the simulated lidar, its meshes, rays, windows and errors (Tables 2.1, 2.2, Figures 2.5 to 2.18, B.1).

The thesis prints renderings without numbers. What its text and tables state is compared: places, counts of rays, deviations. The
spacecraft's drawing (appendix A) has no legible dimension, and the complex shape of Figure B.1 is not named; both are our own.
"""

import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from spinfilters.io.output_files import write_text
from spinfilters.lidar.mesh import TriangleMesh, box, mass_properties, read_mesh
from spinfilters.lidar.scan import RayPattern, Scan, rvs_noise
from spinfilters.plots.measurement_figures import scan_figure
from spinfilters.plots.scene import equal_scales, space_figure
from spinfilters.plots.style import BLACK, BLUE, GREEN, GREY, ORANGE, RED, legend_below, tidy
from spinfilters.reproduction.item import ComparedNumber, ItemResult, decoust_item
from spinfilters.simulation.lidar_scanner import LidarSettings, Scanner, Still, thesis_rotation
from spinfilters.simulation.lidar_sequence import (
    ANGLE_NOISE,
    PRESETS,
    RANGE_NOISE,
    mesh_of,
    preset_of,
    spacecraft,
)

INPUTS: Final = {
    "figure-2.12": (4.0, 301, (6.0, 10.0, 0.0), 500.0),
    "figure-2.13": (4.0, 501, (45.0, 20.0, 0.0), 500.0),
    "figure-2.14": (40.0, 70, (45.0, 20.0, 0.0), 3.0),
    "figure-2.15": (40.0, 70, (45.0, 20.0, 0.0), 3.0),
    "figure-2.16": (40.0, 70, (45.0, 20.0, 0.0), 3.0),
    "figure-2.17": (40.0, 70, (45.0, 20.0, 0.0), 3.0),
}
"""Table 2.2: field of view in deg, rays in either angle, Euler angles z, y, x in deg, distance along x in m."""
WINDOWS: Final = (((20.0, 14.0), (25.0, 5.0)), ((5.0, 8.0), (1.0, 6.0)))
"""Table 2.1: of each window start and span in elevation, then in azimuth, deg."""
DRAWN: Final = 3000
"""Triangles of a picture."""


def make_mesh() -> ItemResult:
    """Figure 2.5: the facets of the spacecraft, written and read again in the thesis' format."""
    mesh = spacecraft()
    again = _through_stl(mesh)
    return ItemResult(
        [*_reader_rows(mesh, again)],
        {"mesh": _mesh_figure([again], [GREY], "facets of the spacecraft")},
        note="The dimensions of the thesis' drawing are not legible; the spacecraft is our own: box, two panels, antenna.",
    )


def make_complex_mesh() -> ItemResult:
    """Figure B.1: the STL reader on a complex shape, here a trefoil knot whose volume is known."""
    mesh = trefoil_tube()
    again = _through_stl(mesh)
    return ItemResult(
        [*_reader_rows(mesh, again)],
        {"mesh": _mesh_figure([again], [BLUE], f"a trefoil knot of {len(mesh.triangles)} facets")},
        note="The thesis does not name its complex shape; a trefoil knot stands in its place.",
    )


def _reader_rows(mesh: TriangleMesh, again: TriangleMesh) -> list[ComparedNumber]:
    """What a reader must not change: facets, volume, closed edges."""
    before, after = mass_properties(mesh).volume, mass_properties(again).volume
    return [
        ComparedNumber(
            "facets that were read, of those written",
            len(again.triangles) / len(mesh.triangles),
            expected=(1.0, 1.0),
        ),
        ComparedNumber("edges that do not join two facets", again.open_edges, expected=(0.0, 0.0)),
        ComparedNumber(
            "volume that was read over the one written", after / before, expected=(1 - 1e-6, 1 + 1e-6)
        ),
    ]


def trefoil_tube(steps: int = 240, sides: int = 24, radius: float = 0.35) -> TriangleMesh:
    """A closed tube along a trefoil knot, m."""
    s = np.linspace(0.0, 2 * np.pi, steps, endpoint=False)
    path = np.stack([np.sin(s) + 2 * np.sin(2 * s), np.cos(s) - 2 * np.cos(2 * s), -np.sin(3 * s)], axis=1)
    along = np.stack(
        [np.cos(s) + 4 * np.cos(2 * s), -np.sin(s) + 4 * np.sin(2 * s), -3 * np.cos(3 * s)], axis=1
    )
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(along, path)  # never parallel to this knot's tangent
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    third = np.cross(along, across)
    angle = np.linspace(0.0, 2 * np.pi, sides, endpoint=False)
    ring = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * third[:, None]
    vertices = (path[:, None] + radius * ring).reshape(-1, 3)
    k, j = np.meshgrid(np.arange(steps), np.arange(sides), indexing="ij")
    here, beside = (k * sides + j).ravel(), (k * sides + (j + 1) % sides).ravel()
    next_k = (k + 1) % steps
    there, over = (next_k * sides + j).ravel(), (next_k * sides + (j + 1) % sides).ravel()
    # counterclockwise seen from outside: the ring runs from "across" to "along x across"
    triangles = np.concatenate(
        [np.stack([here, over, there], axis=1), np.stack([here, beside, over], axis=1)]
    )
    return TriangleMesh(vertices, triangles, "a trefoil knot")


def _through_stl(mesh: TriangleMesh) -> TriangleMesh:
    """A mesh written in the format of appendix B.1 and read again."""
    lines = ["solid mesh"]
    for normal, corners in zip(mesh.normals, mesh.corners, strict=True):
        lines += [f"facet normal {_numbers(normal)}", " outer loop"]
        lines += [f"  vertex {_numbers(corner)}" for corner in corners]
        lines += [" endloop", "endfacet"]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mesh.stl"
        write_text(path, "\n".join([*lines, "endsolid mesh", ""]))
        return read_mesh(path)


def _numbers(values: Float[np.ndarray, "3"]) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def make_moved_cube() -> ItemResult:
    """Figure 2.6: the cube rotated by 45 deg about z and translated by (1500, 1000, 0) mm."""
    cube, place = box(), np.array([1.5, 1.0, 0.0])
    moved = cube.moved(thesis_rotation(45.0, 0.0, 0.0), place)
    centre = 1000.0 * moved.vertices.mean(axis=0)
    edge = moved.vertices[4] - moved.vertices[0]  # the edge along x of the cube
    angle = float(np.degrees(np.arctan2(edge[1], edge[0])))
    rows = [
        ComparedNumber(
            f"centre of the moved cube, {axis}",
            float(ours),
            printed=printed,
            unit="mm",
            tolerance=0.5,
            given=True,
        )
        for axis, ours, printed in zip("xyz", centre, (1500.0, 1000.0, 0.0), strict=True)
    ]
    rows.append(
        ComparedNumber(
            "rotation of an edge about z", angle, printed=45.0, unit="deg", tolerance=0.5, given=True
        )
    )
    figure = _mesh_figure(
        [cube, moved], [GREEN, ORANGE], "the cube about the lidar (green), moved and rotated (yellow)"
    )
    return ItemResult(rows, {"cubes": figure})


def make_windows() -> ItemResult:
    """Table 2.1: where the two windows lie in the field of view, counted from its corner and from its axis."""
    corner, axis = _shares_inside(25.0), _shares_inside(0.0)
    rows = [
        ComparedNumber(
            f"share of window {k + 1} within the field, counted from its corner", share, expected=(1.0, 1.0)
        )
        for k, share in enumerate(corner)
    ]
    note = (
        "The starts are counted from the corner of the field: counted from its axis, as the angles of the rays are, "
        f"{axis[0]:.0%} of the first window would lie within the field of +-25 deg, and {axis[1]:.0%} of the second. The window of "
        "Figure 2.15 (5.5 and 9 deg, spans of 12.5 and 16 deg) reaches 5 deg beyond the field of +-20 deg when counted from the "
        "axis, and not when counted from the corner."
    )
    table = [
        {
            "window": k + 1,
            "elevation_start_deg": elevation[0],
            "elevation_span_deg": elevation[1],
            "azimuth_start_deg": azimuth[0],
            "azimuth_span_deg": azimuth[1],
            "inside_from_corner": corner[k],
            "inside_from_axis": axis[k],
        }
        for k, (elevation, azimuth) in enumerate(WINDOWS)
    ]
    return ItemResult(rows, {"windows": _windows_figure()}, {"windows": table}, note=note)


def _shares_inside(origin: float) -> list[float]:
    """Share of each window in the field of 50 by 50 deg, with starts counted ``origin`` deg before its axis."""
    shares = []
    for window in WINDOWS:
        share = 1.0
        for start, span in window:
            low, high = max(start - origin, -25.0), min(start - origin + span, 25.0)
            share *= max(high - low, 0.0) / span
        shares.append(share)
    return shares


def make_rays() -> ItemResult:
    """Figure 2.8: directions of rays without windows and with two."""
    pattern = preset_of("table-2.1").pattern
    plain = RayPattern(pattern.field_of_view, pattern.rays)
    figure = Figure(figsize=(11.0, 6.0), layout="constrained")
    counts = []
    for axes, each, title in zip(
        figure.subplots(1, 2), (plain, pattern), ("without windows", "with two windows"), strict=True
    ):
        rays = each.directions()
        for number, colour in enumerate((GREY, BLUE, RED)):
            own = rays.window == number
            if own.any():
                label = f"window {number}" if number else "field"
                axes.plot(
                    np.rad2deg(rays.azimuth[own]) + 25.0,
                    np.rad2deg(rays.elevation[own]) + 25.0,
                    "o",
                    color=colour,
                    markersize=4,
                    label=label,
                )
        if each is pattern:
            for k, ((e, de), (a, da)) in enumerate(WINDOWS):
                frame = np.array([[a, e], [a + da, e], [a + da, e + de], [a, e + de], [a, e]])
                axes.plot(*frame.T, color=BLACK, linewidth=0.8, label=None if k else "windows of Table 2.1")
        axes.set(
            xlabel="azimuth from the corner [deg]",
            ylabel="elevation from the corner [deg]",
            title=title,
            aspect="equal",
        )
        tidy(axes)
        counts.append(rays)
    legend_below(figure, figure.axes[-1].get_legend_handles_labels()[0])
    inside = counts[1].window == 1
    density = len(np.unique(counts[1].azimuth[inside])) - 1
    steps = [np.diff(grid)[0] for grid in pattern.grid]
    rows = [
        ComparedNumber(
            "step between rays in azimuth",
            float(np.rad2deg(steps[0])),
            printed=5.0,
            unit="deg",
            tolerance=1e-6,
            given=True,
        ),
        ComparedNumber(
            "step between rays in elevation",
            float(np.rad2deg(steps[1])),
            printed=10.0,
            unit="deg",
            tolerance=1e-6,
            given=True,
        ),
        ComparedNumber("steps in a window for one of the field", float(density), printed=2.0, given=True),
    ]
    note = (
        "The resolutions 5 and 10 are taken as degrees between rays. As numbers of rays, which Table 2.2 has, steps would be "
        "12.5 and 5.6 deg, and windows of 5 and 6 deg in azimuth hold no second ray."
    )
    return ItemResult(rows, {"rays": figure}, note=note)


def make_specification() -> ItemResult:
    """Figure 2.11: errors of Jena-Optronik's RVS, as 3-sigma figures."""
    short, long = rvs_noise(biased=True), rvs_noise(long_range=True, biased=True)
    rows = [
        ComparedNumber(what, float(ours), printed=printed, unit=unit, tolerance=1e-9, given=True)
        for what, ours, printed, unit in (
            ("azimuth, 3 sigma, typical", 3 * np.rad2deg(short.azimuth_std), 0.01, "deg"),
            ("elevation, 3 sigma, typical", 3 * np.rad2deg(short.elevation_std), 0.02, "deg"),
            ("bias of the line of sight", np.rad2deg(short.azimuth_bias), 0.1, "deg"),
            ("range, 3 sigma, short range", 3 * short.range_std, 0.01, "m"),
            ("range, 3 sigma, long range", 3 * long.range_std, 0.1, "m"),
            ("bias of the range, short range", short.range_bias, 0.01, "m"),
            ("bias of the range, long range", long.range_bias, 0.5, "m"),
        )
    ]
    return ItemResult(
        rows,
        {"ranges": _range_errors_figure()},
        note="Eq. 2.6 divides 0.1 by three, the long-range figure, where the text takes the short-range one.",
    )


def make_inputs() -> ItemResult:
    """Table 2.2: the inputs of Figures 2.12 to 2.17, as the presets have them."""
    rows, table = [], []
    for name, (view, rays, rotation, distance) in INPUTS.items():
        preset = PRESETS[name]
        found = (preset.pattern.field_of_view[0], preset.pattern.rays[0], preset.translation[0])
        for what, ours, printed, unit in (
            ("field of view", found[0], view, "deg"),
            ("rays in either angle", float(found[1]), float(rays), ""),
            ("distance", found[2], distance, "m"),
        ):
            rows.append(ComparedNumber(f"{name}, {what}", ours, printed=printed, unit=unit, given=True))
        for axis, ours, printed in zip("zyx", preset.rotation, rotation, strict=True):
            rows.append(
                ComparedNumber(f"{name}, angle about {axis}", ours, printed=printed, unit="deg", given=True)
            )
        table.append(
            {
                "figure": name.removeprefix("figure-"),
                "field_deg": view,
                "rays": rays,
                "z_deg": rotation[0],
                "y_deg": rotation[1],
                "x_deg": rotation[2],
                "x_m": distance,
            }
        )
    return ItemResult(
        rows,
        {"spacings": _inputs_figure()},
        {"inputs": table},
        note='The columns headed "Az. Res. Degree" and "El. Res. Degree" hold numbers of rays.',
    )


def make_scan(
    name: str, rows: Callable[[Scan, Float[np.ndarray, "n 3"]], list[ComparedNumber]]
) -> ItemResult:
    """A point cloud of Figures 2.12 to 2.18, with what the text says of it.

    Parameters
    ----------
    rows : callable
        Numbers of the scan and of its points in the frame of the mesh, m.
    """
    preset = preset_of(name)
    R, t = thesis_rotation(*preset.rotation), np.array(preset.translation)
    scanner = Scanner.of(mesh_of(preset.body), LidarSettings(preset.pattern, preset.noise))
    scan = scanner.scan(Still(R, t), 0.0, np.random.default_rng(0))
    title = f"{preset.body}, rotated by {preset.rotation} deg, at {preset.translation[0]:g} m"
    return ItemResult(rows(scan, (scan.points - t) @ R), {"scan": scan_figure(scan, title)})


def _spacecraft_rows(scan: Scan, points: Float[np.ndarray, "n 3"]) -> list[ComparedNumber]:
    """Body, panels and antenna are seen, and rays are as many as stated."""
    panel, antenna = np.abs(points[:, 1]) > 2.0 - 1e-6, points[:, 2] > 2.5 + 1e-6
    return [
        ComparedNumber("rays in either angle", float(np.sqrt(len(scan))), expected=(301.0, 501.0)),
        ComparedNumber("share of the points on panels", float(np.mean(panel)), expected=(0.05, 0.95)),
        ComparedNumber("points on the antenna", float(np.count_nonzero(antenna)), expected=(3.0, np.inf)),
        ComparedNumber(
            "share of the points on the box", float(np.mean(~panel & ~antenna)), expected=(0.05, 0.95)
        ),
    ]


def _cube_rows(_: Scan, points: Float[np.ndarray, "n 3"]) -> list[ComparedNumber]:
    """Three faces of the cube, exactly."""
    off = _off_surface(points)
    return [
        ComparedNumber("faces with points", float(len(_faces_seen(points))), expected=(3.0, 3.0)),
        ComparedNumber(
            "largest distance of a point from the cube's surface",
            float(off.max()),
            expected=(0.0, 1e-9),
            unit="m",
        ),
    ]


def _window_rows(scan: Scan, points: Float[np.ndarray, "n 3"]) -> list[ComparedNumber]:
    """Three faces of the cube, and a window with twice as many rays in either angle."""
    return [*_cube_rows(scan, points), *_density_rows(scan)]


def _density_rows(scan: Scan) -> list[ComparedNumber]:
    """Twice as many rays in either angle within the window, which lies on the cube."""
    dense = scan.window == 1
    azimuth, elevation = scan.azimuth[dense], scan.elevation[dense]
    step = np.deg2rad(40.0) / 69
    inside = round(np.ptp(azimuth) / step) * round(np.ptp(elevation) / step)
    return [
        ComparedNumber(
            "rays of the window in either angle over those of the field there",
            float(np.sqrt(np.count_nonzero(dense) / inside)),
            printed=2.0,
            tolerance=0.1,
            given=True,
        ),
        ComparedNumber(
            "share of the window's rays that meet the cube",
            float(np.mean(scan.is_return[dense])),
            expected=(0.5, 1.0),
        ),
    ]


def _range_rows(_: Scan, points: Float[np.ndarray, "n 3"]) -> list[ComparedNumber]:
    """Range noise of 0.01 m (3 sigma) does not produce visible change."""
    return [
        ComparedNumber(
            "range noise, 3 sigma",
            3 * RANGE_NOISE.range_std,
            printed=0.01,
            unit="m",
            tolerance=1e-9,
            given=True,
        ),
        ComparedNumber(
            "RMS distance of the points from the surface over the cube's side: not visible",
            float(np.sqrt(np.mean(_off_surface(points) ** 2))),
            expected=(0.0, 0.005),
        ),
    ]


def _angle_rows(scan: Scan, points: Float[np.ndarray, "n 3"]) -> list[ComparedNumber]:
    """Angles have more impact, says the text; at 3 m they displace points less than the range noise does."""
    grid = np.deg2rad(40.0) / 69
    bent = scan.elevation[scan.is_return] / grid
    shift = 3.0 * ANGLE_NOISE.elevation_std
    return [
        ComparedNumber(
            "noise of the azimuth, 3 sigma",
            3 * float(np.rad2deg(ANGLE_NOISE.azimuth_std)),
            printed=0.01,
            unit="deg",
            tolerance=1e-9,
            given=True,
        ),
        ComparedNumber(
            "noise of the elevation, 3 sigma",
            3 * float(np.rad2deg(ANGLE_NOISE.elevation_std)),
            printed=0.02,
            unit="deg",
            tolerance=1e-9,
            given=True,
        ),
        ComparedNumber(
            "RMS departure of rows of rays from straight lines, in rays",
            float(np.std(bent - (np.rint(bent - 0.5) + 0.5))),
            expected=(0.0, 0.05),
        ),
        ComparedNumber(
            "displacement by the angles over that by the range noise: more impact, says the text",
            shift / RANGE_NOISE.range_std,
            expected=(1.0, np.inf),
            why=f"0.02 deg at 3 m are {3 * shift * 1000:.1f} mm, the range noise is 10 mm along the beam (both 3 sigma), and the "
            "two are equal at 29 m; a picture from the side of the lidar shows only what lies across the beam",
        ),
    ]


def _both_rows(scan: Scan, points: Float[np.ndarray, "n 3"]) -> list[ComparedNumber]:
    """Noise of range and angles, and the window."""
    return [*_range_rows(scan, points), *_density_rows(scan)]


def _off_surface(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Distances of points from the nearest face of the unit cube, m."""
    return np.abs(np.abs(points).max(axis=1) - 0.5)


def _faces_seen(points: Float[np.ndarray, "n 3"]) -> set[tuple[int, float]]:
    """Faces (axis, side) of the unit cube with ten points or more."""
    axis: Int[np.ndarray, " n"] = np.abs(points).argmax(axis=1)
    side = np.sign(points[np.arange(len(points)), axis])
    pairs, counts = np.unique(np.stack([axis, side], axis=1), axis=0, return_counts=True)
    return {(int(a), float(s)) for (a, s), count in zip(pairs, counts, strict=True) if count >= 10}


def _windows_figure() -> Figure:
    """Both windows in the field of view, counted from its corner and from its axis."""
    figure = Figure(figsize=(10.0, 5.2), layout="constrained")
    for axes, (words, origin) in zip(
        figure.subplots(1, 2), (("the corner of the field", 25.0), ("its axis", 0.0)), strict=True
    ):
        axes.plot([-25, 25, 25, -25, -25], [-25, -25, 25, 25, -25], color=BLACK, label="field of 50 x 50 deg")
        for number, (((e, de), (a, da)), colour) in enumerate(zip(WINDOWS, (BLUE, RED), strict=True), 1):
            corner = (a - origin, e - origin)
            axes.add_patch(Rectangle(corner, da, de, color=colour, alpha=0.5, label=f"window {number}"))
        axes.set(xlim=(-30, 35), ylim=(-30, 40), xlabel="azimuth [deg]", ylabel="elevation [deg]")
        axes.set(title=f"starts counted from {words}", aspect="equal")
        tidy(axes)
    legend_below(figure, figure.axes[0].get_legend_handles_labels()[0])
    return figure


def _range_errors_figure() -> Figure:
    """What the figures of the specification do to a point over its distance, 3 sigma, along and across the beam."""
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    distance = np.geomspace(1.0, 1000.0, 50)
    for (name, noise), colour in zip(
        (("short range", rvs_noise(biased=True)), ("long range", rvs_noise(long_range=True, biased=True))),
        (BLUE, RED),
        strict=True,
    ):
        axes.axhline(3 * noise.range_std, color=colour, label=f"along the beam, {name}")
        axes.axhline(noise.range_bias, color=colour, linestyle=":", label=f"bias along the beam, {name}")
    short = rvs_noise(biased=True)
    for name, angle, style in (
        ("azimuth", 3 * short.azimuth_std, "-"),
        ("elevation", 3 * short.elevation_std, "--"),
        ("bias of the line of sight", short.azimuth_bias, ":"),
    ):
        axes.loglog(
            distance, distance * angle, color=GREEN, linestyle=style, label=f"across the beam, {name}"
        )
    axes.set(xlabel="distance [m]", ylabel="error of a point, 3 sigma [m]")
    axes.set_title("errors of the RVS", loc="left", fontsize="medium")
    axes.legend(frameon=False, fontsize="small")
    tidy(axes)
    return figure


def _inputs_figure() -> Figure:
    """Distance between neighbouring rays on the body, of every figure, over its size."""
    figure = Figure(figsize=(6.4, 3.8), layout="constrained")
    axes = figure.subplots()
    spacings = [
        1000.0 * distance * np.deg2rad(view) / (rays - 1) for view, rays, _, distance in INPUTS.values()
    ]
    places = np.arange(len(INPUTS))[::-1]
    axes.barh(places, spacings, 0.6, color=BLUE)
    axes.set_yticks(places, [name.replace("figure-", "Figure ") for name in INPUTS])
    axes.set_xlabel("distance between neighbouring rays at the body [mm]")
    axes.set_title("inputs of the ray tracer", loc="left", fontsize="medium")
    tidy(axes)
    return figure


def _mesh_figure(meshes: Sequence[TriangleMesh], colours: Sequence[str], title: str) -> Figure:
    """Facets in space, shaded by the direction of their normals."""
    figure, axes = space_figure(7.0, 6.0)
    light = np.array([-0.5, -0.6, 0.62])
    for mesh, colour in zip(meshes, colours, strict=True):
        few = slice(None, None, max(1, len(mesh.triangles) // DRAWN // 4 + 1))
        shade = 0.55 + 0.45 * np.clip(mesh.normals[few] @ light, -0.6, 1.0)
        rgb = np.array(to_rgb(colour))
        faces = Poly3DCollection(
            mesh.corners[few].tolist(),
            facecolors=np.clip(shade[:, None] * rgb, 0.0, 1.0).tolist(),
            edgecolors=BLACK,
            linewidths=0.3 if len(mesh.triangles) < DRAWN else 0.0,
        )
        axes.add_collection3d(faces)
    equal_scales(axes, np.concatenate([mesh.vertices for mesh in meshes]))
    for axis, name in zip((axes.xaxis, axes.yaxis, axes.zaxis), "xyz", strict=True):
        axis.set_label_text(f"{name} [m]")
        axis.labelpad = 10.0
    axes.set_title(title, fontsize="medium")
    axes.view_init(elev=25, azim=-120)
    return figure


SIMULATED_SCANS: Final = (
    decoust_item("Figure 2.5", "section 2.2.2", "Facets of the spacecraft", make_mesh),
    decoust_item("Figure 2.6", "section 2.2.2", "The cube translated and rotated", make_moved_cube),
    decoust_item("Table 2.1", "p. 25", "High-resolution windows", make_windows),
    decoust_item("Figure 2.8", "section 2.2.3", "Rays without and with two windows", make_rays),
    decoust_item("Figure 2.11", "p. 32", "Specification of the RVS", make_specification),
    decoust_item("Table 2.2", "p. 33", "Inputs of the ray tracer", make_inputs),
    *(
        decoust_item(
            f"Figure {number}", "section 2.3.2", title, partial(make_scan, f"figure-{number}", rows), 2.0
        )
        for number, title, rows in (
            ("2.12", "Spacecraft at low resolution", _spacecraft_rows),
            ("2.13", "Spacecraft at (45, 20, 0) deg", _spacecraft_rows),
            ("2.14", "The cube", _cube_rows),
            ("2.15", "The cube with a window", _window_rows),
            ("2.16", "The cube with range noise", _range_rows),
            ("2.17", "The cube with noise of the angles", _angle_rows),
            ("2.18", "The cube with all noise and a window", _both_rows),
        )
    ),
)
STL_READER: Final = decoust_item(
    "Figure B.1", "appendix B.2", "STL reader on a complex shape", make_complex_mesh, 2.0
)
