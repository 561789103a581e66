"""Simulated lidar: a tumbling body, ray tracing in C or NumPy, and the errors of ranges and angles.

The C of `tracer.c` serves where there is a compiler, else the NumPy reference.
"""

import ctypes
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Final, Protocol

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.attitude_conversions import (
    matrix_from_quaternion,
    quaternion_from_euler321,
    quaternion_from_matrix,
)
from spinfilters.core.c_library import FLAGS, NATIVE, load_text
from spinfilters.core.compiled import address
from spinfilters.core.ray_angles import unit_vectors
from spinfilters.core.torque_free import torque_free_motion
from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.lidar.scan import FLAG_WORDS, RETURN, LidarNoise, Losses, RayPattern, Scan


class BodyMotion(Protocol):
    """Poses of the mesh's frame g in the lidar's frame L."""

    def poses(
        self, time: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"]]:
        """R_Lg and the origin of g in L, m, at times in s."""
        ...


@dataclass(frozen=True, eq=False)
class Still:
    """A body at rest."""

    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, "3"]

    def poses(
        self, time: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"]]:
        """See `BodyMotion`; one pose for all times, broadcast."""
        n = len(time)
        return np.broadcast_to(self.rotation, (n, 3, 3)), np.broadcast_to(self.translation, (n, 3))


@dataclass(frozen=True, eq=False)
class TorqueFreeTumble:
    """A rigid body that drifts and tumbles without torque.

    Attributes
    ----------
    principal_moments : ndarray of float, shape (3,)
        Any scale.
    principal_axes : ndarray of float, shape (3, 3)
        Rows, right-handed, in g.
    center_of_mass : ndarray of float, shape (3,)
        In g, m.
    rate : ndarray of float, shape (3,)
        At t = 0 about the principal axes, rad/s.
    attitude : ndarray of float, shape (3, 3)
        R_Lg at t = 0.
    position, velocity : ndarray of float, shape (3,)
        Of the centre of mass in L, m and m/s.
    """

    principal_moments: Float[np.ndarray, "3"]
    principal_axes: Float[np.ndarray, "3 3"]
    center_of_mass: Float[np.ndarray, "3"]
    rate: Float[np.ndarray, "3"]
    attitude: Float[np.ndarray, "3 3"]
    position: Float[np.ndarray, "3"]
    velocity: Float[np.ndarray, "3"]

    def poses(
        self, time: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"]]:
        """See `BodyMotion`."""
        R, _ = self._attitudes(time)
        centre = self.position + np.asarray(time)[:, None] * self.velocity
        return R, centre - R @ self.center_of_mass

    def rates(self, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """Body rates in axes of L, rad/s."""
        R, rate = self._attitudes(time)
        return np.einsum("nij,kj,nk->ni", R, self.principal_axes, rate)

    def _attitudes(
        self, time: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"]]:
        """R_Lg, and rates about the principal axes."""
        start = quaternion_from_matrix(self.attitude @ self.principal_axes.T)
        motion = torque_free_motion(self.principal_moments, self.rate, np.asarray(time), start)
        return matrix_from_quaternion(motion.attitude) @ self.principal_axes, motion.rate


def thesis_rotation(z_deg: float, y_deg: float, x_deg: float) -> Float[np.ndarray, "3 3"]:
    """Rotated points Rx (Ry (Rz P)) by Euler angles "(3, 2, 1)", deg.

    It is applied as printed (Decoust 2008, section 2.2.2). The name says an intrinsic sequence about z, y, x, which would be
    Rz Ry Rx: this is the extrinsic one.
    """
    intrinsic = quaternion_from_euler321(-np.deg2rad([z_deg, y_deg, x_deg]))  # Rz(-z) Ry(-y) Rx(-x)
    return matrix_from_quaternion(intrinsic).T


EDGE_TOLERANCE: Final = 1e-9
"""By how much a triangle reaches beyond its edges, in barycentric coordinates: no ray slips through a shared edge by rounding."""
SMALLEST_SINE: Final = 1e-12
"""Sine of the angle between a ray and a plane below which they count as parallel."""
_PAIRS = 1 << 20  # rays times triangles that are held at once


@dataclass(frozen=True, eq=False)
class RayHits:
    """Closest intersections of n rays.

    Attributes
    ----------
    distance : ndarray of float, shape (n,)
        Along the ray, m; infinite for a miss.
    triangle : ndarray of int, shape (n,)
        Of the mesh, -1 for a miss.
    """

    distance: Float[np.ndarray, " n"]
    triangle: Int[np.ndarray, " n"]


class RayTracer(Protocol):
    """Tracer of closest ray intersections with one mesh."""

    def hits(self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]) -> RayHits:
        """Closest intersections of rays from ``origins`` (m) along unit ``directions``, mesh axes."""
        ...


@dataclass(frozen=True, eq=False)
class BruteForceTracer:
    """Every ray against every triangle in NumPy: the reference, and what serves without a compiler."""

    mesh: TriangleMesh

    def hits(self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]) -> RayHits:
        """See `RayTracer`; rays that miss the bounding sphere are not tried."""
        distance, triangle = np.full(len(origins), np.inf), np.full(len(origins), -1)
        middle = (self.mesh.vertices.min(axis=0) + self.mesh.vertices.max(axis=0)) / 2
        radius = np.linalg.norm(self.mesh.vertices - middle, axis=1).max()
        offset = np.cross(origins - middle, directions)
        near = np.flatnonzero(np.linalg.norm(offset, axis=1) <= radius * (1 + 1e-6))
        for rows in np.array_split(near, max(1, len(near) * len(self.mesh.triangles) // _PAIRS)):
            if len(rows):
                distance[rows], triangle[rows] = brute_force_hits(self.mesh, origins[rows], directions[rows])
        return RayHits(distance, triangle)


def brute_force_hits(
    mesh: TriangleMesh, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Distances and triangles by Moeller and Trumbore (1997), corrected sign of Decoust 2008, section 2.2.4.

    A point of a triangle is V1 + u E1 + v E2 (Eq. 2.5). A hit is valid when it is in front (t > 0) and, of a watertight mesh, the
    ray meets the outside (N.D < 0).
    """
    corner, E1 = mesh.corners[:, 0], mesh.corners[:, 1] - mesh.corners[:, 0]
    E2 = mesh.corners[:, 2] - mesh.corners[:, 0]
    P = np.cross(directions[:, None], E2)
    det = np.einsum("fi,nfi->nf", E1, P)
    sign = np.where(det < 0, 0.0 if mesh.is_watertight else -1.0, 1.0)
    S = origins[:, None] - corner
    Q = np.cross(S, E1)
    u, v = sign * np.einsum("nfi,nfi->nf", S, P), sign * np.einsum("ni,nfi->nf", directions, Q)
    along, det = sign * np.einsum("fi,nfi->nf", E2, Q), sign * det
    slack = EDGE_TOLERANCE * det
    smallest = SMALLEST_SINE * 2 * np.linalg.norm(mesh.area_vectors, axis=1)
    met = (det > smallest) & (u >= -slack) & (v >= -slack) & (u + v <= det + slack) & (along > 0)
    distances = np.where(met, along / np.where(met, det, 1.0), np.inf)
    closest = distances.argmin(axis=1)
    distance = distances[np.arange(len(distances)), closest]
    return distance, np.where(np.isfinite(distance), closest, -1)


_FLAGS = (
    *(flag for flag in FLAGS if "contract" not in flag),
    "-O3",
    NATIVE,
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fno-signed-zeros",
)
# as in tracer.c: distance of a miss, words of a node and of a wide one, numbers of a triangle, rows of a tile
_FAR, _NODE, _BRANCH, _PACKED, _TALL = 1e300, 8, 113, 12, 4
_RAYS = 4096  # rays of a task, at least
_I, _D, _P = ctypes.c_longlong, ctypes.c_double, ctypes.c_void_p


def ray_tracer(mesh: TriangleMesh) -> RayTracer:
    """The fastest tracer that this machine has for a mesh."""
    library = _library()
    return BruteForceTracer(mesh) if library is None else NativeTracer(mesh, library)


@cache
def _library() -> ctypes.CDLL | None:
    text = Path(__file__).with_name("tracer.c").read_text()
    loaded = load_text("lidar_tracer", text, _FLAGS)
    if loaded is None:
        return None
    library = ctypes.CDLL(
        loaded._name
    )  # the same library, called without the interpreter's lock: rays go to all cores
    library.build_tree.argtypes = [_I, _P, _D, *[_P] * 4]
    library.trace.argtypes = [_I, _I, *[_P] * 5, _D, _D, _P, _P]
    library.gather_branches.argtypes, library.gather_branches.restype = [_P, _P], _I
    library.row_length.argtypes, library.row_length.restype = [_I, _P], _I
    library.build_tree.restype = library.trace.restype = None
    return library


class NativeTracer:
    """A bounding-volume hierarchy over one mesh; see `ray_tracing.BruteForceTracer` for what is computed."""

    def __init__(self, mesh: TriangleMesh, library: ctypes.CDLL) -> None:
        count, corners = len(mesh.triangles), np.ascontiguousarray(mesh.corners)
        self._library, self._both_sides = library, 0.0 if mesh.is_watertight else 1.0
        nodes = np.empty((2 * count, _NODE))
        self._order, self._packed = np.empty(count, np.int64), np.empty((count, _PACKED))
        scratch = np.empty((count, 6))
        made = (nodes, self._order, self._packed, scratch)
        library.build_tree(count, address(corners), SMALLEST_SINE, *map(address, made))
        self._branches = np.empty((library.gather_branches(address(nodes), None), _BRANCH))
        library.gather_branches(address(nodes), address(self._branches))

    def hits(self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]) -> RayHits:
        """See `RayTracer`."""
        n, cores = len(directions), len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
        origins = np.ascontiguousarray(np.broadcast_to(origins, (n, 3)), dtype=np.float64)
        directions = np.ascontiguousarray(directions, dtype=np.float64)
        distance, triangle = np.empty(n), np.empty(n, np.int64)
        across = self._library.row_length(n, address(directions)) if n else 0
        edges = np.linspace(0, n, max(1, min(8 * cores, n // _RAYS)) + 1).astype(int)
        if across:  # a task has whole bands of rows, which are traced in tiles
            edges[1:-1] -= edges[1:-1] % (_TALL * across)

        def trace(first: int, end: int) -> None:
            """Trace the rays from first to before end."""
            rows = slice(first, end)
            given = (origins[rows], directions[rows], self._branches, self._order, self._packed)
            made = (distance[rows], triangle[rows])
            tolerances = (EDGE_TOLERANCE, self._both_sides)
            self._library.trace(end - first, across, *map(address, given), *tolerances, *map(address, made))

        parts = edges[:-1].tolist(), edges[1:].tolist()
        if len(edges) == 2 or cores == 1:
            list(map(trace, *parts))
        else:
            with ThreadPoolExecutor(cores) as pool:
                list(pool.map(trace, *parts))
        distance[distance >= _FAR] = np.inf
        return RayHits(distance, triangle)


@dataclass(frozen=True)
class LidarSettings:
    """A lidar.

    Attributes
    ----------
    pattern : RayPattern
        Directions of the rays.
    noise : LidarNoise
        Of range and angles.
    losses : Losses
        Of returns.
    duration : float
        Of a scan, s; its rays are fired evenly in it.
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
        hits, normals = self._trace_hits(motion, time, beams)
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

    def _trace_hits(
        self, motion: BodyMotion, time: Float[np.ndarray, " n"], beams: Float[np.ndarray, "n 3"]
    ) -> tuple[RayHits, Float[np.ndarray, "n 3"]]:
        """Hits of the rays, traced in the mesh's frame, and normals in frame L of the triangles that they hit."""
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
