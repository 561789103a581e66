"""History of a run: beliefs of all epochs, and their recording."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.errors import ShapeError
from spinfilters.core.large_arrays import empty_array, release_pages
from spinfilters.filters.estimator import COUNTS, UpdateReport
from spinfilters.filters.noise_levels import VarianceComponent
from spinfilters.filters.square_root import lower_roots, unique_roots
from spinfilters.models.body import MassSamples
from spinfilters.models.state_layout import Gaussian, StateLayout
from spinfilters.models.state_mixture import ErrorMixture, StateMixture
from spinfilters.models.status import EstimatorStatus, Verdict

FEWEST_EPOCHS = 64
"""Epochs for which a history first makes room when their number is unknown."""

RELEASED = 8192
"""Epochs after which a history that is in a file gives its memory back."""

EPOCH_ARRAYS = ("time", "mean", "factor", "nis", "log_likelihood", "runtime", *COUNTS)
"""Arrays of a history; each has a row per epoch."""


@dataclass(frozen=True)
class EstimateHistory:
    """Beliefs after every epoch, and what each epoch cost; of many runs of the same epochs with an axis (r,) of runs in front.

    Time, runtime and observations of many runs are common to all; metrics and `of_run` read such a history, nothing else does.

    Attributes
    ----------
    name : str
        Name of the estimator.
    layout : StateLayout
        Of its state.
    time : ndarray of float, shape (n,)
        Time of each epoch, s.
    mean : ndarray of float, shape (n, m)
        Mean of the state after each epoch.
    factor : ndarray of float, shape (n, e, e)
        Square root of the error covariance, P = factor factor'.
    nis : ndarray of float, shape (n,)
        Normalised innovation squared of each epoch.
    dof : ndarray of int, shape (n,)
        Its degrees of freedom.
    log_likelihood : ndarray of float, shape (n,)
        Log likelihood of each epoch's measurements given everything before.
    accepted, rejected : ndarray of int, shape (n,)
        Measurements used and left out; by sensor: `spinfilters.evaluation.epoch_spans.use_by_sensor`.
    runtime : ndarray of float, shape (n,)
        Seconds per epoch, prediction and update.
    initialisation : int
        How many of the first epochs are a filter's initialisation, which a smoother has made; nothing of them is counted.
        The filter's own begin after them.
    observations : ndarray of int, shape (n,) or None
        Number of measurements of each epoch, used or not; None where it is unknown.
    noise : tuple[VarianceComponent, ...]
        Levels identified that the estimate rests on in the end; empty where they are those of the initialisation.
    calibration : ndarray of float, shape (n, e, c) or None
        Error of every epoch by each independent error of the calibration, times its deviation; counted in ``factor``. None
        where the calibration is exact.
    mass : MassSamples or None
        Samples of the mass distribution after the last epoch where one direction is hardly determined; moments and axes
        are then theirs.
    posterior : StateMixture or None
        Posterior of the last epoch, of an estimator that samples it.
    mixture : ErrorMixture or None
        Error after the last epoch where ``factor`` covers several explanations of the measurements, each with a covariance of
        its own; None where one Gaussian says it.
    """

    name: str
    layout: StateLayout
    time: Float[np.ndarray, " n"]
    mean: Float[np.ndarray, "*r n m"]
    factor: Float[np.ndarray, "*r n e e"]
    nis: Float[np.ndarray, "*r n"]
    dof: Int[np.ndarray, "*r n"]
    log_likelihood: Float[np.ndarray, "*r n"]
    accepted: Int[np.ndarray, "*r n"]
    rejected: Int[np.ndarray, "*r n"]
    runtime: Float[np.ndarray, " n"]
    status: EstimatorStatus
    initialisation: int = 0
    observations: Int[np.ndarray, " n"] | None = None
    noise: tuple[VarianceComponent, ...] = ()
    calibration: Float[np.ndarray, "n e c"] | None = None
    mass: MassSamples | None = None
    posterior: StateMixture | None = None
    mixture: ErrorMixture | None = None

    @property
    def own(self) -> slice:
        """Epochs after those of the initialisation."""
        return slice(self.initialisation, None)

    @property
    def has_failed(self) -> bool:
        """Whether the estimator failed."""
        return self.status.verdict is Verdict.FAILED

    @property
    def initialisation_end(self) -> float | None:
        """Time of the last epoch of the initialisation, s; None without one."""
        return float(self.time[self.initialisation - 1]) if self.initialisation else None

    def thinned(self, epochs: int) -> "EstimateHistory":
        """At most so many epochs at a constant step, the last included, without copies."""
        step = -(-len(self.time) // epochs)
        rows = slice((len(self.time) - 1) % step, None, step)
        observed = None if self.observations is None else self.observations[rows]
        initialisation = len(range(*rows.indices(self.initialisation)))
        thinned = {name: getattr(self, name)[rows] for name in EPOCH_ARRAYS}
        thinned["calibration"] = None if self.calibration is None else self.calibration[rows]
        return replace(self, initialisation=initialisation, observations=observed, **thinned)

    def of_run(self, run: int) -> "EstimateHistory":
        """One run of a history of many."""
        own = (name for name in EPOCH_ARRAYS if name not in ("time", "runtime"))
        return replace(self, **{name: getattr(self, name)[run] for name in own})

    def belief(self, index: int) -> Gaussian:
        """Belief after the epoch of this index."""
        return Gaussian(self.layout, self.mean[index], self.factor[index])

    def considering(self, calibration: Float[np.ndarray, "n e c"]) -> "EstimateHistory":
        """History with calibration errors in its covariance, P + C C'."""

        def widened(rows: slice) -> np.ndarray:
            """Factors of a stretch of epochs."""
            factor = self.factor[rows].copy()
            finite = np.isfinite(factor).all(axis=(1, 2))
            factor[finite] = lower_roots(np.concatenate([factor[finite], calibration[rows][finite]], axis=2))
            return factor

        return replace(self, factor=self._factors(widened), calibration=calibration)

    def _factors(self, of: Callable[[slice], np.ndarray]) -> Float[np.ndarray, "n e e"]:
        """Other factors, computed by stretches of epochs, in a file where they are many."""
        factor = empty_array(self.factor.shape, float)
        for start in range(0, len(factor), RELEASED):
            rows = slice(start, start + RELEASED)
            factor[rows] = of(rows)
            release_pages(factor)
            release_pages(self.factor)
        return factor

    def with_larger_calibration(self, times: Float[np.ndarray, " c"]) -> "EstimateHistory":
        """With every calibration error so many times as large, at least 1; the same without any."""
        if self.calibration is None:
            return self
        added = self.calibration * np.sqrt(times**2 - 1.0)
        return replace(self.considering(added), calibration=self.calibration * times)

    def with_calibration_error(self, error: Float[np.ndarray, "n e"]) -> "EstimateHistory":
        """With one more error of the calibration, independent of the others, by its effect on every epoch."""
        added = error[:, :, np.newaxis]
        known = added if self.calibration is None else np.concatenate([self.calibration, added], axis=2)
        return replace(self.considering(added), calibration=known)

    def preceded_by(self, before: Mapping[str, np.ndarray]) -> "EstimateHistory":
        """With the epochs of an initialisation in front.

        Parameters
        ----------
        before : Mapping[str, ndarray]
            Every array of `EPOCH_ARRAYS`.
        """
        counted = {
            name: before[name].astype(int) if name in COUNTS else before[name] for name in EPOCH_ARRAYS
        }
        joined = {name: np.concatenate([counted[name], getattr(self, name)]) for name in EPOCH_ARRAYS}
        return replace(self, initialisation=len(before["time"]), **joined)

    def widened(self, widening: Float[np.ndarray, "k e e"]) -> "EstimateHistory":
        """With covariances F B B' F' in place of F F', F lower triangular without negative diagonals.

        Parameters
        ----------
        widening : ndarray of float, shape (k, e, e)
            B of the first epochs; later ones have the last.
        """
        first = min(len(widening), len(self.factor))

        def wider(rows: slice) -> np.ndarray:
            """F B epoch by epoch, with the last B for all later epochs; then lower triangles again."""
            own, begin = self.factor[rows].copy(), rows.start
            finite = np.isfinite(own).all(axis=(1, 2))
            own[finite] = unique_roots(own[finite])
            early = max(first - begin, 0)
            factor = np.concatenate(
                [own[:early] @ widening[begin : begin + len(own[:early])], own[early:] @ widening[-1]]
            )
            finite = np.isfinite(factor).all(axis=(1, 2))
            factor[finite] = lower_roots(factor[finite])
            return factor

        return replace(self, factor=self._factors(wider))

    def last_mixture(
        self, relative: ErrorMixture, calibration: Float[np.ndarray, "n e c"] | None
    ) -> ErrorMixture | None:
        """Errors after the last epoch with covariances F R R' F' + C C', F the random factor as in `widened`.

        Parameters
        ----------
        relative : ErrorMixture
            R of each component.
        calibration : ndarray of float, shape (n, e, c), or None
            C of every epoch, which may be larger than what ``factor`` counts.

        Returns
        -------
        ErrorMixture or None
            None of a belief that is not finite.
        """
        if not np.isfinite(self.factor[-1]).all():
            return None
        rows = unique_roots(self.random_factor(slice(-1, None))) @ relative.factors
        if calibration is not None:
            known = np.broadcast_to(calibration[-1], (len(rows), *calibration.shape[1:]))
            rows = np.concatenate([rows, known], axis=2)
        return ErrorMixture(relative.weights, lower_roots(rows))

    def random_factor(self, rows: slice | Int[np.ndarray, " r"] = slice(None)) -> Float[np.ndarray, "r e e"]:
        """Covariance factor of some epochs without calibration errors, not triangular where there are any.

        The difference is taken of correlations, so that units have no say in what rounding leaves. NaN where it is not finite.
        """
        factor = self.factor[rows]
        if self.calibration is None:
            return factor
        calibration, found = self.calibration[rows], np.full_like(factor, np.nan)
        finite = np.isfinite(np.concatenate([factor, calibration], axis=2)).all(axis=(1, 2))
        scale = np.maximum(np.linalg.norm(factor[finite], axis=2), np.finfo(float).tiny)[:, :, np.newaxis]
        total, known = factor[finite] / scale, calibration[finite] / scale
        values, vectors = np.linalg.eigh(total @ np.swapaxes(total, 1, 2) - known @ np.swapaxes(known, 1, 2))
        found[finite] = scale * vectors * np.sqrt(np.maximum(values, 0.0))[:, np.newaxis]
        return found

    @property
    def covariance(self) -> Float[np.ndarray, "n e e"]:
        """Error covariance after every epoch."""
        return self.factor @ np.swapaxes(self.factor, 1, 2)

    @property
    def std(self) -> Float[np.ndarray, "n e"]:
        """Standard deviation of every error component after every epoch."""
        return np.sqrt(np.einsum("tij,tij->ti", self.factor, self.factor))


