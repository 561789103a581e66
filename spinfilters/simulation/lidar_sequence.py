"""A sequence of simulated scans of a tumbling body, written as a data set, with presets of scanners and bodies."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import continuous_quaternions, quaternion_from_matrix
from spinfilters.core.errors import InputError
from spinfilters.io.consider_parameter import exact_calibration
from spinfilters.io.dataset import DATASET_FILE
from spinfilters.io.output_files import make_folder, write_toml
from spinfilters.io.truth import Truth, write_truth
from spinfilters.lidar.mesh import TriangleMesh, box, mass_properties, read_mesh
from spinfilters.lidar.scan import HighResolutionWindow, LidarNoise, RayPattern, Scan, write_scan
from spinfilters.lidar.scan_streams import KIND, SCAN_FOLDER
from spinfilters.simulation.lidar_scanner import Scanner, TorqueFreeTumble

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Initial:
    """Initial pose and rates of a body at t = 0.

    Attributes
    ----------
    rotation : ndarray of shape (3, 3)
        R_Lg.
    translation : ndarray of shape (3,)
        Origin of g in L, m.
    rate : ndarray of shape (3,)
        About the principal axes in the order of ascending moments, rad/s.
    velocity : ndarray of shape (3,)
        Of the centre of mass in L, m/s.
    """

    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, "3"]
    rate: Float[np.ndarray, "3"]
    velocity: Float[np.ndarray, "3"]


def tumble_of(mesh: TriangleMesh, initial: Initial) -> TorqueFreeTumble:
    """The torque-free motion of a body of uniform density. InputError: a mesh without a volume."""
    body = mass_properties(mesh)
    centre = initial.rotation @ body.center_of_mass + initial.translation
    return TorqueFreeTumble(
        body.principal_moments / body.principal_moments[-1],
        body.principal_axes,
        body.center_of_mass,
        initial.rate,
        initial.rotation,
        centre,
        initial.velocity,
    )


def scan_times(
    count: int, interval: float, duration: float
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Begin of every scan, and its middle, the epoch of its pose. InputError: scans that overlap."""
    if duration > interval and count > 1:
        raise InputError(
            f"scans of {duration} s every {interval} s overlap; give a longer interval or faster scans"
        )
    start = interval * np.arange(count)
    return start, start + duration / 2


def scan_sequence(
    scanner: Scanner, motion: TorqueFreeTumble, start: Float[np.ndarray, " n"], seed: int, progress: Progress
) -> list[Scan]:
    """One scan from every begin."""
    generator, scans = np.random.default_rng(seed), []
    for time in start:
        scans.append(scanner.scan(motion, float(time), generator))
        progress(len(scans), len(start))
    return scans


def truth_of(motion: TorqueFreeTumble, time: Float[np.ndarray, " n"]) -> Truth:
    """The true motion at epochs, frame i that of the lidar."""
    R, t = motion.poses(time)
    return Truth(
        time=time,
        center_of_mass=t + R @ motion.center_of_mass,
        q_ig=continuous_quaternions(quaternion_from_matrix(R)),
        velocity=np.broadcast_to(motion.velocity, (len(time), 3)),
        rate_i=motion.rates(time),
        principal_moments=motion.principal_moments / motion.principal_moments.max(),
        principal_axes_g=motion.principal_axes,
        center_of_mass_g=motion.center_of_mass,
    )


def write_sequence(folder: Path, scans: list[Scan], truth: Truth, description: str, kind: str = KIND) -> None:
    """Write dataset.toml, the scans that hold a point, and the truth.

    InputError: disk full, no permission, nothing returned in any scan.
    """
    if not any(scan.is_return.any() for scan in scans):
        raise InputError(
            "no ray of any scan met the body; point the lidar at it, or give a wider field of view"
        )
    make_folder(folder / SCAN_FOLDER)
    digits = len(str(len(scans)))
    for number, scan in enumerate(scans):
        if not scan.is_return.any():
            continue  # there is nothing to read of it
        write_scan(folder / SCAN_FOLDER / f"{number:0{digits}d}.ply", scan)
    write_truth(truth, folder)
    exact = exact_calibration(("lidar",))
    write_toml(folder / DATASET_FILE, {"kind": kind, "description": description, "calibration": exact})


_SIGMA = float(np.deg2rad(0.01)) / 3
ANGLE_NOISE: Final = LidarNoise(azimuth_std=_SIGMA, elevation_std=2 * _SIGMA, mode="thesis")
"""Of Figure 2.17: 0.01 deg and 0.02 deg (3 sigma)."""
RANGE_NOISE: Final = LidarNoise(range_std=0.01 / 3)
"""Of Figure 2.16: 0.01 m (3 sigma)."""
BOTH_NOISES: Final = LidarNoise(0.01 / 3, _SIGMA, 2 * _SIGMA, mode="thesis")


