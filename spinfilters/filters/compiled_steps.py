"""Prediction, update and steps of the landmarks in compiled C: `correction.c`, `update.c`, `epoch.c`.

Compiled once for every size of state, of a sensor's columns, and of the modes that landmarks share. Without a compiler NumPy
does the same.
"""

import ctypes
from collections.abc import Sequence
from functools import cache, lru_cache
from importlib.resources import files
from operator import is_
from typing import Any, Final, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.c_library import LANES, Signature, load_text, with_signatures
from spinfilters.core.compiled import address
from spinfilters.filters.estimator import Measurement
from spinfilters.filters.landmark_steps import (
    NEW_LANDMARK_SHARE,
    ClosedEpoch,
    Closing,
    LandmarkArrays,
    LinearisedObservations,
    MapObservations,
    NewModes,
    NumpySteps,
    PoseSpread,
    WhitenedLandmarks,
)
from spinfilters.filters.measurement_prediction import SigmaPoints
from spinfilters.filters.square_root import FLAGS, LOG_2_PI, Correction, correction_text
from spinfilters.models.measurement import MeasurementModel

LARGEST_STATE: Final = 64
"""Errors of a state; larger ones go through NumPy."""
MOST_DIM: Final = 8
"""Components of an innovation."""
MOST_NOISE: Final = 24
"""Columns of the noise that a prediction takes in."""
_SIGNATURES: Final = {
    "update": Signature("pipppddppp", ctypes.c_longlong),
    "propagate": Signature("pppip", None),
}
POSE_COLUMNS: Final = 6
"""Errors that most sensors depend on: their library propagates too."""
MODELS: Final = 64
"""Sensor models whose addresses are kept."""


@cache
def _library(columns: int, size: int) -> ctypes.PyDLL | None:
    text = correction_text({"C": columns, "M": 0, "N": size})
    text += files("spinfilters.filters").joinpath("update.c").read_text()
    return with_signatures(load_text(f"filter_update_{columns}_{size}", text, FLAGS), _SIGNATURES)


class Update(NamedTuple):
    """Outcome of an update: corrected mean (m,), correction, and covariance factor (n, n) about that mean."""

    mean: Float[np.ndarray, " m"]
    correction: Correction
    factor: Float[np.ndarray, "n n"]


class CompiledUpdate:
    """Compiled EKF updates by one measurement model.

    Attributes
    ----------
    model_address, update_address : int
        Of the structure `Model` and of the function `update`, for other compiled code.
    columns : int
        Errors that the measurement depends on.
    """

    def __init__(self, model: MeasurementModel, library: ctypes.PyDLL, loops: Sequence[int]) -> None:
        n, self._point = model.layout.error_dim, model.layout.mean_dim
        self._size, self._dim, self._update = n, model.dim, library.update
        self._columns = np.array(model.columns, dtype=np.int64)
        sizes = (self._point, model.parameter_dim, model.value_dim, model.dim)
        self._model = np.array([*loops, address(self._columns), *sizes], dtype=np.int64)
        self._address, self._each = address(self._model), model.dim * (len(self._columns) + 1) + 2
        self.model_address, self.columns = self._address, len(self._columns)
        self.update_address = _function_address(library.update)

    def __call__(
        self,
        x: Float[np.ndarray, " m"],
        factor: Float[np.ndarray, "n n"],
        measurement: Measurement,
        scale: float,
        limit: float,
    ) -> Update | None:
        """The update by the values inside the gate; None where none is, or one is invalid.

        Parameters
        ----------
        scale : float
            Ratio of the noise covariance to the stated one.
        limit : float
            Squared Mahalanobis distance of the gate; negative where another rule than a gate applies.
        """
        count, n = len(measurement.values), self._size
        if not count or limit < 0 or factor.shape != (n, n):
            return None
        room, made = np.empty(count * self._each), np.empty(3 + 2 * n + 3 * n * n + self._point)
        given = (x, measurement.parameters, measurement.values)
        x, parameters, values = (np.ascontiguousarray(array, dtype=float) for array in given)
        before = np.ascontiguousarray(factor)
        used = self._update(
            *(self._address, count, address(x), address(parameters), address(values), 1 / scale, limit),
            *(address(before), address(room), address(made)),
        )
        return self._unpack_update(made, used * self._dim) if used else None

    def _unpack_update(self, made: Float[np.ndarray, " k"], dof: int) -> Update:
        """Result of a compiled update, read from its structure `Made`."""
        n, begin = self._size, 3 + 2 * self._size
        nis, log_noise, log_root = float(made[0]), float(made[1]), float(made[begin - 1])
        # Made: nis, log noise, error (n), shift (n), log root, then three n x n matrices and the mean.
        factor, root, reset = made[begin : begin + 3 * n * n].reshape(3, n, n)
        likelihood = -0.5 * (nis + dof * LOG_2_PI) - log_root - log_noise
        error, shift = made[2 : 2 + n], made[2 + n : begin - 1]
        correction = Correction(error, factor, nis, likelihood, dof, root, shift)
        return Update(made[begin + 3 * n * n :], correction, reset)