def history_at(history: EstimateHistory, rows: Int[np.ndarray, " k"]) -> EstimateHistory:
    """A history of some epochs, its covariance alone."""
    return replace(
        history,
        **{name: _rows_of(getattr(history, name), rows) for name in EPOCH_ARRAYS},
        calibration=None,
        observations=None,
        mixture=None,
        initialisation=0,
    )


def _rows_of(array: np.ndarray, rows: Int[np.ndarray, " k"]) -> np.ndarray:
    """Some rows; of an array in a file few at a time, as each brings its neighbours into memory."""
    found = np.empty((len(rows), *array.shape[1:]), array.dtype)
    for start in range(0, len(rows), FEWEST_EPOCHS):
        part = slice(start, start + FEWEST_EPOCHS)
        found[part] = array[rows[part]]
        release_pages(array)
    return found


def finished_history(histories: Sequence[EstimateHistory]) -> EstimateHistory | None:
    """The first history that has not failed; None without any."""
    return next((each for each in histories if not each.has_failed), None)


class GrowingHistory:
    """Growing record of a run's epochs.

    It goes into a file and comes back as plain arrays.
    The arrays have room ahead, which takes no memory before it is written to.

    Parameters
    ----------
    layout : StateLayout
        Of the state.
    begin : float
        Time from which the run sets out, s.
    """

    def __init__(self, layout: StateLayout, begin: float) -> None:
        self.layout, self.begin = layout, begin
        self._before, self._count = 0, 0
        self._room = _empty_arrays(layout, 0)

    @classmethod
    def from_arrays(
        cls, layout: StateLayout, begin: float, arrays: Mapping[str, np.ndarray]
    ) -> "GrowingHistory":
        """The history whose `arrays` these are. Raises ShapeError when they do not fit together."""
        rows = cls(layout, begin)
        rows._room = checked_epochs(layout, arrays)
        rows._count = len(rows._room["time"])
        return rows

    def __len__(self) -> int:
        return self._count

    @property
    def time(self) -> float:
        """Time of the last epoch, or of the start of the run, s."""
        return float(self._room["time"][self._last]) if self._count else self.begin

    @property
    def belief(self) -> Gaussian | None:
        """Belief after the last epoch; None before the first."""
        if not self._count:
            return None
        return Gaussian(self.layout, self._room["mean"][self._last], self._room["factor"][self._last])

    @property
    def _last(self) -> int:
        return self._before + self._count - 1

    def reserve(self, epochs: int, before: int = 0) -> None:
        """Make room for so many epochs in all.

        Makes room for ``before`` more in front of them too (see `ended`). No less than what there is.
        """
        before, epochs = max(before, self._before), max(epochs, self._count)
        if before == self._before and before + epochs <= len(self._room["time"]):
            return
        room = _empty_arrays(self.layout, before + epochs)
        for name, array in self.arrays().items():
            room[name][before : before + self._count] = array
        self._before, self._room = before, room

    def room(self, epochs: int) -> dict[str, np.ndarray]:
        """Every array of `EPOCH_ARRAYS` at the places of so many epochs to come; `extend` makes them count."""
        begin = self._last + 1
        if begin + epochs > len(self._room["time"]):
            self.reserve(max(2 * self._count, self._count + epochs, FEWEST_EPOCHS), self._before)
        return {name: array[begin : begin + epochs] for name, array in self._room.items()}

    def extend(self, time: Float[np.ndarray, " k"], runtime: float) -> None:
        """Add epochs at these times (s) that were written to their `room`; each took ``runtime`` seconds."""
        rows = slice(self._last + 1, self._last + 1 + len(time))
        self._room["time"][rows], self._room["runtime"][rows] = time, runtime
        self._count += len(time)  # last: Ctrl-C finds the epochs there or not
        self._release(len(time))

    def append(self, time: float, belief: Gaussian, reports: Sequence[UpdateReport], runtime: float) -> None:
        """Add the epoch at ``time`` (s) with what its updates reported; it took ``runtime`` seconds."""
        place = self._last + 1
        if place == len(self._room["time"]):
            self.reserve(max(2 * self._count, FEWEST_EPOCHS), self._before)
        room = self._room
        room["time"][place], room["runtime"][place] = time, runtime
        room["mean"][place], room["factor"][place] = belief.mean, belief.factor
        room["nis"][place] = sum(report.nis for report in reports)
        room["log_likelihood"][place] = sum(report.log_likelihood for report in reports)
        room["dof"][place] = sum(report.dof for report in reports)
        room["accepted"][place] = sum(report.accepted for report in reports)
        room["rejected"][place] = sum(report.rejected for report in reports)
        self._count += 1  # last: Ctrl-C finds the epoch there or not
        self._release(1)

    def _release(self, added: int) -> None:
        """Give the memory of many epochs back, if they are in a file and were just completed."""
        if self._count // RELEASED != (self._count - added) // RELEASED:
            release_pages(self._room["factor"])

    def arrays(self) -> dict[str, np.ndarray]:
        """Every array of `EPOCH_ARRAYS`, a row per epoch: views, which later epochs leave as they are."""
        rows = slice(self._before, self._before + self._count)
        return {name: array[rows] for name, array in self._room.items()}

    def ended(
        self, name: str, status: EstimatorStatus, before: Mapping[str, np.ndarray] | None = None
    ) -> EstimateHistory:
        """Complete history of the estimator of this name.

        Parameters
        ----------
        before : Mapping[str, ndarray] or None
            Every array of `EPOCH_ARRAYS` of the initialisation's frames, to put in front; no array is copied where `reserve`
            left room for them.
        """
        if before is None:
            return EstimateHistory(
                name=name,
                layout=self.layout,
                status=status,
                initialisation=0,
                noise=(),
                mass=None,
                posterior=None,
                mixture=None,
                **self.arrays(),
            )
        count = len(before["time"])
        self.reserve(self._count, count)
        rows = slice(self._before - count, self._before + self._count)
        arrays = {key: array[rows] for key, array in self._room.items()}
        for key, array in arrays.items():
            array[:count] = before[key]
        return EstimateHistory(
            name=name,
            layout=self.layout,
            status=status,
            initialisation=count,
            noise=(),
            mass=None,
            posterior=None,
            mixture=None,
            **arrays,
        )