def _window_from_corner(
    view: float, elevation: tuple[float, float], azimuth: tuple[float, float]
) -> HighResolutionWindow:
    """A window of the thesis: start and span, deg, counted from the corner of the field of view.

    Counted from its axis, the first window of Table 2.1 and that of Figure 2.15 would reach beyond the field.
    """
    half = view / 2
    return HighResolutionWindow(elevation[0] - half, elevation[1], azimuth[0] - half, azimuth[1])


_CUBE_WINDOW = _window_from_corner(40.0, (9.0, 16.0), (5.5, 12.5))
_TABLE_2_1 = (
    _window_from_corner(50.0, (20.0, 14.0), (25.0, 5.0)),
    _window_from_corner(50.0, (5.0, 8.0), (1.0, 6.0)),
)


@dataclass(frozen=True)
class ScanPreset:
    """One simulation of the thesis.

    Attributes
    ----------
    body : str
        Name of a built-in body.
    pattern : RayPattern
        Directions of the rays.
    rotation : tuple[float, float, float]
        z, y, x, deg (`thesis_rotation`).
    translation : tuple[float, float, float]
        Of the body, m, frame L.
    noise : LidarNoise
        Of range and angles.
    """

    body: str
    pattern: RayPattern
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    translation: tuple[float, float, float] = (500.0, 0.0, 0.0)
    noise: LidarNoise = field(default_factory=LidarNoise)


def _cube(noise: LidarNoise, *windows: HighResolutionWindow) -> ScanPreset:
    pattern = RayPattern((40.0, 40.0), (70, 70), windows)
    return ScanPreset("cube", pattern, (45.0, 20.0, 0.0), (3.0, 0.0, 0.0), noise)


_NONE = LidarNoise()
PRESETS: Final = {
    "table-2.1": ScanPreset(
        "cube", RayPattern((50.0, 50.0), (11, 6), _TABLE_2_1), translation=(3.0, 0.0, 0.0)
    ),
    "table-3.2": ScanPreset("cube", RayPattern(), (6.0, 10.0, 0.0)),
    "figure-2.12": ScanPreset("spacecraft", RayPattern((4.0, 4.0), (301, 301)), (6.0, 10.0, 0.0)),
    "figure-2.13": ScanPreset("spacecraft", RayPattern((4.0, 4.0), (501, 501)), (45.0, 20.0, 0.0)),
    "figure-2.14": _cube(_NONE),
    "figure-2.15": _cube(_NONE, _CUBE_WINDOW),
    "figure-2.16": _cube(RANGE_NOISE),
    "figure-2.17": _cube(ANGLE_NOISE),
    "figure-2.18": _cube(BOTH_NOISES, _CUBE_WINDOW),
}
"""By table or figure. Table 3.2 is that of the point-cloud processing, here in the pose of Table 4.1.

The resolutions 5 and 10 of Table 2.1 are taken as degrees between rays: with so many rays, spans of 5 and 6 deg hold none."""


def mesh_of(name: str) -> TriangleMesh:
    """A built-in body, or the mesh of a file. InputError: as `read_mesh`."""
    return {"cube": box, "spacecraft": spacecraft}.get(name, lambda: read_mesh(Path(name)))()


def preset_of(name: str) -> ScanPreset:
    """A preset by name. InputError: an unknown one."""
    if name not in PRESETS:
        raise InputError(f"preset {name!r} is unknown; use one of {', '.join(PRESETS)}")
    return PRESETS[name]


def spacecraft() -> TriangleMesh:
    """Spacecraft of a box, two solar panels and a cylindrical antenna; the thesis' drawing has no legible dimension."""
    parts = [
        (box((3.0, 3.0, 5.0)), (0.0, 0.0, 0.0)),
        (box((0.1, 6.0, 2.5)), (0.0, 5.0, 0.0)),
        (box((0.1, 6.0, 2.5)), (0.0, -5.0, 0.0)),
        (_cylinder(0.3, 2.0, 24), (0.0, 0.0, 3.8)),
    ]
    starts = np.cumsum([0, *(len(part.vertices) for part, _ in parts)])
    vertices = np.concatenate([part.vertices + np.array(place) for part, place in parts])
    triangles = np.concatenate(
        [part.triangles + start for (part, _), start in zip(parts, starts[:-1], strict=True)]
    )
    return TriangleMesh(vertices, triangles, "a spacecraft")


def _cylinder(radius: float, height: float, sides: int) -> TriangleMesh:
    """A closed cylinder along z about the origin."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ends = [np.column_stack([ring, np.full(sides, z)]) for z in (-height / 2, height / 2)]
    vertices = np.concatenate([*ends, [[0.0, 0.0, -height / 2], [0.0, 0.0, height / 2]]])
    k, after = np.arange(sides), (np.arange(sides) + 1) % sides
    low, high = np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
    walls = [(k, after, after + sides), (k, after + sides, k + sides)]
    caps = [(low, after, k), (high, k + sides, after + sides)]
    triangles = np.concatenate([np.stack(each, axis=1) for each in (*walls, *caps)])
    return TriangleMesh(vertices, triangles, "a cylinder")