def _function_address(function: Any) -> int:
    """Address of a function of a library, for other compiled code to call."""
    return ctypes.cast(function, ctypes.c_void_p).value or 0


@lru_cache(maxsize=MODELS)
def compiled_update(model: MeasurementModel) -> CompiledUpdate | None:
    """Compiled updates by a model; None without a compiler."""
    layout = model.layout
    if layout.error_dim > LARGEST_STATE or model.dim > MOST_DIM:
        return None
    loops = (model.linearisation.loop, layout.retraction.loop, layout.resetting.loop)
    library = _library(len(model.columns), layout.error_dim)
    if library is None or None in loops:
        return None
    return CompiledUpdate(model, library, [loop for loop in loops if loop is not None])


class CompiledPropagation:
    """Compiled propagation of covariance factors of one size, with its ``address`` for other compiled code."""

    def __init__(self, library: ctypes.PyDLL) -> None:
        self._propagate = library.propagate
        self.address = _function_address(library.propagate)

    def __call__(
        self,
        factor: Float[np.ndarray, "n n"],
        transition: Float[np.ndarray, "n n"],
        noise: Float[np.ndarray, "n k"],
    ) -> Float[np.ndarray, "n n"]:
        """See `spinfilters.filters.filter.propagate_factor`."""
        after = np.empty(factor.shape)
        given = [np.ascontiguousarray(array) for array in (factor, transition, noise)]
        self._propagate(*map(address, given), noise.shape[1], address(after))
        return after


@cache
def compiled_propagation(size: int) -> CompiledPropagation | None:
    """Compiled propagation for this error dimension; None without a compiler."""
    library = _library(POSE_COLUMNS, size) if size <= LARGEST_STATE else None
    return None if library is None else CompiledPropagation(library)


SHAPE = (3, 6)
"""Components of an observation, and columns of the state that it depends on: of a stereo pair; others go through NumPy."""
SAID = 5
"""Numbers that a correction by landmarks tells besides: log noise, NIS, and `LandmarkSteps.lever_squares`."""
ROWS_BESIDE_MODES = 48
"""Rows of the factor besides those of the modes: state and move."""
_EPOCH_SIGNATURES = {
    "refresh": Signature("ipiiiip", None),
    "whiten": Signature("ippppp", ctypes.c_double),
    "correct": Signature("iipp" + "pppp", ctypes.c_double),
    "sum_levers": Signature("ipippp", None),
    "solve": Signature("ippp" + "ipip" + "ddpppp" + "ip" + "pppp", ctypes.c_int),
    "solve_rows": Signature("ipppd" + "ppp" + "ip" + "pppp", ctypes.c_int),
    "regress": Signature("ippi" + "pipi" + "ppp" + "ppp", None),
    "close_epoch": Signature("ippp" + "ippd" + "iipppp" + "pppp" + "iiiiip", None),
}
_STORED = ("epoch", "hits", "wrong", "last", "transform", "spread", "shift", "points", "modes", "roots")


def steps_of(modes: int, precision: str) -> "NumpySteps | CompiledSteps":
    """Cached steps for a number of modes and a precision, compiled where possible."""
    library = _epoch_library(modes, precision)
    return NumpySteps() if library is None else CompiledSteps(library, modes, precision)


@cache
def _epoch_library(modes: int, precision: str) -> ctypes.PyDLL | None:
    kind = {"float64": "double", "float32": "float"}[precision]
    sizes = {"D": SHAPE[0], "C": SHAPE[1], "M": modes, "N": modes + ROWS_BESIDE_MODES}
    body = files("spinfilters.filters").joinpath("epoch.c").read_text()
    text = f"typedef {kind} stored;\n{correction_text(sizes)}{body}"
    return with_signatures(load_text(f"landmark_epoch_{modes}", text, FLAGS), _EPOCH_SIGNATURES)


