"""``spinfilters lidar``: simulated scans of a body, and how many are needed."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from spinfilters.cli.console import progress_bars, wide_console
from spinfilters.core.conventions import RPM
from spinfilters.core.errors import InputError
from spinfilters.io.output_files import output_folder, refuse_foreign
from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.lidar.scan import (
    HighResolutionWindow,
    LidarNoise,
    Losses,
    RayPattern,
    Scan,
    rvs_noise,
    write_scan,
)
from spinfilters.lidar.scan_pose import attitude_stds, scans_needed
from spinfilters.lidar.scan_streams import KIND, POINTS_KIND, registered_scans
from spinfilters.plots.measurement_figures import scan_accuracy_figure, scan_figure
from spinfilters.plots.style import save_figure
from spinfilters.simulation.lidar_scanner import LidarSettings, Scanner, Still, thesis_rotation
from spinfilters.simulation.lidar_sequence import (
    Initial,
    ScanPreset,
    mesh_of,
    preset_of,
    scan_sequence,
    scan_times,
    truth_of,
    tumble_of,
    write_sequence,
)

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


SCAN: Final = "lidar scan"
FAR: Final = 2000.0
"""Distance of a body, m, beyond which its unit is doubted."""
_RADII, _MARGIN, _RAYS = 4.0, 1.1, 200
_RATE_RPM = (1.0, 2.0, 1.5)


def lidar(options: argparse.Namespace) -> int:
    """Run the chosen action."""
    return {"scan": _scan, "needed": needed}[options.action](options)


def _scan(options: argparse.Namespace) -> int:
    """Simulate one scan, or a sequence as a data set."""
    folder = Path(options.output)
    refuse_foreign(folder, SCAN)
    scene = _scene(options)
    _require_outside(scene)
    scanner = Scanner.of(scene.mesh, _settings(options, scene))
    console = wide_console()
    console.print(_sized(scene), highlight=False, soft_wrap=True)
    for remark in scene.mesh.remarks:
        console.print(f"{scene.mesh.name}: {remark}", highlight=False, soft_wrap=True)
    said = (
        _one(options, scene, scanner, folder)
        if options.scans is None
        else _many(options, scene, scanner, folder)
    )
    console.print(f"{said} in {folder}", highlight=False, soft_wrap=True)
    return 0


class _Scene:
    """Scanned body and its poses: the preset's, or chosen around the mesh."""

    def __init__(self, preset: ScanPreset, mesh: TriangleMesh) -> None:
        self.preset, self.mesh = preset, mesh
        self.rotation = thesis_rotation(*preset.rotation)
        self.translation = np.array(preset.translation)


def _scene(options: argparse.Namespace) -> _Scene:
    if options.preset is None and options.mesh is None:
        raise InputError("there is nothing to scan; give a mesh, cube, spacecraft or --preset")
    given = preset_of(options.preset) if options.preset else None
    mesh = mesh_of(options.mesh or (given.body if given else ""))
    mesh = mesh if options.scale == 1.0 else mesh.scaled(options.scale)
    preset = given or ScanPreset(options.mesh, RayPattern(), translation=(_RADII * mesh.radius, 0.0, 0.0))
    if options.rotation:
        preset = replace(preset, rotation=tuple(options.rotation))
    if options.translation:
        preset = replace(preset, translation=tuple(options.translation))
    return _Scene(replace(preset, pattern=_pattern(options, preset, mesh, given is not None)), mesh)


def _require_outside(scene: _Scene) -> None:
    """InputError: the lidar stands within the box around the body."""
    lidar, vertices = -scene.rotation.T @ scene.translation, scene.mesh.vertices
    if not ((lidar > vertices.min(axis=0)) & (lidar < vertices.max(axis=0))).all():
        return
    distance = float(np.linalg.norm(scene.translation))
    raise InputError(
        f"{scene.mesh.name}: is {_size_text(scene.mesh)} m large and its origin {distance:g} m away, so that the lidar is "
        "within it; give --scale 0.001 if it is in mm, or a longer --translation"
    )


def _sized(scene: _Scene) -> str:
    """Size and distance of the body, which show a wrong unit."""
    distance = float(np.linalg.norm(scene.translation))
    unit = f"; --scale 0.001 if it is in mm ({FAR:g} m is far for a lidar)" if distance > FAR else ""
    return f"{scene.mesh.name}: {_size_text(scene.mesh)} m, {distance:g} m away{unit}"


def _size_text(mesh: TriangleMesh) -> str:
    return " x ".join(f"{side:.3g}" for side in np.ptp(mesh.vertices, axis=0))


