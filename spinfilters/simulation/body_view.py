"""Image of a sunlit body in one camera, before blur and noise: mesh, solid texture, shading and shadow."""

from dataclasses import dataclass, field
from functools import cached_property
from itertools import permutations, product
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import map_coordinates
from scipy.spatial import ConvexHull

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text, value_text
from spinfilters.lidar.mesh import MESH_SUFFIXES, TriangleMesh, read_mesh
from spinfilters.vision.visible_surface import visible_surface

LATTICE = 64
"""Cells of a noise lattice along each axis, after which it repeats."""
CELLS_M = (0.016, 0.007, 0.0035)
"""Sizes of the blotches, m: at 0.6 m and f = 470 px from a dozen pixels to three."""
SHARES = (0.35, 0.35, 0.3)
CONTRAST = 3.0
DARKEST, BRIGHTEST = 0.08, 0.95


@dataclass(frozen=True)
class SurfaceTexture:
    """Blotches of several sizes; a part of the surface is crinkled metal foil.

    Attributes
    ----------
    seed : int
        Of the blotches.
    foil : float
        Share of the surface that is foil, 0 to 1.
    """

    seed: int = 0
    foil: float = 0.0

    @cached_property
    def _lattices(self) -> list[Float[np.ndarray, "n n n"]]:
        generator = np.random.default_rng([self.seed, 15])
        return [generator.random((LATTICE,) * 3, dtype=np.float32) for _ in CELLS_M]

    def albedo(self, points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, " k"]:
        """Share of the light that a rough surface reflects at points of the body, m."""
        mixed = sum(
            share * self._noise(level, points, cell)
            for level, (cell, share) in enumerate(zip(CELLS_M, SHARES, strict=True))
        )
        steep = 0.5 + np.tanh(CONTRAST * 2 * (np.asarray(mixed) - 0.5)) / 2
        return DARKEST + (BRIGHTEST - DARKEST) * steep

    def is_foil(self, points: Float[np.ndarray, "k 3"]) -> Bool[np.ndarray, " k"]:
        """Mask of points where the surface is foil."""
        if not self.foil:
            return np.zeros(len(points), dtype=bool)
        patches = self._noise(0, points + 0.5, 0.05)
        return patches < 0.5 + 0.35 * (2 * self.foil - 1)

    def crinkled(
        self, points: Float[np.ndarray, "k 3"], normals: Float[np.ndarray, "k 3"]
    ) -> Float[np.ndarray, "k 3"]:
        """Unit normals of foil."""
        bumps = [self._noise(level, points + 0.25, 0.012) - 0.5 for level in range(3)]
        bent = normals + 0.8 * np.stack(bumps, axis=1)
        return bent / np.linalg.norm(bent, axis=1, keepdims=True)

    def _noise(self, level: int, points: Float[np.ndarray, "k 3"], cell: float) -> Float[np.ndarray, " k"]:
        """Trilinear noise in 0..1 of blotches of one size."""
        return map_coordinates(self._lattices[level], points.T / cell, order=1, mode="grid-wrap")


MOST_FACES: Final = 500_000
SMOOTH_FACES: Final = 200
"""Of a mesh with more faces the normals are interpolated between its vertices: it approximates a curved surface."""


def corner_normals(mesh: TriangleMesh) -> Float[np.ndarray, "f 3 3"]:
    """Outward unit normal at each corner of each face.

    It is that of the face, or of a smooth surface (`SMOOTH_FACES`).
    """
    if len(mesh.triangles) <= SMOOTH_FACES:
        return np.repeat(mesh.normals[:, None], 3, axis=1)
    sums = np.zeros_like(mesh.vertices)
    for corner in range(3):
        np.add.at(sums, mesh.triangles[:, corner], mesh.area_vectors)
    lengths = np.linalg.norm(sums, axis=-1, keepdims=True)
    return (sums / np.maximum(lengths, np.finfo(float).tiny))[mesh.triangles]