class CompiledSteps:
    """Landmark steps in C, as `spinfilters.filters.landmark_steps.NumpySteps` defines them."""

    def __init__(self, library: ctypes.PyDLL, modes: int, precision: str) -> None:
        self._c, self._modes, self._kept = library, modes, np.dtype(precision)
        self._reference = NumpySteps()
        self._known: tuple[np.ndarray, ...] = ()
        self._places = (ctypes.c_void_p * len(_STORED))()

    def refresh(self, stored: LandmarkArrays, rows: Int[np.ndarray, " q"]) -> None:
        """Bring the chosen landmarks' transformations to the present epoch, in C."""
        rows = np.ascontiguousarray(rows)
        self._c.refresh(len(rows), address(rows), 0, 0, stored.now, len(stored.shift), self._map(stored))

    def whitened(
        self,
        stored: LandmarkArrays,
        at: Int[np.ndarray, " k"],
        linear: Float[np.ndarray, "k d w"],
        weights: Float[np.ndarray, " k"],
    ) -> WhitenedLandmarks:
        """Whitened rows as `NumpySteps.whitened`, in C."""
        k, d, width = linear.shape
        if (d, width - 4) != SHAPE:
            return self._reference.whitened(stored, at, linear, weights)
        width, groups = width - 3 + self._modes, -(-k // LANES)
        kept = np.empty((groups, d * (width + 6), LANES))
        given = [np.ascontiguousarray(array) for array in (linear, weights, at)]
        log_noise = self._c.whiten(k, *map(address, given), self._map(stored), address(kept))
        return WhitenedLandmarks(kept, (k, d, width), log_noise)

    def lever_squares(
        self, stored: LandmarkArrays, at: Int[np.ndarray, " k"], white: WhitenedLandmarks
    ) -> Float[np.ndarray, "3"]:
        """Sums of squares as `NumpySteps.lever_squares`, in C."""
        if white.levers is not None:
            return white.levers
        _, d, width = white.shape
        if (d, width - self._modes - 1) != SHAPE:
            return self._reference.lever_squares(stored, at, white)
        at, squares = np.ascontiguousarray(at), np.empty(3)
        self._c.sum_levers(
            *(len(white.kept), address(white.kept), len(at), address(at), self._map(stored), address(squares))
        )
        return squares

    def corrected(
        self,
        white: WhitenedLandmarks,
        factor: Float[np.ndarray, "N N"],
        columns: Int[np.ndarray, " q"],
        log_noise: float,
    ) -> Correction:
        """Square-root update by whitened rows, in C."""
        n, (k, d, _) = len(factor), white.shape
        if (d, len(columns) - self._modes) != SHAPE:
            return self._reference.corrected(white, factor, columns, log_noise)
        made = _allocate_correction(factor)
        nis = self._c.correct(k, n, *map(address, (white.kept, columns, *made)))
        return _correction(made, nis, k * d, white.log_noise + log_noise)

    def solved(
        self,
        observations: MapObservations,
        x: Float[np.ndarray, " m"],
        factor: Float[np.ndarray, "N N"],
        limit: float,
    ) -> tuple[Correction, WhitenedLandmarks] | None:
        """Linearisation and update in one pass in C, None where not possible."""
        o, n, d, c = observations, len(factor), *SHAPE
        k, loop, width = len(o.at), o.sensor.observation_rows.loop, c + self._modes + 1
        if not (k and loop) or (o.sensor.dim, len(o.columns) - self._modes) != SHAPE:
            return None
        kept, room = np.empty((-(-k // LANES), d * (width + 6), LANES)), np.empty(k * (d * (c + 4) + 3))
        made, said, given = _allocate_correction(factor), np.empty(SAID), (x, o.parameters, o.values, o.at)
        x, parameters, values, at = (np.ascontiguousarray(array) for array in given)
        behind_points = address(parameters) + 3 * parameters.itemsize
        if not self._c.solve(
            *(k, loop, address(x), behind_points, parameters.shape[1], address(values), values.shape[1]),
            *(address(at), 1 / o.scale, limit, self._map(o.landmarks)),
            *map(address, (room, said, kept)),
            n,
            *map(address, (o.columns, *made)),
        ):
            return None
        log_noise, nis = said[:2].tolist()
        white = WhitenedLandmarks(kept, (k, d, width), log_noise, said[2:])
        return _correction(made, nis, k * d, log_noise), white

    def solved_rows(
        self,
        observations: MapObservations,
        linear: Float[np.ndarray, "k d w"],
        log_noise: float,
        factor: Float[np.ndarray, "N N"],
        limit: float,
    ) -> tuple[Correction, WhitenedLandmarks] | None:
        """Whitening and update in one pass in C, None where not possible."""
        o, n, (k, d, width) = observations, len(factor), linear.shape
        if k == 0 or (d, width - 4) != SHAPE or limit < 0:
            return None
        width += self._modes - 3
        kept, made = np.empty((-(-k // LANES), d * (width + 6), LANES)), _allocate_correction(factor)
        said, weights = np.full(SAID, log_noise), np.full(k, 1 / o.scale)
        given = [np.ascontiguousarray(array) for array in (linear, weights, o.at)]
        if not self._c.solve_rows(
            *(k, *map(address, given), limit, self._map(o.landmarks), address(said), address(kept), n),
            *map(address, (o.columns, *made)),
        ):
            return None
        log_noise, nis = said[:2].tolist()
        white = WhitenedLandmarks(kept, (k, d, width), log_noise, said[2:])
        return _correction(made, nis, k * d, log_noise), white

    def regressed(
        self, observations: MapObservations, spread: PoseSpread, points: SigmaPoints
    ) -> LinearisedObservations | None:
        """Statistical linearisation of observations in C, None where not possible."""
        o, (d, c) = observations, SHAPE
        k, loop, pose = len(o.at), o.sensor.observation_innovations.loop, spread.pose
        if not (k and loop) or o.sensor.dim != d or pose.shape != (c, c) or not spread.is_solvable:
            return None
        step, mean, root = points.offsets[1, 0], points.mean_weights[:2], points.root_weights[:2]
        weights, parts = np.array([step, *mean, *root]), (spread.states, pose, spread.modes, spread.late)
        parts = [np.ascontiguousarray(array) for array in parts]
        x, parameters, values, at = parts[0], *map(np.ascontiguousarray, (o.parameters, o.values, o.at))
        behind_points = address(parameters) + 3 * parameters.itemsize
        rows, valid, log_noise = np.empty((k, d, c + 4)), np.empty(k), np.empty(k)
        self._c.regress(
            *(k, loop, (ctypes.c_void_p * len(parts))(*map(address, parts)), x.shape[1]),
            *(behind_points, parameters.shape[1], address(values), values.shape[1]),
            *(address(at), address(weights), self._map(o.landmarks)),
            *map(address, (rows, valid, log_noise)),
        )
        return LinearisedObservations(rows, valid > 0, log_noise)

    def close(self, stored: LandmarkArrays, closing: Closing) -> ClosedEpoch:
        """Close an epoch as `NumpySteps.close`, in C."""
        r, correction, (k, _, c) = len(closing.remembered), closing.correction, closing.by_pose.shape
        if (closing.white.shape[1], c) != SHAPE:
            return self._reference.close(stored, closing)
        states, n, after = len(closing.reset), len(correction.factor), np.empty(correction.factor.shape)
        new = NewModes(np.empty((c + r, c + r)), after[states : states + r], closing.remembered.copy())
        modes, roots = np.empty((k, 3, r), self._kept), np.empty((k, 3, 3), self._kept)
        given = (closing.at, correction.error, closing.columns, closing.reset, correction.factor)
        at, error, columns, reset, factor = map(np.ascontiguousarray, given)
        fresh = [np.ascontiguousarray(array) for array in (closing.by_pose, closing.roots)]
        places = [address(array) if k else None for array in (*fresh, modes, roots)]
        self._c.close_epoch(
            *(len(at), *map(address, (closing.white.kept, at, error)), k, *places[:2], NEW_LANDMARK_SHARE),
            *(n, states, *map(address, (columns, reset, factor, after, new.explained, new.turned))),
            *places[2:],
            *(stored.count, *closing.behind, len(stored.shift), stored.now, self._map(stored)),
        )
        stored.now += 1
        return ClosedEpoch(new, modes, roots, after)

    def _map(self, stored: LandmarkArrays) -> int:
        """Address of those of the map's arrays, looked up when they are other arrays."""
        arrays = tuple([getattr(stored, name) for name in _STORED])
        if not (self._known and all(map(is_, arrays, self._known))):
            self._known = arrays
            self._places[:] = list(map(address, arrays))
        return ctypes.addressof(self._places)


def _allocate_correction(factor: Float[np.ndarray, "N N"]) -> tuple[np.ndarray, ...]:
    """Room for a correction: the factor, which is corrected in place, root, shift and error."""
    n = len(factor)
    return np.array(factor, order="C"), np.empty((n, n)), np.empty(n + 1), np.empty(n)


def _correction(made: tuple[np.ndarray, ...], nis: float, dof: int, log_noise: float) -> Correction:
    after, root, shift, error = made
    likelihood = -0.5 * (nis + dof * LOG_2_PI) - float(shift[-1]) - log_noise
    return Correction(error, after, nis, likelihood, dof, root, shift[:-1])
