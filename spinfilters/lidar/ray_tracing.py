"""Closest intersections of rays with the triangles of a mesh, in float64."""

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from jaxtyping import Float, Int

from spinfilters.lidar.mesh import TriangleMesh

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
    distance: (n,) m, inf for a miss.   triangle: (n,) of the mesh, -1 for a miss.
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
