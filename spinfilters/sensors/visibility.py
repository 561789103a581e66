"""Visibility of surface landmarks to a camera, and their re-detection."""

import ctypes
from functools import cache
from importlib.resources import files
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.symbolic.c_library import FLAGS, NATIVE, Signature, load_text, with_signatures
from spinfilters.symbolic.compiled import address

NEAREST_M: Final = 0.05
"""Depth in m below which nothing is in focus."""
_FLAGS: Final = (*FLAGS, "-O3", NATIVE, "-fno-math-errno", "-fno-trapping-math")
_SIGNATURES: Final = {
    "facing": Signature("iippppppp" + "dp", None),
    "recognised": Signature("iippppppp", None),
}


class Surface(NamedTuple):
    """Landmarks (k, 3) m and their outward unit normals (k, 3), frame g."""

    points: Float[np.ndarray, "k 3"]
    normals: Float[np.ndarray, "k 3"]


def facing(
    cosine: float,
    surface: Surface,
    rotations: Float[np.ndarray, "n 3 3"],
    origins: Float[np.ndarray, "n 3"],
) -> Bool[np.ndarray, "n k"]:
    """Landmarks that face the camera from beyond `NEAREST_M`.

    Normal and line to the camera have a larger cosine than this.

    Parameters
    ----------
    rotations, origins: of g in the camera's frame at every epoch, m.
    """
    camera = -np.einsum("nji,nj->ni", rotations, origins)  # its place in g
    least, library = NEAREST_M - origins[:, 2], _library()
    if library is None:
        return _facing_in_numpy(cosine, surface, camera, rotations[:, 2], least)
    points, normals = (np.ascontiguousarray(each.T) for each in surface)
    heights, squares = np.einsum("ik,ik->k", normals, points), np.square(points).sum(axis=0)
    found = np.empty((len(origins), len(heights)), dtype=bool)
    given = (points, normals, heights, squares, *map(np.ascontiguousarray, (camera, rotations[:, 2], least)))
    library.facing(*found.shape, *map(address, given), cosine, address(found))
    return found


def _facing_in_numpy(
    cosine: float,
    surface: Surface,
    camera: Float[np.ndarray, "n 3"],
    axes: Float[np.ndarray, "n 3"],
    least: Float[np.ndarray, " n"],
) -> Bool[np.ndarray, "n k"]:
    """Facing landmarks in NumPy.

    The same from places and optical axes of the camera in g and the least coordinate along the latter.
    """
    points, normals = surface
    heights, squares = np.einsum("ki,ki->k", normals, points), np.square(points).sum(axis=1)
    found = np.empty((len(camera), len(points)), dtype=bool)
    for row, c, axis, depth in zip(found, camera, axes, least, strict=True):  # an epoch stays in the cache
        distance = np.sqrt(points @ (-2.0 * c) + squares + c @ c)
        np.greater(normals @ c - heights, cosine * distance, out=row)
        row &= points @ axis > depth
    return found


def recognised(
    visible: Bool[np.ndarray, "n k"], drawn: Float[np.ndarray, "n k"], probability: Float[np.ndarray, " k"]
) -> Bool[np.ndarray, "n k"]:
    """The visible landmarks of those appearances in which they are known again.

    Parameters
    ----------
    drawn: of appearance a of landmark k at (a, k), compared with the landmark's probability.
    """
    library, count = _library(), visible.shape[1]
    if library is None:
        return _recognised_in_numpy(visible, drawn, probability)
    given = [np.ascontiguousarray(each) for each in (visible, drawn, probability)]
    appearances, marks, found = (
        np.zeros(count, np.int64),
        np.zeros((2, count + 8), bool),
        np.empty_like(given[0]),
    )
    library.recognised(*visible.shape, *map(address, (*given, appearances, *marks, found)))
    return found


def _recognised_in_numpy(
    visible: Bool[np.ndarray, "n k"], drawn: Float[np.ndarray, "n k"], probability: Float[np.ndarray, " k"]
) -> Bool[np.ndarray, "n k"]:
    known, appearances = np.empty_like(visible), np.zeros(visible.shape[1], dtype=np.intp)
    now, before = np.zeros((2, visible.shape[1]), dtype=bool)
    for row, seen in zip(known, visible, strict=True):
        new = np.flatnonzero(seen & ~before)
        now[new] = drawn[appearances[new], new] < probability[new]
        appearances[new] += 1
        np.logical_and(seen, now, out=row)
        before = seen
    return known


@cache
def _library() -> ctypes.PyDLL | None:
    text = files("spinfilters.sensors").joinpath("visibility.c").read_text()
    return with_signatures(load_text("visibility", text, _FLAGS), _SIGNATURES)
