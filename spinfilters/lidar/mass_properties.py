"""Volume, centre of mass and inertia of a body of uniform density inside a mesh."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.data.argument_checks import checked_arguments, one_of
from spinfilters.errors import InputError
from spinfilters.lidar.mesh import TriangleMesh


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Mass properties for density one, in mesh axes.

    Attributes
    ----------
    volume: m^3.   center_of_mass: (3,) m.   inertia: (3, 3) about the centre of mass, m^5 (times the density, kg/m^3: kg m^2).
    principal_moments: (3,) ascending, m^5.   principal_axes: (3, 3), rows, right-handed.
    """

    volume: float
    center_of_mass: Float[np.ndarray, "3"]
    inertia: Float[np.ndarray, "3 3"]
    principal_moments: Float[np.ndarray, "3"]
    principal_axes: Float[np.ndarray, "3 3"]


@checked_arguments(mesh=one_of(TriangleMesh, cure="a mesh, such as spinfilters.read_mesh gives"))
def mass_properties(mesh: TriangleMesh) -> MassProperties:
    """Mass properties by the divergence theorem: signed tetrahedra from the mesh's middle to every triangle.

    A tetrahedron (0, a, b, c) of volume V has the first moment V (a + b + c) / 4 and the second moment
    V / 20 (s s' + a a' + b b' + c c') with s = a + b + c.

    Raises
    ------
    InputError: a mesh that is not watertight, or inside out.
    """
    if not mesh.is_watertight:
        raise InputError(
            f"{mesh.name}: {mesh.open_edges} edges do not join two triangles, so it has no volume; close the mesh"
        )
    middle = mesh.vertices.mean(axis=0)
    corners = mesh.corners - middle
    volumes = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    volume = float(volumes.sum())
    if not volume > 0:
        raise InputError(
            f"{mesh.name}: its volume is {volume:.3g} m^3, so its normals point inwards; turn them"
        )
    total = corners.sum(axis=1)
    center = volumes @ total / (4 * volume)
    second = np.einsum("f,fi,fj->ij", volumes, total, total)
    second += np.einsum("f,fki,fkj->ij", volumes, corners, corners)
    second = second / 20 - volume * np.outer(center, center)
    inertia = np.trace(second) * np.eye(3) - second
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return MassProperties(volume, center + middle, inertia, moments, axes.T)
