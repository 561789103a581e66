"""Embedded filter as an estimator: the compiled C behind the interface of the filters."""

import ctypes
from functools import cache

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.errors import InputError
from spinfilters.embedded.embedded_options import EmbedOptions
from spinfilters.embedded.emitted_sensors import EMITTED_SENSORS
from spinfilters.embedded.library import load_filter
from spinfilters.filters.estimator import (
    Belief,
    Estimator,
    LandmarkBelief,
    MapChange,
    Measurement,
    Snapshot,
    UpdateReport,
)
from spinfilters.filters.square_root import triangular_factor
from spinfilters.models.gauge import GAUGE_DIM, moved_points, state_in_g
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.models.state_layout import Gaussian
from spinfilters.models.status import EstimatorStatus


class MapSlots:
    """Slots of landmarks by id; a full map drops the least recently observed."""

    def __init__(self, capacity: int) -> None:
        self._ids = np.full(capacity, -1, dtype=np.int64)
        self._last = np.full(capacity, -1, dtype=np.int64)
        self._places: dict[int, int] = {}
        self._now = 0

    def places(self, ids: Int[np.ndarray, " k"]) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " f"]]:
        """Slots of distinct ids, and which of them are new."""
        self._now += 1
        found = np.array([self._places.get(key, -1) for key in ids.tolist()], dtype=np.int64)
        self._last[found[found >= 0]] = self._now
        missing = np.flatnonzero(found < 0)
        fresh = np.argsort(self._last, kind="stable")[: len(missing)]
        for index, place in zip(missing.tolist(), fresh.tolist(), strict=True):
            if self._last[place] >= 0:
                del self._places[int(self._ids[place])]
            self._ids[place] = ids[index]
            self._places[int(ids[index])] = place
            self._last[place] = self._now
            found[index] = place
        return found, fresh

    @property
    def ids(self) -> Int[np.ndarray, " c"]:
        """Landmark id of every slot; meaningless in unused ones."""
        return self._ids.copy()

    @property
    def taken(self) -> Int[np.ndarray, " t"]:
        """Slots that hold a landmark."""
        return np.flatnonzero(self._last >= 0)

    def snapshot(self) -> dict[str, np.ndarray]:
        """Its whole state."""
        return {
            "slots.ids": self._ids.copy(),
            "slots.last": self._last.copy(),
            "slots.now": np.array(self._now),
        }

    def restore(self, snapshot: dict[str, np.ndarray]) -> None:
        """Continue from a `snapshot`."""
        self._ids, self._last = snapshot["slots.ids"].copy(), snapshot["slots.last"].copy()
        self._now = int(snapshot["slots.now"])
        self._places = {int(self._ids[place]): place for place in self.taken.tolist()}


USED, OUTSIDE, BEHIND, NEW, NOT_TOLD = range(5)


@cache
def real_type(options: EmbedOptions) -> type[ctypes.c_float] | type[ctypes.c_double]:
    """ctypes type of ``sf_real``."""
    return ctypes.c_double if options.real == "double" else ctypes.c_float


