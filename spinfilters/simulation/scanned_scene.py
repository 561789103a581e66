"""The scene of a simulated scan: a body before a lidar, as its arguments or a preset of the thesis have it."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.conventions import RPM
from spinfilters.core.errors import InputError
from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.lidar.scan import HighResolutionWindow, LidarNoise, Losses, RayPattern, rvs_noise
from spinfilters.simulation.lidar_scanner import (
    LidarSettings,
    Scanner,
    Still,
    TorqueFreeTumble,
    thesis_rotation,
)
from spinfilters.simulation.lidar_sequence import Initial, ScanPreset, mesh_of, preset_of, tumble_of
from spinfilters.simulation.scan_arguments import ErrorArguments, RayArguments, ScanArguments

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
