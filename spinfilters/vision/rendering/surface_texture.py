"""Solid texture: grey value and foil as functions of the point of the body."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import map_coordinates

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
    seed: of the blotches.   foil: share of the surface that is foil, 0 to 1.
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
