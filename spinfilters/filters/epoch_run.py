"""Consecutive epochs of a filter in one call of compiled C, `epoch_run.c`, to the numbers of single epochs.

A call ends before an epoch that needs more than the plain prediction and update: values hardly any of which pass the gate, or that
may repeat the image before, an update that must be iterated, a step with more substeps than any before, numbers that are not
finite. Without a compiler, with a robust loss, or while noise levels adapt, every epoch is taken by itself.
"""

import ctypes
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.core.c_library import FLAGS, Signature, load_text, with_signatures
from spinfilters.core.compiled import address
from spinfilters.filters.compiled_steps import (
    MOST_NOISE,
    CompiledPropagation,
    CompiledUpdate,
    compiled_propagation,
    compiled_update,
)
from spinfilters.filters.estimator import COUNTS, EpochRun, ProcessModel, SensorTimeline
from spinfilters.filters.flow_curvature import LONGEST_PAUSE, LONGEST_STEP, NEGLIGIBLE, SOFT, FlowCurvature
from spinfilters.filters.iterated_update import SAMPLE as LINEAR_SAMPLE
from spinfilters.filters.iterated_update import SMALLEST_RANGE, IterationOptions
from spinfilters.filters.measurement_prediction import SigmaPoints
from spinfilters.filters.noise_levels import NoiseAdaptation, PredictedMotion
from spinfilters.filters.outlier_rejection import AGREEING_SHARE, FEWEST_DUPLICATES, OutlierRejection
from spinfilters.filters.outlier_rejection import SAMPLE as DUPLICATE_SAMPLE
from spinfilters.filters.square_root import LARGEST_TRIANGLE, covariance_factor_address
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.rotation_integrator import LinearisedLoops
from spinfilters.models.state_blocks import ATTITUDE, MASS_DISTRIBUTION
from spinfilters.models.state_layout import StateLayout

_SIGNATURES: Final = {
    "take_in": Signature("pip" + "ip" + "pp" + "iipp", ctypes.c_longlong),
    "spread": Signature("pdpp" + "pppp", ctypes.c_longlong),
    "predict_belief": Signature("pdppip" + "pppp", ctypes.c_longlong),
}
ROWS: Final = ("mean", "factor", "nis", "log_likelihood", *COUNTS)


class _Sensor(ctypes.Structure):
    """`Sensor` of `epoch_run.c`."""

    _fields_ = (
        *(
            (name, ctypes.c_void_p)
            for name in ("model", "update", "parameters", "values", "first", "end", "before")
        ),
        ("before_count", ctypes.c_longlong),
        *((name, ctypes.c_double) for name in ("weight", "limit")),
        ("columns", ctypes.c_longlong),
        ("beside", ctypes.c_void_p),
    )


class _ManyPoints(ctypes.Structure):
    """`Points` of `filter_step.c`."""

    _fields_ = (
        *((name, ctypes.c_longlong) for name in ("constants", "fewest")),
        *((name, ctypes.c_void_p) for name in ("retract", "local", "find_constants", "step", "step_error")),
        ("nothing", ctypes.c_void_p),
    )


class _Sigma(ctypes.Structure):
    """`Sigma` of `filter_step.c`."""

    _fields_ = (
        ("points", ctypes.c_longlong),
        *((name, ctypes.c_void_p) for name in ("offsets", "mean_weights", "root_weights")),
    )


class _FlowCurvature(ctypes.Structure):
    """`Curvature` of `filter_step.c`."""

    _fields_ = (
        *((name, ctypes.c_longlong) for name in ("first", "count")),
        *(
            (name, ctypes.c_double)
            for name in ("turn", "soft", "longest_step", "negligible", "longest_pause")
        ),
    )


class _Filter(ctypes.Structure):
    """`Filter` of `filter_step.c`."""

    _fields_ = (
        *((name, ctypes.c_longlong) for name in ("n", "point", "noise", "errors", "loop_count")),
        *((name, ctypes.c_void_p) for name in ("limits", "loops", "densities", "scales")),
        ("tolerance", ctypes.c_double),
        ("propagate", ctypes.c_void_p),
        *((name, ctypes.c_longlong) for name in ("attitude", "position", "place", "rate")),
        *((name, ctypes.c_double) for name in ("iteration", "nearest")),
        *((name, ctypes.c_void_p) for name in ("points", "sigma", "curvature", "triangle")),
    )


