"""The tracer in the C of `tracer.c`; without a compiler the NumPy reference serves."""

import ctypes
import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float

from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.lidar.ray_tracing import EDGE_TOLERANCE, SMALLEST_SINE, BruteForceTracer, RayHits, RayTracer
from spinfilters.symbolic.c_library import FLAGS, NATIVE, load_text
from spinfilters.symbolic.compiled import address

_FLAGS = (
    *(flag for flag in FLAGS if "contract" not in flag),
    "-O3",
    NATIVE,
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fno-signed-zeros",
)
_FAR, _NODE, _PACKED = (
    1e300,
    8,
    12,
)  # as in tracer.c: distance of a miss, words of a node, numbers of a triangle
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
    library.trace.argtypes = [_I, *[_P] * 5, _D, _D, _P, _P]
    library.build_tree.restype = library.trace.restype = None
    return library


class NativeTracer:
    """A bounding-volume hierarchy over one mesh; see `ray_tracing.BruteForceTracer` for what is computed."""

    def __init__(self, mesh: TriangleMesh, library: ctypes.CDLL) -> None:
        count, corners = len(mesh.triangles), np.ascontiguousarray(mesh.corners)
        self._library, self._both_sides = library, 0.0 if mesh.is_watertight else 1.0
        self._nodes = np.empty((2 * count, _NODE))
        self._order, self._packed = np.empty(count, np.int64), np.empty((count, _PACKED))
        scratch = np.empty((count, 6))
        made = (self._nodes, self._order, self._packed, scratch)
        library.build_tree(count, address(corners), SMALLEST_SINE, *map(address, made))

    def hits(self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]) -> RayHits:
        """See `RayTracer`."""
        n, cores = len(directions), len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
        origins = np.ascontiguousarray(np.broadcast_to(origins, (n, 3)), dtype=np.float64)
        directions = np.ascontiguousarray(directions, dtype=np.float64)
        distance, triangle = np.empty(n), np.empty(n, np.int64)
        edges = np.linspace(0, n, max(1, min(8 * cores, n // _RAYS)) + 1).astype(int)

        def trace(first: int, end: int) -> None:
            """Trace the rays from first to before end."""
            rows = slice(first, end)
            given = (origins[rows], directions[rows], self._nodes, self._order, self._packed)
            made = (distance[rows], triangle[rows])
            tolerances = (EDGE_TOLERANCE, self._both_sides)
            self._library.trace(end - first, *map(address, given), *tolerances, *map(address, made))

        parts = edges[:-1].tolist(), edges[1:].tolist()
        if len(edges) == 2 or cores == 1:
            list(map(trace, *parts))
        else:
            with ThreadPoolExecutor(cores) as pool:
                list(pool.map(trace, *parts))
        distance[distance >= _FAR] = np.inf
        return RayHits(distance, triangle)
