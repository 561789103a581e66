"""Rays per second of the lidar's tracer beside trimesh's, interleaved, best of several.

    python -m experiments.benchmarks.lidar_tracer [--rays 400]

trimesh (extra ``peers``) uses Embree, in float32, where embreex is installed, else an R-tree.
"""

import argparse
from collections.abc import Callable
from functools import partial
from time import perf_counter

import numpy as np

from experiments.command_line import run_study
from spinfilters.core.ray_angles import unit_vectors
from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.lidar.scan import RayPattern
from spinfilters.simulation.lidar_scanner import ray_tracer

MESHES = (16, 143)
"""Parallels of a bumpy ball: about 1000 and 82,000 triangles."""
ROUNDS = 7


def bumpy_ball(parallels: int) -> TriangleMesh:
    """A closed surface of 4 n (n - 1) triangles."""
    n, m = parallels, 2 * parallels
    theta, phi = np.meshgrid(np.linspace(0, np.pi, n + 1)[1:-1], 2 * np.pi * np.arange(m) / m, indexing="ij")
    radius = 1 + 0.1 * np.sin(5 * theta) * np.cos(7 * phi)
    ring = (
        np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
        * radius[..., None]
    )
    vertices = np.concatenate([ring.reshape(-1, 3), [[0, 0, 1.0], [0, 0, -1.0]]])
    k = np.arange((n - 2) * m)
    right = k - k % m + (k + 1) % m
    low, low_right = k + m, right + m
    j, after, last = np.arange(m), (np.arange(m) + 1) % m, (n - 2) * m
    top, bottom = np.full(m, (n - 1) * m), np.full(m, (n - 1) * m + 1)
    parts = [(k, low, low_right), (k, low_right, right), (top, j, after), (bottom, last + after, last + j)]
    return TriangleMesh(vertices, np.concatenate([np.stack(part, axis=1) for part in parts]))


def main() -> None:
    """Print a line per mesh."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rays", type=int, default=400, help="in azimuth and in elevation")
    side = parser.parse_args().rays
    angles = RayPattern((12.6, 12.6), (side, side)).directions()
    directions = unit_vectors(angles.azimuth, angles.elevation)
    origins = np.broadcast_to(np.array([-10.0, 0.0, 0.0]), directions.shape).copy()
    for parallels in MESHES:
        mesh = bumpy_ball(parallels)
        ours = partial(ray_tracer(mesh).hits, origins, directions)
        runs: dict[str, Callable[[], object]] = {"ours": ours, **_peer(mesh, origins, directions)}
        seconds = dict.fromkeys(runs, np.inf)
        for _ in range(ROUNDS):
            for name, run in runs.items():
                begin = perf_counter()
                run()
                seconds[name] = min(seconds[name], perf_counter() - begin)
        told = ", ".join(f"{name} {len(directions) / s / 1e6:.2f} Mrays/s" for name, s in seconds.items())
        print(f"{len(mesh.triangles)} triangles, watertight {mesh.is_watertight}: {told}")


def _peer(mesh: TriangleMesh, origins: np.ndarray, directions: np.ndarray) -> dict[str, Callable[[], object]]:
    """trimesh where it can trace."""
    try:
        import trimesh  # pyright: ignore[reportMissingImports]

        peer = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
        peer.ray.intersects_location(origins[:1], directions[:1], multiple_hits=False)
    except ImportError as error:
        print(f"trimesh is not compared: {error}")
        return {}
    name = f"trimesh ({type(peer.ray).__module__.rsplit('.', 1)[-1]})"
    return {name: lambda: peer.ray.intersects_location(origins, directions, multiple_hits=False)}


if __name__ == "__main__":
    run_study(main)
