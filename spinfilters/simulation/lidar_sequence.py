"""Simulated scans: sequences of a tumbling body written as a data set, presets of scanners and bodies, and scenes of one scan."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import continuous_quaternions, quaternion_from_matrix
from spinfilters.core.conventions import RPM
from spinfilters.core.errors import InputError
from spinfilters.io.consider_parameter import exact_calibration
from spinfilters.io.dataset import DATASET_FILE
from spinfilters.io.output_files import make_folder, write_toml
from spinfilters.io.truth import Truth, write_truth
from spinfilters.lidar.mesh import TriangleMesh, box, mass_properties, read_mesh
from spinfilters.lidar.scan import (
    HighResolutionWindow,
    LidarNoise,
    Losses,
    RayPattern,
    Scan,
    rvs_noise,
    write_scan,
)
from spinfilters.lidar.scan_streams import KIND, SCAN_FOLDER
from spinfilters.simulation.lidar_scanner import (
    LidarSettings,
    Scanner,
    Still,
    TorqueFreeTumble,
    thesis_rotation,
)
from spinfilters.simulation.scan_arguments import ErrorArguments, RayArguments, ScanArguments

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


FAR: Final = 2000.0
"""Distance of a body, m, beyond which its unit is doubted."""
_RADII, _MARGIN, _RAYS = 4.0, 1.1, 200


@dataclass(frozen=True, eq=False)
class ScannedScene:
    """A body before a lidar.

    Attributes
    ----------
    mesh : TriangleMesh
        The body, m.
    preset : ScanPreset
        Its place and the rays: those of the thesis, or chosen around the mesh.
    lidar : LidarSettings
        Rays, noise and losses.
    """

    mesh: TriangleMesh
    preset: ScanPreset
    lidar: LidarSettings

    @classmethod
    def of(cls, options: ScanArguments) -> "ScannedScene":
        """Scene of the arguments.

        Raises
        ------
        InputError
            Nothing to scan, an unknown preset, an unusable mesh, a lidar within the body.
        """
        if options.preset is None and options.mesh is None:
            raise InputError("there is nothing to scan; give a mesh, cube, spacecraft or --preset")
        given = preset_of(options.preset) if options.preset else None
        body = options.body
        mesh = mesh_of(options.mesh or (given.body if given else ""))
        mesh = mesh if body.scale == 1.0 else mesh.scaled(body.scale)
        preset = given or ScanPreset(mesh.name, RayPattern(), translation=(_RADII * mesh.radius, 0.0, 0.0))
        preset = replace(
            preset,
            rotation=body.rotation or preset.rotation,
            translation=body.translation or preset.translation,
        )
        preset = replace(preset, pattern=_pattern(options.beams, preset, mesh, given is not None))
        noise = _noise(options.errors, preset)
        lidar = LidarSettings(preset.pattern, noise, _losses(options.errors), options.beams.scan_seconds)
        scene = cls(mesh, preset, lidar)
        scene.require_outside()
        return scene

    @property
    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """R_Lg at first."""
        return thesis_rotation(*self.preset.rotation)

    @property
    def translation(self) -> Float[np.ndarray, "3"]:
        """Origin of the mesh at first, frame L, m."""
        return np.array(self.preset.translation)

    @property
    def scanner(self) -> Scanner:
        """The lidar before the mesh."""
        return Scanner.of(self.mesh, self.lidar)

    @property
    def at_rest(self) -> Still:
        """The body at its place."""
        return Still(self.rotation, self.translation)

    def tumbling(self, rate_rpm: tuple[float, ...], velocity: tuple[float, ...]) -> TorqueFreeTumble:
        """The torque-free motion of the body from its place.

        Parameters
        ----------
        rate_rpm : tuple[float, float, float]
            About the principal axes in the order of ascending moments.
        velocity : tuple[float, float, float]
            Of the centre of mass, m/s, frame L.

        Raises
        ------
        InputError
            A mesh without a volume.
        """
        rate = np.array(rate_rpm) * RPM
        return tumble_of(self.mesh, Initial(self.rotation, self.translation, rate, np.array(velocity)))

    def require_outside(self) -> None:
        """InputError: the lidar is within the box around the body."""
        lidar, vertices = -self.rotation.T @ self.translation, self.mesh.vertices
        if not ((lidar > vertices.min(axis=0)) & (lidar < vertices.max(axis=0))).all():
            return
        raise InputError(
            f"{self.mesh.name}: is {self._size} m large and its origin {self._distance:g} m away, so that the lidar is "
            "within it; give --scale 0.001 if it is in mm, or a longer --translation"
        )

    @property
    def size_sentence(self) -> str:
        """Size and distance of the body, which show a wrong unit."""
        unit = (
            f"; --scale 0.001 if it is in mm ({FAR:g} m is far for a lidar)" if self._distance > FAR else ""
        )
        return f"{self.mesh.name}: {self._size} m, {self._distance:g} m away{unit}"

    @property
    def metadata(self) -> dict[str, object]:
        """What a written scan states beyond its own numbers."""
        pattern = self.preset.pattern
        return {
            "rotation_zyx_deg": self.preset.rotation,
            "translation_m": self.preset.translation,
            "field_of_view_deg": pattern.field_of_view,
            "rays_az_el": pattern.rays,
            "windows": [vars(window) for window in pattern.windows],
            "noise": vars(self.lidar.noise),
        }

    @property
    def _distance(self) -> float:
        return float(np.linalg.norm(self.translation))

    @property
    def _size(self) -> str:
        return " x ".join(f"{side:.3g}" for side in np.ptp(self.mesh.vertices, axis=0))


def _pattern(options: RayArguments, preset: ScanPreset, mesh: TriangleMesh, kept: bool) -> RayPattern:
    """The rays asked for, those of the preset where they are kept, or rays around the body."""
    distance = float(np.linalg.norm(preset.translation))
    around = 2 * np.rad2deg(np.arcsin(min(1.0, mesh.radius / max(distance, 1e-12)))) * _MARGIN
    widest = min(around, 179.0)
    field = preset.pattern.field_of_view if kept else (widest, widest)
    rays = preset.pattern.rays if kept else (_RAYS, _RAYS)
    windows = tuple(HighResolutionWindow(*each) for each in options.window) or preset.pattern.windows
    return RayPattern(options.fov or field, options.rays or rays, windows, options.multiplier)


def _noise(options: ErrorArguments, preset: ScanPreset) -> LidarNoise:
    if options.noise not in (None, "none"):
        return rvs_noise(options.noise, options.long_range, options.bias)
    if options.long_range or options.bias:
        raise InputError("--long-range and --bias belong to --noise jitter, encoder or thesis; give it too")
    return preset.noise if options.noise is None else LidarNoise()


def _losses(options: ErrorArguments) -> Losses:
    if options.sun is not None and not np.linalg.norm(options.sun) > 0:
        raise InputError("--sun 0 0 0 is no direction; give one towards the sun")
    return Losses(
        reflectivity=options.reflectivity,
        weakest=options.weakest,
        strongest=np.inf if options.strongest is None else options.strongest,
        dust=options.dust,
        clutter=options.clutter,
        sun=options.sun,
    )
