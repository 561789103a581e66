"""Stereo points of a ball of landmarks with descriptors that tell them apart, without images."""

import numpy as np

from spinfilters.io.camera import PinholeCamera, StereoRig
from spinfilters.vision.stereo_matching import Features, StereoFeatures

RIG = StereoRig(PinholeCamera(466.7, 466.7, 320.0, 240.0, 640, 480), 0.09)
SIZE, RESIDUAL = 3.0, 0.1


class Ball:
    """Landmarks on a ball, each seen when it faces the camera.

    Descriptors of one landmark differ a little from epoch to epoch.
    """

    def __init__(self, count: int = 250, seed: int = 0, descriptor_dim: int = 64) -> None:
        self.generator = np.random.default_rng(seed)
        points = self.generator.standard_normal((count, 3))
        self.points = 0.11 * points / np.linalg.norm(points, axis=1, keepdims=True)
        self.look = _unit(self.generator.standard_normal((count, descriptor_dim)))

    def seen(
        self, R: np.ndarray, t: np.ndarray, pixel_std: float = 0.0, wrong: float = 0.0
    ) -> tuple[StereoFeatures, np.ndarray]:
        """Points of a pose, and which landmark each is; a share of the descriptors is that of another landmark."""
        at = self.points @ R.T + t
        facing = np.einsum("ni,ni->n", self.points @ R.T, -at) > 0.35 * 0.11 * np.linalg.norm(at, axis=1)
        rows = np.flatnonzero(facing)
        x, y, z = at[rows].T
        u = RIG.left.fx * x / z + RIG.left.cx
        values = np.stack(
            [u, RIG.left.fy * y / z + RIG.left.cy, u - RIG.left.fx * RIG.baseline_m / z], axis=1
        )
        values += pixel_std * self.generator.standard_normal(values.shape)
        shown = rows.copy()
        swapped = self.generator.random(len(rows)) < wrong
        shown[swapped] = self.generator.permutation(shown[swapped])
        noise = 0.05 * self.generator.standard_normal((len(rows), self.look.shape[1]))
        look = _unit(self.look[shown] + noise).astype(np.float32)
        n = len(rows)
        features = Features(values[:, :2], np.full(n, SIZE), np.zeros(n), look)
        return StereoFeatures(values, features, np.full(n, RESIDUAL)), rows


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
