"""The lidar simulator: rays of a pattern against a moving mesh."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from spinfilters.geometry.ray_angles import unit_vectors
from spinfilters.lidar.body_motion import BodyMotion
from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.lidar.native import ray_tracer
from spinfilters.lidar.ray_pattern import RayPattern
from spinfilters.lidar.ray_tracing import RayHits, RayTracer
from spinfilters.lidar.scan import Scan
from spinfilters.lidar.scan_errors import FLAG_WORDS, RETURN, LidarNoise, Losses


@dataclass(frozen=True)
class LidarSettings:
    """A lidar.

    Attributes
    ----------
    duration: of a scan, s; its rays are fired evenly in it.   The others: see their classes.
    """

    pattern: RayPattern = field(default_factory=RayPattern)
    noise: LidarNoise = field(default_factory=LidarNoise)
    losses: Losses = field(default_factory=Losses)
    duration: float = 0.0


@dataclass(frozen=True, eq=False)
class Scanner:
    """A lidar before a mesh; make it once for many scans."""

    mesh: TriangleMesh
    settings: LidarSettings
    tracer: RayTracer

    @classmethod
    def of(cls, mesh: TriangleMesh, settings: LidarSettings) -> "Scanner":
        """Scanner with the fastest available tracer."""
        return cls(mesh, settings, ray_tracer(mesh))

    def scan(self, motion: BodyMotion, start: float, generator: np.random.Generator) -> Scan:
        """One scan that begins at ``start`` (s).

        Every ray meets the body where it is at the ray's own time.
        """
        rays, setting = self.settings.pattern.directions(), self.settings
        count = len(rays.azimuth)
        time = start + setting.duration * np.arange(count) / count
        fired, read = setting.noise.drawn_angles(count, generator)
        beams = unit_vectors(rays.azimuth + fired[:, 0], rays.elevation + fired[:, 1])
        hits, normals = self._hits(motion, time, beams)
        flag = setting.losses.flags(beams, normals, hits.distance, generator)
        noise = setting.noise.range_std * generator.standard_normal(count) + setting.noise.range_bias
        clutter = generator.random(count) < setting.losses.clutter
        true = hits.distance * np.where(clutter, generator.random(count), 1.0)
        distance = np.where(flag == RETURN, true + noise, np.nan)
        intensity = np.where(flag == RETURN, setting.losses.intensity(beams, normals), 0.0)
        counted = {words: int(np.count_nonzero(flag == k)) for k, words in FLAG_WORDS.items()}
        azimuth, elevation = rays.azimuth + read[:, 0], rays.elevation + read[:, 1]
        metadata = {
            "mesh": self.mesh.name,
            "rays": count,
            "start_s": start,
            "duration_s": setting.duration,
            **counted,
        }
        return Scan(time, azimuth, elevation, distance, intensity, flag, rays.window, metadata=metadata)

    def _hits(
        self, motion: BodyMotion, time: Float[np.ndarray, " n"], beams: Float[np.ndarray, "n 3"]
    ) -> tuple[RayHits, Float[np.ndarray, "n 3"]]:
        """Hits, and normals in frame L of the triangles hit.

        The rays are taken into the mesh's frame.
        """
        R, t = motion.poses(time)
        if np.ptp(time) == 0 and len(time):
            origins, directions = np.broadcast_to(-t[:1] @ R[0], t.shape), beams @ R[0]
        else:
            origins, directions = -np.einsum("nji,nj->ni", R, t), np.einsum("nji,nj->ni", R, beams)
        hits = self.tracer.hits(origins, directions)
        met = hits.triangle >= 0
        normals = np.zeros_like(beams)
        normals[met] = np.einsum("nij,nj->ni", R[met], self.mesh.normals[hits.triangle[met]])
        return hits, normals
