"""Image of a sunlit body in one camera, before blur and noise.

Geometry, shading and shadow.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.vision.rendering.surface_texture import SurfaceTexture
from spinfilters.vision.rendering.triangle_mesh import corner_normals
from spinfilters.vision.rendering.visible_surface import VisibleSurface, visible_surface

SHADOW_MAP = 512
"""Samples of the shadow map along each axis."""
SHADOW_BIAS = 4.0
"""Samples of the shadow map by which a surface may lie behind what the sun sees, so that it does not shade itself."""
GLOSS = 40.0
"""Exponent of the highlight of foil (Blinn 1977)."""


@dataclass(frozen=True)
class Appearance:
    """Appearance of a body under sunlight.

    Attributes
    ----------
    mesh: in frame g, m.   texture: of the surface.   sun: direction to the sun, frame i.
    ambient: light from everywhere, of the sun's.
    """

    mesh: TriangleMesh
    texture: SurfaceTexture = field(default_factory=SurfaceTexture)
    sun: tuple[float, float, float] = (-0.5, -0.6, -1.0)
    ambient: float = 0.12

    @cached_property
    def normals(self) -> Float[np.ndarray, "f 3 3"]:
        """See `corner_normals`."""
        return corner_normals(self.mesh)

    @property
    def sun_direction(self) -> Float[np.ndarray, " 3"]:
        """Unit vector, frame i."""
        return np.array(self.sun) / np.linalg.norm(self.sun)


@dataclass(frozen=True)
class View:
    """A pinhole camera before the body.

    Attributes
    ----------
    K: (3, 3) px, in samples.   shape: rows, columns of samples.   R_ic, t_ic: pose of the camera in i.
    """

    K: Float[np.ndarray, "3 3"]
    shape: tuple[int, int]
    R_ic: Float[np.ndarray, "3 3"]
    t_ic: Float[np.ndarray, " 3"]


def body_image(
    body: Appearance, R_ig: Float[np.ndarray, "3 3"], t_ig: Float[np.ndarray, " 3"], view: View
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """Radiance and depth of each sample of the image.

    1 is white in the sun; m, 0 where nothing is; a body behind the camera is not seen.
    """
    at_i = body.mesh.vertices @ R_ig.T + t_ig
    at_c = ((at_i - view.t_ic) @ view.R_ic)[body.mesh.triangles]
    with np.errstate(divide="ignore", invalid="ignore"):
        projected = at_c @ view.K.T
        corners = projected[..., :2] / projected[..., 2:]
        nearness = 1 / at_c[..., 2]
    surface = visible_surface(corners, nearness, view.shape)
    seen = surface.seen
    radiance, depth = np.zeros(view.shape), np.zeros(view.shape)
    if seen.any():
        depth[seen] = 1 / surface.nearness[seen]
        weights = _in_space(surface, nearness)
        radiance[seen] = _shaded(body, R_ig, t_ig, _Samples(surface.face[seen], weights), view)
    return radiance, depth


def _in_space(surface: VisibleSurface, nearness: Float[np.ndarray, "f 3"]) -> Float[np.ndarray, "k 3"]:
    """Barycentric weights in space of the samples, from those in the image plane."""
    scaled = surface.weights * nearness[surface.face[surface.seen]]
    return scaled / scaled.sum(axis=1, keepdims=True)


class _Samples(NamedTuple):
    """Faces that samples show, and weights of their corners."""

    face: Int[np.ndarray, " k"]
    weights: Float[np.ndarray, "k 3"]


def _shaded(
    body: Appearance,
    R_ig: Float[np.ndarray, "3 3"],
    t_ig: Float[np.ndarray, " 3"],
    samples: _Samples,
    view: View,
) -> Float[np.ndarray, " k"]:
    """Radiance of surface samples: Lambert, and a highlight where there is foil."""
    face, weights = samples
    points = np.einsum("kc,kci->ki", weights, body.mesh.corners[face])
    normals = np.einsum("kc,kci->ki", weights, body.normals[face])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sun = R_ig.T @ body.sun_direction
    lit = ~_shadowed(body.mesh, points, sun)
    radiance = body.texture.albedo(points) * (body.ambient + lit * np.maximum(normals @ sun, 0.0))
    foil = body.texture.is_foil(points)
    if foil.any():
        bent = body.texture.crinkled(points[foil], normals[foil])
        eye = R_ig.T @ (view.t_ic - t_ig) - points[foil]
        half = sun + eye / np.linalg.norm(eye, axis=1, keepdims=True)
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        shine = np.maximum(np.einsum("ki,ki->k", bent, half), 0.0) ** GLOSS
        radiance[foil] = 0.25 * radiance[foil] + lit[foil] * 2.0 * shine
    return radiance


def _shadowed(
    mesh: TriangleMesh, points: Float[np.ndarray, "k 3"], sun: Float[np.ndarray, " 3"]
) -> Bool[np.ndarray, " k"]:
    """Whether surface points (frame g) are shadowed by the mesh.

    They lie behind what a shadow map holds.
    """
    across = np.linalg.svd(sun[None])[2][1:]
    frame = np.stack([across[0], np.cross(-sun, across[0]), -sun])  # rows: column, row, away from the sun
    radius = mesh.radius * 1.01
    scale = SHADOW_MAP / (2 * radius)

    def placed(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places in the shadow map and nearness to the sun."""
        turned = at @ frame.T
        return (turned[..., :2] + radius) * scale, 2 * radius - turned[..., 2]

    seen_by_sun = visible_surface(*placed(mesh.corners), (SHADOW_MAP, SHADOW_MAP))
    place, nearness = placed(points)
    column, row = np.clip(np.round(place).astype(int), 0, SHADOW_MAP - 1).T
    return seen_by_sun.nearness[row, column] > nearness + SHADOW_BIAS / scale
