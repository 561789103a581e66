"""The steps of an epoch in the C of `epoch.c`, which is compiled once for every number of modes and precision."""

import ctypes
from functools import cache
from importlib.resources import files
from operator import is_

import numpy as np
from jaxtyping import Float, Int

from spinfilters.estimators.gain import LOG_2_PI, Correction
from spinfilters.estimators.landmarks.reference import NEW_LANDMARK_SHARE, NumpySteps
from spinfilters.estimators.landmarks.steps import Closing, NewModes, Steps, Stored, WhitenedRows
from spinfilters.estimators.smoothing.native import KERNEL_FLAGS
from spinfilters.symbolic.c_library import load_text
from spinfilters.symbolic.compiled import address

FLAGS = (*KERNEL_FLAGS, "-fassociative-math", "-fno-signed-zeros", "-fno-trapping-math")
"""Sums may be taken in any order, so that they are vectorised; what is not finite stays so."""
SHAPE = (3, 6)
"""Components of an observation, and columns of the state that it depends on: of a stereo pair; others go through NumPy."""
LARGEST_STATE = 32
"""Rows of the factor beside the modes: state and move."""
_TYPES = {"i": ctypes.c_longlong, "d": ctypes.c_double, "p": ctypes.c_void_p}
_SIGNATURES = {
    "refresh": "ipii" + "ppppppp",
    "compose": "i" + "pppppp",
    "whiten": "i" + "ppppppppp",
    "correct": "ii" + "pppppp",
    "compress": "ipp" + "ipdi" + "pppp",
    "observe": "i" + "pppppp" + "i" + "pppp",
    "settle_new": "i" + "ppppp",
    "close_epoch": "ipppppippdi" + "ppppppiiiii" + "ppppppp",
}


def steps_of(modes: int, precision: str) -> Steps:
    """The steps for so many modes, kept in this precision: in C where there is a compiler."""
    library = _library(modes, precision)
    return NumpySteps() if library is None else NativeSteps(library, precision)


@cache
def _library(modes: int, precision: str) -> ctypes.PyDLL | None:
    kind = {"float64": "double", "float32": "float"}[precision]
    sizes = f"enum {{ D = {SHAPE[0]}, C = {SHAPE[1]}, M = {modes}, N = M + {LARGEST_STATE} }};\n"
    body = files("spinfilters.estimators.landmarks").joinpath("epoch.c").read_text()
    library = load_text(f"landmark_epoch_{modes}", f"typedef {kind} stored;\n{sizes}{body}", FLAGS)
    if library is not None:
        for name, arguments in _SIGNATURES.items():
            function = getattr(library, name)
            function.argtypes = [_TYPES[letter] for letter in arguments]
            function.restype = ctypes.c_double if name == "correct" else None
    return library