def named_mesh(shape: str, radius: float) -> TriangleMesh:
    """A polyhedron of `POLYHEDRA`, or the mesh of a file, centred in its bounding box.

    The farthest vertex is at ``radius`` m from the centre, and triangles face outwards.

    Raises
    ------
    InputError
        No such polyhedron nor file; as `read_mesh`; too few or too many triangles.
    """
    if shape in POLYHEDRA:
        points = np.array(POLYHEDRA[shape], dtype=float)
        hull = ConvexHull(points)
        faces = hull.simplices.astype(np.int64)
        a, b, c = (points[faces[:, k]] for k in range(3))
        inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
        faces[inward] = faces[inward][:, ::-1]
        return _scaled_to(TriangleMesh(points, faces), radius)
    path = Path(shape)
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise InputError(
            f"shape {value_text(shape)} is unknown; use {', '.join(POLYHEDRA)} or a file {', '.join(MESH_SUFFIXES)}"
        )
    mesh = read_mesh(path)
    if not 4 <= len(mesh.triangles) <= MOST_FACES:
        raise InputError(
            f"{path_text(path)}: has {len(mesh.triangles)} faces; give 4 to {MOST_FACES} triangles"
        )
    volume = np.einsum("fi,fi->", mesh.corners[:, 0], mesh.area_vectors)
    return _scaled_to(mesh if volume >= 0 else TriangleMesh(mesh.vertices, mesh.triangles[:, ::-1]), radius)


def _scaled_to(mesh: TriangleMesh, radius: float) -> TriangleMesh:
    centred = mesh.vertices - (mesh.vertices.max(axis=0) + mesh.vertices.min(axis=0)) / 2
    return TriangleMesh(centred * (radius / np.linalg.norm(centred, axis=1).max()), mesh.triangles)


_CUBE = list(product((-1.0, 1.0), repeat=3))
_TRUNCATED = sorted(
    {p for signs in product((-1, 1), repeat=2) for p in permutations((0, signs[0] * 1, signs[1] * 2))}
)
_RHOMBIC = sorted(
    {p for s in product((-1, 1), repeat=3) for p in permutations((s[0] * 1.0, s[1] * 1.0, s[2] * 2.414))}
)
POLYHEDRA: Final[dict[str, list[tuple[float, ...]]]] = {
    "spheres": _RHOMBIC,
    "box": [(1.0 * x, 0.8 * y, 0.65 * z) for x, y, z in _CUBE],
    "octahedron": [tuple(map(float, corner)) for corner in _TRUNCATED],
}
"""Vertices of convex bodies by name: a rhombicuboctahedron (18 squares, as on SPHERES), a box, a truncated octahedron."""


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
    mesh : TriangleMesh
        In frame g, m.
    texture : SurfaceTexture
        Of the surface.
    sun : tuple[float, float, float]
        Direction to the sun, frame i.
    ambient : float
        Light from everywhere, as a share of the sun's.
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
    K : ndarray of shape (3, 3)
        Camera matrix, in samples.
    shape : tuple[int, int]
        Rows and columns of samples.
    R_ic, t_ic : ndarray of shape (3, 3), ndarray of shape (3,)
        Pose of the camera in i, m.
    """

    K: Float[np.ndarray, "3 3"]
    shape: tuple[int, int]
    R_ic: Float[np.ndarray, "3 3"]
    t_ic: Float[np.ndarray, " 3"]


def body_image(
    body: Appearance, R_ig: Float[np.ndarray, "3 3"], t_ig: Float[np.ndarray, " 3"], view: View
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """Radiance and depth of each sample of the image; a body behind the camera is not seen.

    Parameters
    ----------
    body : Appearance
        Mesh and materials of the body.
    R_ig, t_ig : ndarray of float, shapes (3, 3) and (3,)
        Its pose; the origin in m.
    view : View
        Camera, its pose in i, and the number of samples.

    Returns
    -------
    radiance : ndarray of float, shape (h, w)
        1 is white in the sun.
    depth : ndarray of float, shape (h, w)
        Along the optical axis, m; 0 where nothing is seen.
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
        # Weights in the image plane over the depth of each corner are weights in space, up to their sum.
        weights = surface.weights * nearness[surface.face[seen]]
        weights /= weights.sum(axis=1, keepdims=True)
        radiance[seen] = _shaded(body, R_ig, t_ig, _Samples(surface.face[seen], weights), view)
    return radiance, depth


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
    """Whether surface points (frame g) are shadowed: they lie behind the surface that a shadow map of the mesh holds."""
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