def checked_epochs(layout: StateLayout, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays of a history, each with as many rows as the others.

    Raises
    ------
    ShapeError
        One is missing, or has another shape or kind of number than a history over this layout.
    """
    missing = [name for name in EPOCH_ARRAYS if name not in arrays]
    if missing:
        raise ShapeError(f"{', '.join(missing)} is missing")
    shapes, count = _row_shapes(layout), arrays["time"].shape[:1]
    for name in EPOCH_ARRAYS:
        array, wanted = arrays[name], np.dtype(int if name in COUNTS else float)
        if array.shape != (*count, *shapes.get(name, ())) or array.dtype.kind != wanted.kind or not count:
            raise ShapeError(
                f"{name} is {array.dtype} of shape {array.shape}, which does not fit {layout.blocks}"
            )
        if name in COUNTS and (array < 0).any():
            raise ShapeError(f"{name} counts less than nothing")
    return {name: arrays[name] for name in EPOCH_ARRAYS}


def _empty_arrays(layout: StateLayout, epochs: int) -> dict[str, np.ndarray]:
    """Arrays of `EPOCH_ARRAYS` with room for so many epochs."""
    shapes = _row_shapes(layout)
    return {
        name: empty_array((epochs, *shapes.get(name, ())), int if name in COUNTS else float)
        for name in EPOCH_ARRAYS
    }


def _row_shapes(layout: StateLayout) -> dict[str, tuple[int, ...]]:
    """Shapes of a row of the arrays that hold more than a number per epoch."""
    return {"mean": (layout.mean_dim,), "factor": (layout.error_dim, layout.error_dim)}