class CompiledLoops(NamedTuple):
    """What `take_in` calls: its library, steps of the process, propagation of the factor, and an update for each sensor."""

    library: ctypes.PyDLL
    steps: LinearisedLoops
    propagation: CompiledPropagation
    updates: Sequence[CompiledUpdate]


class SensorLevel(NamedTuple):
    """Of a sensor in a run of epochs.

    Attributes
    ----------
    scale : float
        Ratio of its noise covariance to the stated one.
    limit : float
        Of its gate; negative: another rule applies.
    before : ndarray of float, shape (k, v)
        Values of its latest measurement, none before the first.
    """

    scale: float
    limit: float
    before: Float[np.ndarray, "k v"]


@dataclass(frozen=True)
class RunOptions:
    """What is the same in all epochs of a run.

    Attributes
    ----------
    noise_scales : ndarray of float, shape (k,)
        Factors of the columns of the process' noise factor.
    levels : tuple[SensorLevel, ...]
        One for each sensor of the run.
    iteration : IterationOptions
        When an update must be iterated; of no use to an unscented filter.
    points : SigmaPoints or None
        Of an unscented filter.
    curvature : FlowCurvature or None
        When beliefs are widened; None: never. Epochs that are taken in are noted there.
    """

    noise_scales: Float[np.ndarray, " k"]
    levels: tuple[SensorLevel, ...]
    iteration: IterationOptions
    points: SigmaPoints | None = None
    curvature: FlowCurvature | None = None


def run_options(
    layout: StateLayout,
    noise: NoiseAdaptation,
    outliers: OutlierRejection,
    models: Sequence[MeasurementModel],
    iteration: IterationOptions | None = None,
    points: SigmaPoints | None = None,
    curvature: FlowCurvature | None = None,
) -> RunOptions:
    """What is the same in all epochs to come, until noise levels adapt or a gate refuses too much."""
    guards = [outliers.of(model.name) for model in models]
    levels = tuple(
        SensorLevel(noise.measurement_scale(model.name), guard.limit(model.dim), guard.epochs.values)
        for model, guard in zip(models, guards, strict=True)
    )
    scales = noise.column_scales(layout)
    return RunOptions(scales, levels, iteration or IterationOptions(1), points, curvature)


def take_in(
    process: ProcessModel,
    mean: Float[np.ndarray, " m"],
    factor: Float[np.ndarray, "n n"],
    epochs: EpochRun,
    options: RunOptions,
    rows: Mapping[str, np.ndarray],
) -> int:
    """Take a filter through epochs from a belief on.

    Parameters
    ----------
    mean, factor : ndarray
        The belief before.
    rows : Mapping[str, ndarray]
        As of `spinfilters.filters.estimator.Estimator.take_in`.

    Returns
    -------
    int
        How many epochs were taken in.
    """
    call = EpochCall.of(process, epochs, options)
    if call is None:
        return 0
    dt, x, S = (np.ascontiguousarray(array, dtype=float) for array in (epochs.dt, mean, factor))
    places = (ctypes.c_void_p * len(ROWS))(*(address(rows[name]) for name in ROWS))
    curvature = options.curvature or FlowCurvature()
    stretch = curvature.stretch_left()
    done = call.library.take_in(
        *(ctypes.addressof(call.filter), len(call.sensors), ctypes.addressof(call.sensors)),
        *(
            len(dt),
            *map(address, (dt, x, S)),
            call.most,
            call.width,
            address(stretch),
            ctypes.addressof(places),
        ),
    )
    curvature.go_on(stretch)
    return done


