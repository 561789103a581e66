"""A measured surface aligned to a known shape, whatever their rotation, and the other rotations that fit as well.

Closest points are iterated from rotations all over the sphere, with few points; the best ends are refined with all of them. A body
with symmetries has several such ends, between which no surface decides.
"""

from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.lidar.registration import Cloud, Registration, refined_pose, registered

FEW: Final = 300
"""Points of the measured surface by which beginnings are compared."""
MOST: Final = 6000
"""Points of the measured surface in the end."""
KNOWN: Final = 12_000
"""Points of the known shape."""
REACH: Final = 0.7
"""Distance of matches at first, in sizes of the known shape."""
CAPPED: Final = 0.1
"""Distance beyond which a point counts as missing, in the same."""
REFINED: Final = 1.5
"""Mean square of the distances over that of the best beginning, up to which an end is refined with all points."""
ALIKE: Final = 1.3
"""The same in the end, up to which a rotation fits as well as the best."""
LEAST_HELD: Final = 1e-6
"""Information about the direction of a pose that is held least, over that which is held most."""
APART: Final = np.deg2rad(10.0)
"""Angle between two rotations that count as different."""


def surface_cloud(mesh: TriangleMesh, count: int, generator: np.random.Generator) -> Cloud:
    """Points evenly over the surface of a mesh, with its normals.

    Parameters
    ----------
    mesh : TriangleMesh
        Triangles that face outwards, m.
    count : int
        How many points.
    generator : np.random.Generator
        Draws the facets and the places on them.
    """
    areas = np.linalg.norm(mesh.area_vectors, axis=1)
    facet = generator.choice(len(areas), count, p=areas / areas.sum())
    # the root of one uniform number makes points of a triangle uniform (Osada et al. 2002)
    a, b = np.sqrt(generator.random(count))[:, np.newaxis], generator.random(count)[:, np.newaxis]
    corners = mesh.corners[facet]
    points = (1 - a) * corners[:, 0] + a * (1 - b) * corners[:, 1] + a * b * corners[:, 2]
    return Cloud.of(points, mesh.normals[facet])


def facet_cloud(mesh: TriangleMesh, most: int = MOST) -> Cloud:
    """Middles of the facets of a measured surface, at most about so many, with their normals."""
    step = max(1, len(mesh.triangles) // most)
    return Cloud.of(mesh.corners.mean(axis=1)[::step], mesh.normals[::step])


def fitting_poses(source: Cloud, known: Cloud) -> list[Registration]:
    """Poses of a measured surface on a known shape, the best first, then others that fit as well.

    Parameters
    ----------
    source : Cloud
        Measured surface, which may be a part of the shape.
    known : Cloud
        Shape.

    Returns
    -------
    list of Registration
        p_known = R p + t, m.
    """
    step = max(1, len(source.points) // FEW)
    few = Cloud.of(source.points[::step], source.normals[::step])
    middle, centre = known.points.mean(axis=0), source.points.mean(axis=0)
    ends = []
    for R in _beginnings():
        pose = refined_pose(few, known, R, middle - R @ centre, REACH * known.size)
        ends.append((_mean_square(few, known, *pose), *pose))
    ends.sort(key=lambda end: end[0])
    found: list[tuple[float, Registration]] = []
    tried: list[np.ndarray] = []
    for square, R, t in ends:
        if square > REFINED * ends[0][0] + known.least_reach**2 or not _is_new(R, tried):
            continue
        tried.append(R)
        made = registered(source, known, R, t, max(2 * np.sqrt(square), 2 * known.least_reach))
        if np.isfinite(made.residual_std) and _is_new(made.rotation, [each.rotation for _, each in found]):
            found.append((_mean_square(source, known, made.rotation, made.translation), made))
    found.sort(key=lambda each: each[0])
    return [each for square, each in found if square <= ALIKE * found[0][0]]


def determines_pose(found: Registration, size: float) -> bool:
    """Whether a surface holds all directions of its pose on a shape of a size (m): a plane slides, a sphere turns."""
    scale = np.repeat([1.0, size], 3)  # rotation and translation in one unit
    values = np.linalg.eigvalsh(scale[:, np.newaxis] * found.information * scale)
    return bool(values[0] > LEAST_HELD * values[-1])


def _beginnings() -> list[Float[np.ndarray, "3 3"]]:
    """Rotations evenly over the sphere, the next one at most about 36 deg from any: the icosahedron's, and the same turned."""
    group = Rotation.create_group("I")
    turned = group * Rotation.from_rotvec(np.deg2rad(36.0) * np.ones(3) / np.sqrt(3.0))
    return [*group.as_matrix(), *turned.as_matrix()]


def _mean_square(
    source: Cloud, known: Cloud, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]
) -> float:
    """Mean square of the distances of moved points from the next of the shape, m^2, each counted up to `CAPPED`."""
    distance = known.tree.query(source.points @ R.T + t)[0]
    return float(np.mean(np.square(np.minimum(distance, CAPPED * known.size))))


def _is_new(R: Float[np.ndarray, "3 3"], others: list[Float[np.ndarray, "3 3"]]) -> bool:
    return all(Rotation.from_matrix(R.T @ other).magnitude() > APART for other in others)