@cache
def filter_type(options: EmbedOptions) -> type[ctypes.Structure]:
    """ctypes structure of ``sf_filter``."""
    real, n = real_type(options), options.layout.error_dim
    fields = [
        ("x", real * options.layout.mean_dim),
        ("u", real * (n * (n - 1) // 2)),
        ("d", real * n),
        ("psd", real * 2),
        ("nis", real),
        *((name, ctypes.c_uint16) for name in ("dof", "used", "refused")),
    ]
    return type("Filter", (ctypes.Structure,), {"_fields_": fields})


@cache
def landmark_type(options: EmbedOptions) -> type[ctypes.Structure]:
    """ctypes structure of ``sf_landmark``."""
    real = real_type(options)
    fields = [
        ("point", real * 3),
        ("covariance", real * 6),
        ("hits", ctypes.c_uint16),
        ("wrong", ctypes.c_uint16),
    ]
    return type("Landmark", (ctypes.Structure,), {"_fields_": fields})


@cache
def observation_type(options: EmbedOptions) -> type[ctypes.Structure]:
    """ctypes structure of ``sf_observation``."""
    fields = [
        ("pixels", real_type(options) * 3),
        ("landmark", ctypes.c_uint16),
        ("outcome", ctypes.c_uint16),
    ]
    return type("Observation", (ctypes.Structure,), {"_fields_": fields})


OK, REFUSED, FAST = 0, 1, 2
SMALLEST_STD = 1e-7
"""Of a landmark in m, added to its covariance where that is factored: what float has rounded."""


class EmbeddedFilter(Estimator):
    """The C filter through ctypes.

    Parameters
    ----------
    process : TorqueFreeProcess
        Its layout must be that of the options, its disturbances are handed over.
    options : EmbedOptions
        Of the generated filter.

    Raises
    ------
    InputError
        Without a C compiler; for a state that the C filter does not have (drag, a gyro's scale).
    """

    def __init__(self, process: TorqueFreeProcess, options: EmbedOptions) -> None:
        super().__init__(process)
        self.name = "embedded" if options.real == "float" else "embedded-double"
        if process.layout != options.layout:
            raise InputError(
                f"the embedded filter has the state blocks {', '.join(options.layout.blocks)}, the data set needs "
                f"{', '.join(process.layout.blocks)}; leave it out of --estimators, or the further blocks out of the settings"
            )
        library = load_filter(options)
        if library is None:
            raise InputError(
                "the embedded filter is C and needs a compiler; install one, or leave it out of --estimators"
            )
        self.options, self._c, self._noise = options, library, process.noise
        self._filter = filter_type(options)()
        self._map = (landmark_type(options) * options.landmarks)() if options.has_map else None
        self._slots = MapSlots(options.landmarks)
        self._move, self._move_rows = np.zeros(GAUGE_DIM), np.zeros((GAUGE_DIM, 0))
        self._fast = self._not_finite = 0

    def start(self, belief: Belief) -> None:
        """Begin with a belief, landmarks included.

        What does not fit in the map's slots is left out.
        """
        n = self.layout.error_dim
        self._slots = MapSlots(self.options.landmarks)
        self._fast = self._not_finite = 0
        self._move, self._move_rows = np.zeros(GAUGE_DIM), np.zeros((GAUGE_DIM, 0))
        factor = belief.factor[:n]
        joint = belief.joint
        if joint is not None:
            self._take_map(joint)
            if len(joint.factor) > n + joint.modes.shape[2]:
                self._move, self._move_rows = joint.move.copy(), joint.factor[-GAUGE_DIM:]
        self._set(belief.mean, factor)

    def rebase(self, belief: Belief) -> None:
        """Begin with a smoothed belief, landmarks included."""
        self.start(belief)

    @property
    def belief(self) -> Gaussian:
        """State with its covariance, in frame g."""
        f = self._filter
        mean = np.array(f.x, dtype=float)
        rows = self._upper() * np.sqrt(np.array(f.d, dtype=float))
        if self._move_rows.size:
            k, n = self._move_rows.shape[1], len(rows)
            both = np.zeros((n + GAUGE_DIM, n + k))
            both[:n, :n], both[n:, n:] = rows, self._move_rows
            mean, rows = state_in_g(self.layout, mean, both, self._move)
        return Gaussian(self.layout, mean, triangular_factor(rows.T))

    @property
    def landmark_belief(self) -> LandmarkBelief:
        """State and landmarks, in the frame of the map, without shared modes."""
        f, n = self._filter, self.layout.error_dim
        held = self._map
        rows = [] if held is None else [place for place in self._slots.taken.tolist() if held[place].hits]
        kept = [] if held is None else [held[place] for place in rows]
        C = np.array([each.covariance[:] for each in kept], dtype=float).reshape(-1, 6)
        covariance = C[:, [0, 1, 3, 1, 2, 4, 3, 4, 5]].reshape(-1, 3, 3)
        roots = np.linalg.cholesky(covariance + SMALLEST_STD**2 * np.eye(3))
        moved = GAUGE_DIM if self._move_rows.size else 0
        factor = np.eye(n + 1 + moved)
        factor[:n, :n] = triangular_factor((self._upper() * np.sqrt(np.array(f.d, dtype=float))).T)
        if moved:
            factor[-moved:, -moved:] = triangular_factor(self._move_rows.T)
        points = np.array([each.point[:] for each in kept], dtype=float).reshape(-1, 3)
        mean, ids = np.array(f.x, dtype=float), self._slots.ids[rows]
        return LandmarkBelief(
            self.layout, mean, ids, points, np.zeros((len(rows), 3, 1)), roots, factor, self._move
        )

    @property
    def points(self) -> Float[np.ndarray, "k 3"]:
        """Landmarks that the map holds, m, frame g."""
        if self._map is None:
            return np.zeros((0, 3))
        points = np.array([each.point[:] for each in self._map if each.hits], dtype=float)
        return moved_points(points.reshape(-1, 3), self._move)

    @property
    def status(self) -> EstimatorStatus:
        """Degraded by steps too fast for the substeps, or not finite."""
        status = EstimatorStatus()
        if self._fast:
            status = status.degraded(
                f"the body turned too far for {self.options.substeps} substeps in {self._fast} predictions",
                "fast-rotation",
            )
        if self._not_finite:
            status = status.degraded(
                f"{self._not_finite} steps would not have stayed finite and were left out",
                "steps-left-out",
            )
        return status

    def predict(self, dt: float) -> None:
        """Advance by dt s; a step that would not stay finite is left out and counted."""
        result = self._call("sf_predict", real_type(self.options)(dt))
        self._fast += result == FAST
        self._not_finite += result > FAST

    def update(self, measurement: Measurement) -> UpdateReport:
        """Update with a measurement, value by value. InputError: a sensor that was not emitted."""
        name = measurement.model.name
        if name not in self.options.sensors:
            raise InputError(
                f"the embedded filter takes {', '.join(self.options.sensors)}, not {name!r}; leave it out of --estimators"
            )
        if EMITTED_SENSORS[name].landmark_model is not None:
            return self._update_landmarks(measurement)
        nis, dof, used = 0.0, 0, 0
        for value, parameters in zip(measurement.values, measurement.parameters, strict=True):
            result = self._call(f"sf_update_{name}", self._array(value), self._array(parameters))
            self._not_finite += result > FAST
            if result == OK:
                nis, dof, used = nis + self._filter.nis, dof + self._filter.dof, used + 1
        return UpdateReport(nis, dof, used, len(measurement.values) - used)

    def snapshot(self) -> Snapshot:
        """Bytes of the filter and its map."""
        arrays = {"filter": _bytes(self._filter), **self._slots.snapshot()}
        arrays |= {"move": self._move.copy(), "move_rows": self._move_rows.copy()}
        arrays["counts"] = np.array([self._fast, self._not_finite])
        return arrays if self._map is None else arrays | {"map": _bytes(self._map)}

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot."""
        _fill(self._filter, snapshot["filter"])
        if self._map is not None:
            _fill(self._map, snapshot["map"])
        self._slots.restore(snapshot)
        self._move, self._move_rows = snapshot["move"].copy(), snapshot["move_rows"].copy()
        self._fast, self._not_finite = (int(count) for count in snapshot["counts"])

    def _update_landmarks(self, measurement: Measurement) -> UpdateReport:
        """Landmarks of the estimated map, or of a known one.

        A known one stands in the map for this call alone.
        """
        assert self._map is not None
        k, camera = len(measurement.values), measurement.parameters[:, 3:]
        if k == 0:
            return UpdateReport(0.0, 0, 0, 0)
        self._require_fit(camera)
        ids = measurement.ids
        places = np.arange(k) if ids is None else self._places(ids)
        if ids is None:
            self._put_known(measurement.parameters[:, :3])
        observations = (observation_type(self.options) * k)()
        for each, pixels, place in zip(observations, measurement.values, places.tolist(), strict=True):
            each.pixels[:], each.landmark = pixels.tolist(), place
        result = self._call(
            f"sf_update_{measurement.model.name}",
            self._map,
            observations,
            ctypes.c_uint16(k),
            self._array(camera[0]),
        )
        self._not_finite += result > FAST
        outcome = np.array([each.outcome for each in observations])
        return self._report(outcome, ids, result)

    def _require_fit(self, camera: Float[np.ndarray, "k c"]) -> None:
        """InputError: more observations than the map holds landmarks, or of several cameras."""
        if len(camera) > self.options.landmarks:
            raise InputError(
                f"{len(camera)} landmarks in an epoch, and the embedded map holds {self.options.landmarks}"
            )
        if not (camera == camera[0]).all():
            raise InputError(
                "the embedded filter takes one camera and one noise for all observations; leave it out"
            )

    def _report(
        self, outcome: Int[np.ndarray, " k"], ids: Int[np.ndarray, " k"] | None, result: int
    ) -> UpdateReport:
        none = result > FAST
        used, added = (outcome == USED) & (not none), (outcome == NEW) & (ids is not None)
        nis, dof = (0.0, 0) if none or not used.any() else (float(self._filter.nis), int(self._filter.dof))
        accepted = int(used.sum() + added.sum())
        change = None
        if ids is not None:
            change = MapChange(ids[used], np.ones(int(used.sum())), ids[added], ids[:0])
        return UpdateReport(nis, dof, accepted, len(outcome) - accepted, map_change=change)

    def _places(self, ids: Int[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
        assert self._map is not None
        places, fresh = self._slots.places(ids)
        for place in fresh.tolist():
            self._map[place].hits = 0
        return places

    def _put_known(self, points: Float[np.ndarray, "k 3"]) -> None:
        assert self._map is not None
        for place, point in enumerate(points.tolist()):
            landmark = self._map[place]
            landmark.point[:], landmark.covariance[:] = point, [0.0] * 6
            landmark.hits, landmark.wrong = 2, 0

    def _take_map(self, belief: LandmarkBelief) -> None:
        """Landmarks of a belief; what they share is put into each one's own covariance."""
        n, r = self.layout.error_dim, belief.modes.shape[2]
        if self._map is None:
            return
        shared = belief.modes @ belief.factor[n : n + r]
        own = belief.roots @ np.swapaxes(belief.roots, 1, 2) + shared @ np.swapaxes(shared, 1, 2)
        count = min(len(belief.ids), self.options.landmarks)
        places, _ = self._slots.places(belief.ids[:count])
        for landmark in self._map:
            landmark.hits = 0
        for place, point, P in zip(places.tolist(), belief.points[:count], own[:count], strict=True):
            landmark = self._map[place]
            landmark.point[:] = point.tolist()
            landmark.covariance[:] = [P[0, 0], P[1, 0], P[1, 1], P[2, 0], P[2, 1], P[2, 2]]
            landmark.hits, landmark.wrong = 2, 0

    def _set(self, mean: Float[np.ndarray, " m"], factor: Float[np.ndarray, "n N"]) -> None:
        """The state from a square root of its covariance, which no square of small numbers passes."""
        root = triangular_factor(factor[::-1].T)[::-1, ::-1]
        diagonal = root.diagonal()
        upper, f = root / diagonal, self._filter
        n = len(root)
        f.x[:] = mean.tolist()
        f.u[:] = [upper[i, j] for j in range(n) for i in range(j)]
        f.d[:] = (diagonal**2).tolist()
        f.psd[:] = [self._noise.force_psd, self._noise.torque_psd]
        f.refused = 0

    def _upper(self) -> Float[np.ndarray, "n n"]:
        n = self.layout.error_dim
        columns, rows = np.tril_indices(n, -1)
        upper = np.eye(n)
        upper[rows, columns] = np.array(self._filter.u, dtype=float)
        return upper

    def _array(
        self, values: Float[np.ndarray, " k"]
    ) -> "ctypes.Array[ctypes.c_float] | ctypes.Array[ctypes.c_double]":
        return (real_type(self.options) * len(values))(*values.tolist())

    def _call(self, name: str, *arguments: object) -> int:
        return int(getattr(self._c, name)(ctypes.byref(self._filter), *arguments))


def _bytes(structure: ctypes.Structure | ctypes.Array) -> np.ndarray:
    return np.frombuffer(bytes(structure), dtype=np.uint8).copy()


def _fill(structure: ctypes.Structure | ctypes.Array, content: np.ndarray) -> None:
    ctypes.memmove(ctypes.byref(structure), content.tobytes(), ctypes.sizeof(structure))