class EpochCall(NamedTuple):
    """Arguments of the functions in C that all epochs share, and what keeps their arrays alive.

    Attributes
    ----------
    library : ctypes.PyDLL
        With `take_in` and `spread`.
    filter, sensors
        As C reads them.
    most : int
        Values of a sensor in an epoch at most.
    width : int
        Numbers of a linearised value at most.
    """

    library: ctypes.PyDLL
    filter: _Filter
    sensors: "ctypes.Array[_Sensor]"
    most: int
    width: int
    kept: tuple[Any, ...]

    @classmethod
    def of(cls, process: ProcessModel, epochs: EpochRun, options: RunOptions) -> "EpochCall | None":
        """The arguments; None where something compiled is missing, or a sensor has no plain gate."""
        found = compiled_loops(process, [part.every.model for part in epochs.sensors])
        if found is None or min(level.limit for level in options.levels) < 0:
            return None
        library, loops, propagation, updates = found
        given = [_RunArrays.of(*each) for each in zip(epochs.sensors, options.levels, strict=True)]
        points = _FilterPoints.of(process, len(loops.loops), options.points, options.curvature)
        if points is None:
            return None
        beside = [
            0 if options.points is None else part.every.model.innovations_beside.loop
            for part in epochs.sensors
        ]
        sensors = [
            _sensor(update, each, level, loop or 0)
            for update, each, level, loop in zip(updates, given, options.levels, beside, strict=True)
        ]
        if None in beside:
            return None
        scales = np.ascontiguousarray(options.noise_scales)
        chosen = _filter(process.layout, loops, scales, options.iteration, propagation.address)
        points.add_to(chosen)
        most = max(int((part.end - part.first).max(initial=0)) for part in epochs.sensors)
        widths = [part.every.model.dim * (len(part.every.model.columns) + 1) + 2 for part in epochs.sensors]
        kept = (given, loops, updates, scales, points)
        return cls(library, chosen, (_Sensor * len(sensors))(*sensors), most, max(widths), kept)


class CompiledPrediction:
    """Predictions of a first-order filter, each in one call."""

    def __init__(
        self, process: ProcessModel, library: ctypes.PyDLL, loops: LinearisedLoops, points: "_FilterPoints"
    ) -> None:
        propagation, n = compiled_propagation(process.layout.error_dim), process.layout.error_dim
        self._predict, self._shapes = (
            library.predict_belief,
            ((process.layout.mean_dim,), (n, n), (n, loops.noise_dim)),
        )
        self._scales = np.ones(MOST_NOISE)
        address_of = 0 if propagation is None else propagation.address
        self._filter = _filter(process.layout, loops, self._scales, IterationOptions(1), address_of)
        points.add_to(self._filter)
        self._address, self._kept = ctypes.addressof(self._filter), (points, loops, propagation)

    @classmethod
    def of(cls, process: ProcessModel, curvature: FlowCurvature) -> "CompiledPrediction | None":
        """For steps like those that were linearised so far; None where something compiled is missing."""
        library, loops = _library(), process.linearised_loops()
        if library is None or loops is None or loops.noise_dim > MOST_NOISE:
            return None
        points = _FilterPoints.of(process, len(loops.loops), None, curvature)
        if points is None or compiled_propagation(process.layout.error_dim) is None:
            return None
        return cls(process, library, loops, points)

    def __call__(
        self,
        mean: Float[np.ndarray, " m"],
        factor: Float[np.ndarray, "N N"],
        dt: float,
        scales: Float[np.ndarray, " k"],
        curvature: FlowCurvature,
    ) -> PredictedMotion | None:
        """The belief after dt; None where the step needs more than is built.

        Parameters
        ----------
        scales : ndarray of float, shape (k,)
            Factors of the columns of the noise factor.
        curvature : FlowCurvature
            Of the filter; it notes the step.
        """
        point, square, wide = self._shapes
        made = PredictedMotion(np.empty(point), np.empty(factor.shape), np.empty(square), np.empty(wide))
        x, S, stretch = np.ascontiguousarray(mean), np.ascontiguousarray(factor), curvature.stretch_left()
        self._scales[: len(scales)] = scales
        places = [address(array) for array in (x, S, stretch, *made)]
        if not self._predict(self._address, dt, *places[:2], len(S), *places[2:]):
            return None
        curvature.go_on(stretch)
        return made


