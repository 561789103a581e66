"""The steps of an epoch in the C of `epoch.c`, which is compiled once for every number of modes and precision."""

import ctypes
from functools import cache
from importlib.resources import files
from operator import is_

import numpy as np
from jaxtyping import Float, Int

from spinfilters.estimators.gain import LOG_2_PI, Correction
from spinfilters.estimators.landmarks.reference import NEW_LANDMARK_SHARE, NumpySteps
from spinfilters.estimators.landmarks.steps import Closing, NewModes, Stored, WhitenedRows
from spinfilters.estimators.smoothing.native import KERNEL_FLAGS
from spinfilters.symbolic.c_library import load_text
from spinfilters.symbolic.compiled import address

FLAGS = (
    *KERNEL_FLAGS,
    "-fassociative-math",
    "-fno-signed-zeros",
    "-fno-trapping-math",
    "-fno-strict-aliasing",
    "-Wno-psabi",
)
"""Sums may be taken in any order, so that they are vectorised; what is not finite stays so."""
SHAPE = (3, 6)
"""Components of an observation, and columns of the state that it depends on: of a stereo pair; others go through NumPy."""
LARGEST_STATE = 32
"""Rows of the factor beside the modes: state and move."""
LANES = 8
"""Landmarks side by side (`epoch.c`)."""
_TYPES = {"i": ctypes.c_longlong, "d": ctypes.c_double, "p": ctypes.c_void_p}
_SIGNATURES = {
    "refresh": "ipiip",
    "whiten": "ippppp" + "p",
    "correct": "iipp" + "pppp",
    "close_epoch": "ippp" + "ippd" + "ip" + "ppppp" + "iiiiip",
}
_STORED = ("epoch", "hits", "wrong", "last", "transform", "spread", "shift", "points", "modes", "roots")


def steps_of(modes: int, precision: str) -> "NumpySteps | NativeSteps":
    """The steps for so many modes, kept in this precision: in C where there is a compiler."""
    library = _library(modes, precision)
    return NumpySteps() if library is None else NativeSteps(library, modes, precision)


@cache
def _library(modes: int, precision: str) -> ctypes.PyDLL | None:
    kind = {"float64": "double", "float32": "float"}[precision]
    sizes = (
        f"enum {{ D = {SHAPE[0]}, C = {SHAPE[1]}, M = {modes}, N = M + {LARGEST_STATE}, LANES = {LANES} }};\n"
    )
    body = files("spinfilters.estimators.landmarks").joinpath("epoch.c").read_text()
    library = load_text(f"landmark_epoch_{modes}", f"typedef {kind} stored;\n{sizes}{body}", FLAGS)
    if library is not None:
        for name, arguments in _SIGNATURES.items():
            function = getattr(library, name)
            function.argtypes = [_TYPES[letter] for letter in arguments]
            function.restype = ctypes.c_double if name == "correct" else None
    return library


class NativeSteps:
    """See `reference.NumpySteps`, which says what is computed."""

    def __init__(self, library: ctypes.PyDLL, modes: int, precision: str) -> None:
        self._c, self._modes, self._kept = library, modes, np.dtype(precision)
        self._reference = NumpySteps()
        self._known: tuple[np.ndarray, ...] = ()
        self._places = (ctypes.c_void_p * len(_STORED))()

    def refresh(self, stored: Stored, rows: Int[np.ndarray, " q"]) -> None:
        rows = np.ascontiguousarray(rows)
        self._c.refresh(len(rows), address(rows), stored.now, len(stored.shift), self._map(stored))

    def whitened(
        self,
        stored: Stored,
        at: Int[np.ndarray, " k"],
        linear: Float[np.ndarray, "k d w"],
        weights: Float[np.ndarray, " k"],
    ) -> WhitenedRows:
        k, d, width = linear.shape
        if (d, width - 4) != SHAPE:
            return self._reference.whitened(stored, at, linear, weights)
        width, groups = width - 3 + self._modes, -(-k // LANES)
        kept, said = _aligned(groups, d * (width + 6)), np.empty(2)
        given = [np.ascontiguousarray(array) for array in (linear, weights, at)]
        self._c.whiten(k, *map(address, given), self._map(stored), address(kept), address(said))
        return WhitenedRows(kept, (k, d, width), *said.tolist())

    def corrected(
        self,
        white: WhitenedRows,
        factor: Float[np.ndarray, "N N"],
        columns: Int[np.ndarray, " q"],
        log_noise: float,
    ) -> Correction:
        n, (k, d, _) = len(factor), white.shape
        if (d, len(columns) - self._modes) != SHAPE:
            return self._reference.corrected(white, factor, columns, log_noise)
        after, root, shift, error = np.array(factor), np.empty((n, n)), np.empty(n + 1), np.empty(n)
        nis = self._c.correct(k, n, *map(address, (white.kept, columns, after, root, shift, error)))
        likelihood = -0.5 * (nis + k * d * LOG_2_PI) - float(shift[n]) - white.log_noise - log_noise
        return Correction(error, after, nis, likelihood, k * d, root, shift[:n])

    def close(
        self, stored: Stored, closing: Closing
    ) -> tuple[NewModes, Float[np.ndarray, "q 3 r"], Float[np.ndarray, "q 3 3"]]:
        r, n, (k, _, c) = len(closing.remembered), closing.factor.shape[1], closing.by_pose.shape
        if (closing.white.shape[1], c) != SHAPE:
            return self._reference.close(stored, closing)
        new = NewModes(np.empty((c + r, c + r)), np.empty((r, n)), closing.remembered.copy())
        modes, roots = np.empty((k, 3, r), self._kept), np.empty((k, 3, 3), self._kept)
        at, by_pose, own = map(np.ascontiguousarray, (closing.at, closing.by_pose, closing.roots))
        self._c.close_epoch(
            len(at),
            *map(address, (closing.white.kept, at, closing.error)),
            k,
            *map(address, (by_pose, own)),
            NEW_LANDMARK_SHARE,
            n,
            *map(address, (closing.factor, new.explained, new.turned, new.rows, modes, roots)),
            stored.count,
            *closing.behind,
            len(stored.shift),
            stored.now,
            self._map(stored),
        )
        stored.now += 1
        return new, modes, roots

    def _map(self, stored: Stored) -> int:
        """Address of those of the map's arrays, looked up when they are other arrays."""
        arrays = tuple([getattr(stored, name) for name in _STORED])
        if not (self._known and all(map(is_, arrays, self._known))):
            self._known = arrays
            self._places[:] = list(map(address, arrays))
        return ctypes.addressof(self._places)


def _aligned(groups: int, size: int) -> Float[np.ndarray, "g s l"]:
    """Room for so many numbers of every group, that begins where a whole vector does."""
    count = groups * size * LANES
    room = np.empty(count + LANES)
    begin = -address(room) // 8 % LANES
    return room[begin : begin + count].reshape(groups, size, LANES)
