"""Prediction and update of the EKF in compiled C (`update.c`).

Compiled once for every size of state and of a sensor's columns.
"""

import ctypes
from collections.abc import Sequence
from functools import cache, lru_cache
from importlib.resources import files
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.estimator import Measurement
from spinfilters.estimators.filters.square_root_update import LOG_2_PI, Correction
from spinfilters.models.measurement import MeasurementModel
from spinfilters.symbolic.c_library import (
    KERNEL_FLAGS,
    Signature,
    has_wide_vectors,
    load_text,
    with_signatures,
)
from spinfilters.symbolic.compiled import address

LOOSE_SUMS: Final = ("-fassociative-math", "-fno-signed-zeros", "-fno-trapping-math")
FLAGS: Final = (*KERNEL_FLAGS, *LOOSE_SUMS, "-fno-strict-aliasing", "-Wno-psabi")
"""Sums may be taken in any order, so that they are vectorised; what is not finite stays so."""
LANES: Final = 8 if has_wide_vectors() else 4
"""Numbers side by side: one vector. GCC takes a vector wider than the machine's apart, in 2 to 9 times the time."""
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


def correction_text(sizes: dict[str, int]) -> str:
    """C text of the measurement update for these sizes, to be continued."""
    numbers = ", ".join(f"{name} = {size}" for name, size in sizes.items())
    body = files("spinfilters.estimators.filters").joinpath("correction.c").read_text()
    return f"enum {{ {numbers}, LANES = {LANES} }};\n{body}"


@cache
def _library(columns: int, size: int) -> ctypes.PyDLL | None:
    text = correction_text({"C": columns, "M": 0, "N": size})
    text += files("spinfilters.estimators.filters").joinpath("update.c").read_text()
    return with_signatures(load_text(f"filter_update_{columns}_{size}", text, FLAGS), _SIGNATURES)


class Update(NamedTuple):
    """A point, its correction, and the covariance factor about it.

    (m,) and (n, n).
    """

    mean: Float[np.ndarray, " m"]
    correction: Correction
    factor: Float[np.ndarray, "n n"]


class CompiledUpdate:
    """Compiled EKF updates by one measurement model."""

    def __init__(self, model: MeasurementModel, library: ctypes.PyDLL, loops: Sequence[int]) -> None:
        n, self._point = model.layout.error_dim, model.layout.mean_dim
        self._size, self._dim, self._update = n, model.dim, library.update
        self._columns = np.array(model.columns, dtype=np.int64)
        sizes = (self._point, model.parameter_dim, model.value_dim, model.dim)
        self._model = np.array([*loops, address(self._columns), *sizes], dtype=np.int64)
        self._address, self._each = address(self._model), model.dim * (len(self._columns) + 1) + 2

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
        scale: of the noise covariance, over the stated one.   limit: of the gate, a squared distance; negative for another rule.
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
        return self._taken(made, used * self._dim) if used else None

    def _taken(self, made: Float[np.ndarray, " k"], dof: int) -> Update:
        """Result of a compiled update, read from its structure `Made`."""
        n, begin = self._size, 3 + 2 * self._size
        nis, log_noise, log_root = float(made[0]), float(made[1]), float(made[begin - 1])
        factor, root, reset = made[begin : begin + 3 * n * n].reshape(3, n, n)
        likelihood = -0.5 * (nis + dof * LOG_2_PI) - log_root - log_noise
        error, shift = made[2 : 2 + n], made[2 + n : begin - 1]
        correction = Correction(error, factor, nis, likelihood, dof, root, shift)
        return Update(made[begin + 3 * n * n :], correction, reset)


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
    """Compiled propagation of covariance factors of one size."""

    def __init__(self, library: ctypes.PyDLL) -> None:
        self._propagate = library.propagate

    def __call__(
        self,
        factor: Float[np.ndarray, "n n"],
        transition: Float[np.ndarray, "n n"],
        noise: Float[np.ndarray, "n k"],
    ) -> Float[np.ndarray, "n n"]:
        """See `spinfilters.estimators.filters.multiplicative_filter.propagated`."""
        after = np.empty(factor.shape)
        given = [np.ascontiguousarray(array) for array in (factor, transition, noise)]
        self._propagate(*map(address, given), noise.shape[1], address(after))
        return after


@cache
def compiled_propagation(size: int) -> CompiledPropagation | None:
    """Compiled propagation for this error dimension; None without a compiler."""
    library = _library(POSE_COLUMNS, size) if size <= LARGEST_STATE else None
    return None if library is None else CompiledPropagation(library)