class CompiledSpread:
    """Sigma points of an unscented filter after a step, in one call.

    Attributes
    ----------
    points : int
        How many there are.
    """

    def __init__(
        self, process: ProcessModel, points: SigmaPoints, library: ctypes.PyDLL, loops: LinearisedLoops
    ) -> None:
        found = _FilterPoints.of(process, len(loops.loops), points, None)
        assert found is not None
        self._library, self.points, self._noise_dim = library, len(points.offsets), loops.noise_dim
        scales = np.ones(MOST_NOISE)
        self._filter = _filter(process.layout, loops, scales, IterationOptions(1), 0)
        found.add_to(self._filter)
        self._address, self._kept = ctypes.addressof(self._filter), (found, scales, loops)

    @classmethod
    def of(cls, process: ProcessModel, points: SigmaPoints) -> "CompiledSpread | None":
        """For steps like those that were linearised so far; None where something compiled is missing."""
        library, loops = _library(), process.linearised_loops()
        if library is None or loops is None:
            return None
        if _FilterPoints.of(process, len(loops.loops), points, None) is None:
            return None
        return cls(process, points, library, loops)

    def __call__(
        self, mean: Float[np.ndarray, " m"], factor: Float[np.ndarray, "n n"], dt: float
    ) -> "SpreadPoints | None":
        """Points drawn about a mean along the columns of a factor, after dt > 0 s; None where the step needs more than is built."""
        n, x, S = len(factor), np.ascontiguousarray(mean), np.ascontiguousarray(factor)
        made = SpreadPoints(
            np.empty(len(x)), np.empty((self.points, n)), np.empty((n, n)), np.empty((n, self._noise_dim))
        )
        return made if self._library.spread(self._address, dt, *map(address, (x, S, *made))) else None


class SpreadPoints(NamedTuple):
    """Sigma points after a step.

    Attributes
    ----------
    mean : ndarray of float, shape (m,)
        Of the points.
    deviations : ndarray of float, shape (p, n)
        From it, weighted.
    transition, noise : ndarray of float, shape (n, n) and (n, k)
        Of the step linearised at the mean before it.
    """

    mean: Float[np.ndarray, " m"]
    deviations: Float[np.ndarray, "p n"]
    transition: Float[np.ndarray, "n n"]
    noise: Float[np.ndarray, "n k"]


def compiled_loops(process: ProcessModel, models: Sequence[MeasurementModel]) -> CompiledLoops | None:
    """Everything compiled that `take_in` calls, built or loaded where it was not; None where something of it is missing."""
    library, loops = _library(), process.linearised_loops()
    propagation = compiled_propagation(process.layout.error_dim)
    updates = [update for model in models if (update := compiled_update(model)) is not None]
    if library is None or loops is None or propagation is None or len(updates) < len(models):
        return None
    return CompiledLoops(library, loops, propagation, updates) if loops.noise_dim <= MOST_NOISE else None


class _RunArrays(NamedTuple):
    """A sensor's parameters, values, and first and end of each epoch, as C reads them."""

    parameters: np.ndarray
    values: np.ndarray
    first: np.ndarray
    end: np.ndarray
    before: np.ndarray

    @classmethod
    def of(cls, part: SensorTimeline, level: SensorLevel) -> "_RunArrays":
        every = part.every
        first, end = (np.ascontiguousarray(array, dtype=np.int64) for array in (part.first, part.end))
        parameters, values = (
            np.ascontiguousarray(array, dtype=float) for array in (every.parameters, every.values)
        )
        # an image of another shape repeats nothing
        alike = level.before.shape[1:] == values.shape[1:]
        before = np.ascontiguousarray(level.before if alike else values[:0], dtype=float)
        return cls(parameters, values, first, end, before)


def _sensor(update: CompiledUpdate, given: _RunArrays, level: SensorLevel, beside: int) -> _Sensor:
    return _Sensor(
        update.model_address,
        update.update_address,
        *map(address, given),
        len(given.before),
        1 / level.scale,
        level.limit,
        update.columns,
        beside,
    )