class NativeSteps(Steps):
    """See `reference.NumpySteps`, which says what is computed."""

    def __init__(self, library: ctypes.PyDLL, precision: str) -> None:
        self._c, self._kept = library, np.dtype(precision)
        self._reference = NumpySteps()
        self._known: tuple[np.ndarray, ...] = ()
        self._places: tuple[int, ...] = ()

    def _stored(self, stored: Stored) -> tuple[int, ...]:
        """Where epoch, transform, spread, shift, points, modes and roots lie; looked up when they are other arrays."""
        arrays = (
            stored.epoch,
            stored.transform,
            stored.spread,
            stored.shift,
            stored.points,
            stored.modes,
            stored.roots,
        )
        if len(self._known) != len(arrays) or not all(map(is_, arrays, self._known)):
            self._known, self._places = arrays, tuple(map(address, arrays))
        return self._places

    def refresh(self, stored: Stored, rows: Int[np.ndarray, " q"]) -> None:
        rows = np.ascontiguousarray(rows)
        self._c.refresh(len(rows), address(rows), stored.now, len(stored.shift), *self._stored(stored))

    def compose(
        self,
        stored: Stored,
        transform: Float[np.ndarray, "r r"],
        dropped: Float[np.ndarray, "r c"],
        shift: Float[np.ndarray, " r"],
    ) -> None:
        if dropped.shape[1] != SHAPE[1]:
            self._reference.compose(stored, transform, dropped, shift)
            return
        step = [np.ascontiguousarray(array) for array in (transform, dropped, shift)]
        kept = (stored.transform, stored.spread, stored.shift)
        self._c.compose(len(stored.shift), *map(address, (*step, *kept)))

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
        rows = np.empty((k, d, width - 3 + stored.modes.shape[2]))
        made = rows, np.empty((k, d, 3)), np.empty((k, d, 3)), np.empty(k)
        given = [np.ascontiguousarray(array) for array in (linear, weights, at)]
        self._c.whiten(k, *map(address, given), *self._stored(stored)[-2:], *map(address, made))
        return WhitenedRows(*made)

    def corrected(
        self,
        rows: Float[np.ndarray, "k d w"],
        factor: Float[np.ndarray, "N N"],
        columns: Int[np.ndarray, " q"],
    ) -> Correction:
        n, k, d = len(factor), rows.shape[0], rows.shape[1]
        if not self._fits(d, columns, n, rows.shape[2]):
            return self._reference.corrected(rows, factor, columns)
        after, root, shift, error = np.array(factor), np.empty((n, n)), np.empty(n + 1), np.empty(n)
        nis = self._c.correct(k, n, *map(address, (rows, columns, after, root, shift, error)))
        likelihood = -0.5 * (nis + k * d * LOG_2_PI) - shift[n]
        return Correction(error, after, nis, likelihood, k * d, root, shift[:n])

    def compress(
        self,
        white: WhitenedRows,
        new: Float[np.ndarray, "q 3 c"],
        factor: Float[np.ndarray, "p N"],
        remembered: Float[np.ndarray, " r"],
    ) -> NewModes:
        k, d, _ = white.rows.shape
        r, n = len(remembered), factor.shape[1]
        c = len(factor) - r
        if (d, c) != SHAPE or n > r + LARGEST_STATE:
            return self._reference.compress(white, new, factor, remembered)
        explained = np.array(remembered)
        made = np.empty((c + r, c + r)), np.empty((r, n))
        new, factor = np.ascontiguousarray(new), np.ascontiguousarray(factor)
        self._c.compress(
            k,
            address(white.rows),
            address(white.spread),
            len(new),
            address(new),
            NEW_LANDMARK_SHARE,
            n,
            *map(address, (factor, explained, *made)),
        )
        return NewModes(*made, explained)

    def observe(
        self,
        stored: Stored,
        at: Int[np.ndarray, " k"],
        white: WhitenedRows,
        error: Float[np.ndarray, " q"],
        new: NewModes,
    ) -> None:
        if (white.rows.shape[1], new.dropped.shape[1]) != SHAPE:
            self._reference.observe(stored, at, white, error, new)
            return
        at, error = np.ascontiguousarray(at), np.ascontiguousarray(error)
        arrays = (white.rows, white.spread, white.gram, at, error, new.turned)
        self._c.observe(
            len(at),
            *map(address, arrays),
            stored.now,
            *map(address, (stored.epoch, stored.points, stored.modes, stored.roots)),
        )

    def settled(
        self, by_pose: Float[np.ndarray, "q 3 c"], roots: Float[np.ndarray, "q 3 3"], new: NewModes
    ) -> tuple[Float[np.ndarray, "q 3 r"], Float[np.ndarray, "q 3 3"]]:
        (k, _, c), r = by_pose.shape, len(new.rows)
        if c != SHAPE[1]:
            return self._reference.settled(by_pose, roots, new)
        made = np.empty((k, 3, r), self._kept), np.empty((k, 3, 3), self._kept)
        given = np.ascontiguousarray(by_pose), np.ascontiguousarray(roots), new.turned
        self._c.settle_new(k, *map(address, (*given, *made)))
        return made

    def close(
        self, stored: Stored, closing: Closing
    ) -> tuple[NewModes, Float[np.ndarray, "q 3 r"], Float[np.ndarray, "q 3 3"]]:
        white, r, n = closing.white, len(closing.remembered), closing.factor.shape[1]
        k, c = len(closing.by_pose), closing.by_pose.shape[2]
        if (white.rows.shape[1], c) != SHAPE or n > r + LARGEST_STATE:
            return self._reference.close(stored, closing)
        made = closing.remembered.copy(), np.empty((c + r, c + r)), np.empty((r, n))
        new = np.empty((k, 3, r), self._kept), np.empty((k, 3, 3), self._kept)
        seen = (white.rows, white.spread, white.gram, np.ascontiguousarray(closing.at), closing.error)
        fresh = np.ascontiguousarray(closing.by_pose), np.ascontiguousarray(closing.roots)
        self._c.close_epoch(
            len(closing.at),
            *map(address, seen),
            k,
            *map(address, fresh),
            NEW_LANDMARK_SHARE,
            n,
            *map(address, (closing.factor, *made, *new)),
            stored.count,
            *closing.behind,
            len(stored.shift),
            stored.now,
            *self._stored(stored),
        )
        stored.now += 1
        return NewModes(made[1], made[2], made[0]), *new

    def _fits(self, d: int, columns: Int[np.ndarray, " q"], n: int, width: int) -> bool:
        modes = len(columns) - SHAPE[1]
        return d == SHAPE[0] and width == len(columns) + 1 and n <= modes + LARGEST_STATE
