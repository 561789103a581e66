"""Rays per second of processor time of the lidar's tracer beside raw Embree, in turn, medians.

    python -m experiments.benchmarks.lidar_tracer [--rays 400] [--rounds 15]

Embree (extra ``peers``: embreex, whose calls are thin) traces in single precision on one thread, ours in double on all.
"""

import argparse
from collections.abc import Callable
from functools import partial
from importlib import import_module
from statistics import median
from typing import Any, Final

import numpy as np

from experiments.benchmarks.stopwatch import begin_benchmark, now
from experiments.command_line import run_study
from spinfilters.core.ray_angles import unit_vectors
from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.lidar.scan import RayPattern
from spinfilters.simulation.lidar_scanner import ray_tracer

try:
    embreex_scene: Any = import_module(
        "embreex.rtcore_scene"
    )  # by name: types are checked where it is not installed
except ImportError:
    embreex_scene = None

MISSING: Final = (
    "the peer Embree is not installed; type 'pip install embreex' (4.4 was measured), or leave this peer out"
)
TRIANGLES, DISTANCES = "Embree, triangles", "Embree, triangles and distances"
MESHES = (16, 143)
"""Parallels of a bumpy ball: about 1000 and 82,000 triangles."""


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
    parser.add_argument("--rounds", type=int, default=15)
    given = parser.parse_args()
    begin_benchmark("experiments.benchmarks.lidar_tracer")
    if embreex_scene is None:
        print(MISSING)
    for parallels in MESHES:
        seconds, triangles = tracing_times(parallels, given.rays, given.rounds)
        print(f"{triangles} triangles")
        ours = median(seconds["ours"])
        for name, each in seconds.items():
            told = f"{given.rays**2 / median(each) / 1e6:.2f} million rays a second"
            print(
                f"  {name:32} {told}"
                + ("" if name == "ours" else f", time over ours {median(each) / ours:.2f}")
            )


def tracing_times(parallels: int, side: int, rounds: int) -> tuple[dict[str, list[float]], int]:
    """Seconds of each tracer, round by round, for side x side rays at one mesh, and how many triangles that has."""
    angles = RayPattern((12.6, 12.6), (side, side)).directions()
    directions = unit_vectors(angles.azimuth, angles.elevation)
    origins = np.broadcast_to(np.array([-10.0, 0.0, 0.0]), directions.shape).copy()
    mesh = bumpy_ball(parallels)
    runs = {"ours": partial(ray_tracer(mesh).hits, origins, directions), **_peers(mesh, origins, directions)}
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for number in range(rounds):
        for name in list(runs)[:: 1 if number % 2 == 0 else -1]:
            begin = now()
            runs[name]()
            seconds[name].append(now() - begin)
    return seconds, len(mesh.triangles)


def _peers(
    mesh: TriangleMesh, origins: np.ndarray, directions: np.ndarray
) -> dict[str, Callable[[], object]]:
    """Embree with its own numbers, which are single: the triangles alone, and with distances, as ours has them."""
    if embreex_scene is None:
        return {}
    scene = embreex_scene.EmbreeScene()
    import_module("embreex.mesh_construction").TriangleMesh(scene, mesh.corners.astype(np.float32))
    single = origins.astype(np.float32), directions.astype(np.float32)
    return {TRIANGLES: lambda: scene.run(*single), DISTANCES: lambda: scene.run(*single, output=True)}


if __name__ == "__main__":
    run_study(main)