class _FilterPoints(NamedTuple):
    """Points that a filter steps side by side, as C reads them; nothing of a filter without any."""

    triangle: int = 0
    points: _ManyPoints | None = None
    sigma: _Sigma | None = None
    curvature: _FlowCurvature | None = None
    kept: tuple[np.ndarray, ...] = ()

    @classmethod
    def of(
        cls, process: ProcessModel, limits: int, sigma: SigmaPoints | None, curvature: FlowCurvature | None
    ) -> "_FilterPoints | None":
        """Of an unscented filter, or one whose beliefs are widened; None where something compiled is missing."""
        if curvature is not None and not curvature.widens:
            curvature = None
        triangle = covariance_factor_address()
        if sigma is None and curvature is None:
            return cls(triangle or 0)
        layout, steps = process.layout, process.step_loops()
        retract, local = layout.many_retractions.loop, layout.many_differences.loop
        if steps is None or triangle is None or retract is None or local is None:
            return None
        nothing = np.zeros(steps.fewest << limits)
        points = _ManyPoints(
            *(steps.constant_dim, steps.fewest, retract, local),
            *(steps.constants, steps.substeps, steps.error, address(nothing)),
        )
        widened = None if curvature is None else _curvature(layout, curvature)
        if sigma is None:
            return cls(triangle, points, None, widened, (nothing,))
        # rows of sigma points have a column for each point and one for the innovation
        if len(sigma.offsets) >= LARGEST_TRIANGLE:
            return None
        arrays = [
            np.ascontiguousarray(array) for array in (sigma.offsets, sigma.mean_weights, sigma.root_weights)
        ]
        chosen = _Sigma(len(sigma.offsets), *map(address, arrays))
        return cls(triangle, points, chosen, widened, (nothing, *arrays))

    def add_to(self, of: _Filter) -> None:
        """Let a filter use them, as long as they are kept."""
        parts = (self.points, self.sigma, self.curvature)
        of.points, of.sigma, of.curvature = (0 if part is None else ctypes.addressof(part) for part in parts)
        of.triangle = self.triangle


def _curvature(layout: StateLayout, curvature: FlowCurvature) -> _FlowCurvature:
    soft = layout.slice(MASS_DISTRIBUTION.name) if layout.has(MASS_DISTRIBUTION) else slice(0, 0)
    limits = (SOFT, LONGEST_STEP, NEGLIGIBLE, LONGEST_PAUSE)
    return _FlowCurvature(soft.start, soft.stop - soft.start, curvature.turn, *limits)


def _filter(
    layout: StateLayout,
    loops: LinearisedLoops,
    scales: Float[np.ndarray, " k"],
    iteration: IterationOptions,
    propagation: int,
) -> _Filter:
    has_attitude, translates = layout.has(ATTITUDE), layout.translates
    return _Filter(
        *(layout.error_dim, layout.mean_dim, loops.noise_dim, loops.error_dim, len(loops.loops)),
        *map(address, (loops.limits, loops.loops, loops.densities, scales)),
        loops.tolerance,
        propagation,
        layout.slice("a").start if has_attitude else -1,
        layout.slice("t").start if translates else -1,
        layout.mean_slice("t").start if translates else -1,
        layout.mean_slice("w").start,
        math.inf if iteration.iterations == 1 else iteration.tolerance,
        SMALLEST_RANGE,
    )


@cache
def _library() -> ctypes.PyDLL | None:
    return with_signatures(load_text("epoch_run", epoch_run_text(), FLAGS), _SIGNATURES)


def epoch_run_text() -> str:
    """C text of `epoch_run.c` with what stands before it, to be continued."""
    numbers = f"FEWEST_DUPLICATES = {FEWEST_DUPLICATES}, DUPLICATE_SAMPLE = {DUPLICATE_SAMPLE}, LINEAR_SAMPLE = {LINEAR_SAMPLE}"
    parts = [
        files("spinfilters.filters").joinpath(name).read_text()
        for name in ("filter_step.c", "flow_curvature.c", "epoch_run.c")
    ]
    text = f"enum {{ {numbers} }};\nstatic const double AGREEING_SHARE = {AGREEING_SHARE};\n"
    return text + "".join(parts)