def _pattern(options: argparse.Namespace, preset: ScanPreset, mesh: TriangleMesh, kept: bool) -> RayPattern:
    """The rays asked for, of the preset, or around the body."""
    distance = float(np.linalg.norm(preset.translation))
    around = 2 * np.rad2deg(np.arcsin(min(1.0, mesh.radius / max(distance, 1e-12)))) * _MARGIN
    widest = min(around, 179.0)
    field = preset.pattern.field_of_view if kept else (widest, widest)
    rays = preset.pattern.rays if kept else (_RAYS, _RAYS)
    windows = tuple(HighResolutionWindow(*each) for each in options.window or ()) or preset.pattern.windows
    azimuth, elevation = options.fov or field
    across, up = options.rays or rays
    return RayPattern((azimuth, elevation), (across, up), windows, options.multiplier)


def _settings(options: argparse.Namespace, scene: _Scene) -> LidarSettings:
    noise = scene.preset.noise if options.noise is None else LidarNoise()
    if options.noise not in (None, "none"):
        noise = rvs_noise(options.noise, options.long_range, options.bias)
    elif options.long_range or options.bias:
        raise InputError("--long-range and --bias belong to --noise jitter, encoder or thesis; give it too")
    losses = Losses(
        reflectivity=options.reflectivity,
        weakest=options.weakest,
        strongest=np.inf if options.strongest is None else options.strongest,
        dust=options.dust,
        clutter=options.clutter,
        sun=_direction(options.sun),
    )
    return LidarSettings(scene.preset.pattern, noise, losses, options.scan_seconds)


def _direction(sun: list[float] | None) -> tuple[float, float, float] | None:
    if sun is None:
        return None
    if not np.linalg.norm(sun) > 0:
        raise InputError("--sun 0 0 0 is no direction; give one towards the sun")
    return (sun[0], sun[1], sun[2])


def _one(options: argparse.Namespace, scene: _Scene, scanner: Scanner, folder: Path) -> str:
    scan = scanner.scan(Still(scene.rotation, scene.translation), 0.0, np.random.default_rng(options.seed))
    scan = replace(scan, metadata={**scan.metadata, **_told(options, scene, scanner)})
    if not scan.is_return.any():
        raise InputError(f"none of {len(scan)} rays met {scene.mesh.name}; aim at it, or give a wider --fov")
    with output_folder(folder, SCAN) as place:
        for ending in dict.fromkeys(options.format):
            write_scan(place / f"scan.{ending}", scan, options.misses)
        save_figure(scan_figure(scan, Path(scene.mesh.name).name), place / "scan.png")
    return _counted(scan)


def _told(options: argparse.Namespace, scene: _Scene, scanner: Scanner) -> dict[str, object]:
    """Metadata beyond that of the scan itself."""
    pattern, noise = scene.preset.pattern, scanner.settings.noise
    return {
        "rotation_zyx_deg": scene.preset.rotation,
        "translation_m": scene.preset.translation,
        "field_of_view_deg": pattern.field_of_view,
        "rays_az_el": pattern.rays,
        "windows": [vars(window) for window in pattern.windows],
        "noise": vars(noise),
        "seed": options.seed,
    }


def _counted(scan: Scan) -> str:
    lost = ", ".join(f"{scan.metadata[k]} {k}" for k in ("too weak", "saturated", "dust") if scan.metadata[k])
    return f"{np.count_nonzero(scan.is_return)} of {len(scan)} rays returned{', ' + lost if lost else ''}"


def _many(options: argparse.Namespace, scene: _Scene, scanner: Scanner, folder: Path) -> str:
    """A data set of the tumbling body."""
    rate = np.array(options.rate_rpm or _RATE_RPM) * RPM
    velocity = np.array(options.velocity or (0.0, 0.0, 0.0))
    motion = tumble_of(scene.mesh, Initial(scene.rotation, scene.translation, rate, velocity))
    begin, epochs = scan_times(options.scans, options.interval, options.scan_seconds)
    with progress_bars() as report:
        scans = scan_sequence(
            scanner, motion, begin, options.seed, lambda done, total: report("scans", done, total)
        )
    told = _told(options, scene, scanner)
    scans = [replace(scan, metadata={**scan.metadata, **told}) for scan in scans]
    described = (
        f"{len(scans)} simulated scans of {scene.mesh.name} at {options.interval} s, seed {options.seed}"
    )
    best = max(scans, key=lambda scan: np.count_nonzero(scan.is_return))
    with output_folder(folder, SCAN) as place:
        kind = POINTS_KIND if options.points else KIND
        write_sequence(place, scans, truth_of(motion, epochs), described, kind)
        save_figure(scan_figure(best, Path(scene.mesh.name).name), place / "scan.png")
    counts = [np.count_nonzero(scan.is_return) for scan in scans]
    return f"{len(scans)} scans of {min(counts)} to {max(counts)} points"
