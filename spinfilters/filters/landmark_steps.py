"""Steps of a landmark update: the data that they exchange, and `NumpySteps`, the reference of the compiled ones.

The error of landmark i is split, d_i = A_i m + e_i: modes m that all landmarks share, whose errors stand with those of the state
in one factor F (P = F F'), and e_i of its own, independent of everything, with covariance L_i L_i'. An observation of it depends on
the pose x (the sensor's columns of the state) and on the landmark,

    rho_i = H_x x + H_p (A_i m + e_i) + v_i = H_x x + H_p A_i m + w_i,   cov w_i = S_i = I / weight + H_p L_i L_i' H_p',

so that with S_i = T T' the rows T^-1 [H_x, H_p A_i] of all observations are a measurement of (x, m) with unit noise: `whitened` and
`corrected`. This is exact, as is what follows of the landmark, with X = T^-1 H_p L_i and K = L_i X' T^-1:

    e_i = K (rho_i - H_x x - H_p A_i m) + e_i',   cov e_i' = L_i (I - X'X) L_i'.

So it depends on the modes and on the pose of this epoch: d_i = B_i (x, m) + e_i'. `compress` finds as many new modes as there
were that explain most of what the (x, m) of all landmarks make of their observations: with (x, m) = R q, q of unit covariance,
and G the sum of squares of those observations by (x, m), the leading eigenvectors V of R'GR give the modes V'q. The others are
taken for every landmark's own (`observe`). Landmarks that were not observed follow with one transformation for all
(`landmark_map`).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.filters.measurement_prediction import SigmaPoints
from spinfilters.filters.square_root import (
    Correction,
    MeasurementPrediction,
    compressed,
    is_lower,
    lower_roots,
    square_root_update,
)
from spinfilters.models.measurement import LandmarkSensor
from spinfilters.models.state_layout import StateLayout

SLOTS = 24
"""Epochs that a landmark may fall behind; less would touch more landmarks, more would keep more transformations."""
FIRST_ROOM = 256
"""Landmarks for which there is room before the arrays grow."""


class LinearisedObservations(NamedTuple):
    """Observations about a point, whitened by the sensor's noise.

    Attributes
    ----------
    rows : ndarray of float, shape (k, d, w)
        By the columns of the state, by the landmark (3), and the innovation.
    valid : ndarray of bool, shape (k,)
        Whether the sensor's model applies.
    log_noise : ndarray of float, shape (k,)
        Log determinant of the sensor's noise factor.
    """

    rows: Float[np.ndarray, "k d w"]
    valid: Bool[np.ndarray, " k"]
    log_noise: Float[np.ndarray, " k"]


class LandmarkArrays:
    """Landmarks in rows, the first ``count`` of arrays.

    Attributes
    ----------
    ids
        (k,) ids of the landmarks.
    points
        (k, 3) m, in the map's frame.
    modes
        (k, 3, r) dependence A on the shared modes.
    roots
        (k, 3, 3) root L of the own covariance, lower triangular.
    epoch
        (k,) epoch to whose modes ``modes`` refer.
    hits
        (k,) observations that agree.
    wrong
        (k,) refused ones in a row.
    last
        (k,) epoch of the last observation.
    now
        The present epoch.
    turn
        Row from which the next share begins.
    transform, spread
        (SLOTS, r, r) how the modes of an epoch follow from those of now, see `landmark_map`; its slot is its number modulo SLOTS.
    shift
        (SLOTS, r) likewise.
    attitude
        (3, r) error of the attitude at the latest observations, by the modes of now; 0 where the map begins.
    steps : LandmarkSteps
        Of an epoch, compiled where possible.
    """

    def __init__(self, rank: int, precision: str, steps: "LandmarkSteps") -> None:
        kept, self.steps = np.dtype(precision), steps
        self.count, self.now, self.turn = 0, 0, 0
        self.ids = np.zeros(FIRST_ROOM, dtype=np.int64)
        self.points = np.zeros((FIRST_ROOM, 3))
        self.modes = np.zeros((FIRST_ROOM, 3, rank), dtype=kept)
        self.roots = np.zeros((FIRST_ROOM, 3, 3), dtype=kept)
        self.epoch, self.hits, self.wrong, self.last = (
            np.zeros(FIRST_ROOM, dtype=np.int64) for _ in range(4)
        )
        self.transform = np.tile(np.eye(rank), (SLOTS, 1, 1))
        self.spread = np.zeros((SLOTS, rank, rank))
        self.shift = np.zeros((SLOTS, rank))
        self.attitude = np.zeros((3, rank))

    @property
    def rank(self) -> int:
        """r, number of modes."""
        return self.modes.shape[2]


@dataclass(frozen=True)
class MapObservations:
    """One measurement of k landmarks of the map, and of q that it does not hold.

    Attributes
    ----------
    values : ndarray of float, shape (k, v)
        Measured values.
    parameters : ndarray of float, shape (k, p)
        What accompanies each value, the place of the landmark's point first.
    at : ndarray of int, shape (k,)
        Rows of the map, which are up to date.
    known : ndarray of bool, shape (m,)
        Which of all are of landmarks of the map.
    columns : ndarray of int, shape (q,)
        Errors that are observed: those of the pose, then the modes.
    scale : float
        By which the covariance of the noise differs from the stated one.
    """

    layout: StateLayout
    sensor: LandmarkSensor
    values: Float[np.ndarray, "k v"]
    parameters: Float[np.ndarray, "k p"]
    at: Int[np.ndarray, " k"]
    known: Bool[np.ndarray, " m"]
    landmarks: LandmarkArrays
    columns: Int[np.ndarray, " q"]
    scale: float

    @cached_property
    def points(self) -> Float[np.ndarray, "k 3"]:
        """Points of the observed landmarks, m."""
        return self.landmarks.points[self.at]

    @cached_property
    def modes(self) -> Float[np.ndarray, "k 3 r"]:
        """Modes of the observed landmarks."""
        return self.landmarks.modes[self.at].astype(float)

    @cached_property
    def roots(self) -> Float[np.ndarray, "k 3 3"]:
        """Square roots of the observed landmarks' own covariances."""
        return self.landmarks.roots[self.at].astype(float)

    def rows_at(
        self, x: Float[np.ndarray, " m"], points: Float[np.ndarray, "k 3"] | None = None
    ) -> LinearisedObservations:
        """First derivatives at a state and at points, those of the map where none are given."""
        k, d = len(self.values), self.sensor.dim
        places = (self.landmarks.points, self.at) if points is None else (points, None)
        # One state for all observations; each its point, parameters and value.
        made, valid, square, determinant = self.sensor.observation_rows(
            x[None], places[0], self.parameters[:, 3:], self.values, rows=(None, places[1], None, None)
        )
        rows = made.reshape(k, d, len(self.sensor.columns) + 4)
        good = (valid[:, 0] > 0) & np.isfinite(square[:, 0])
        return LinearisedObservations(rows, good, np.log(determinant[:, 0]))


@dataclass(frozen=True)
class PoseSpread:
    """States and landmarks moved by sigma points.

    Attributes
    ----------
    states : ndarray of float, shape (p, m)
        At the points.
    pose : ndarray of float, shape (c, s)
        By the coordinates that move it.
    modes : ndarray of float, shape (r, s)
        By the same.
    late : ndarray of float, shape (r, r)
        Lower triangular root of the modes' covariance by all other coordinates.
    """

    states: Float[np.ndarray, "p m"]
    pose: Float[np.ndarray, "c s"]
    modes: Float[np.ndarray, "r s"]
    late: Float[np.ndarray, "r r"]

    @cached_property
    def is_solvable(self) -> bool:
        """Whether the pose is a lower triangle of full rank: its columns lead the state."""
        square = len(self.pose) == self.pose.shape[1]
        return square and is_lower(self.pose) and bool(np.diagonal(self.pose).all())


class ClosedEpoch(NamedTuple):
    """What an epoch leaves behind: the new modes, new landmarks with their dependence on these and own errors, and the factor.

    Attributes
    ----------
    shared : NewModes
        How the modes of all landmarks change.
    modes : ndarray of float, shape (q, 3, r)
        The new ones.
    roots : ndarray of float, shape (q, 3, 3)
        Square roots of their own covariance.
    factor : ndarray of float, shape (N, N)
        Covariance factor of all errors about the new mean: of state, new modes and the map's own move.
    """

    shared: "NewModes"
    modes: Float[np.ndarray, "q 3 r"]
    roots: Float[np.ndarray, "q 3 3"]
    factor: Float[np.ndarray, "N N"]


@dataclass(frozen=True)
class WhitenedLandmarks:
    """Observations of k landmarks, whitened by noise and the landmarks' own covariance.

    Attributes
    ----------
    kept : ndarray of float, shape (g, s, l)
        G groups of l landmarks, the last one filled up: numbers of `rows`, of X and of H_p L (d x 3).
    shape : tuple[int, int, int]
        (k, d, c + r + 1).
    log_noise : float
        Log determinant of all T, less that of the square roots of the weights.
    levers : ndarray of float, shape (3,), or None
        Their `LandmarkSteps.lever_squares`, where these are known already.
    """

    kept: Float[np.ndarray, "g s l"]
    shape: tuple[int, int, int]
    log_noise: float
    levers: Float[np.ndarray, "3"] | None = None

    @cached_property
    def rows(self) -> Float[np.ndarray, "k d w"]:
        """Rows by state columns and modes, with the innovation.

        c columns, r modes; of an epoch that is not closed.
        """
        count, d, width = self.shape
        return np.swapaxes(self.kept[:, : d * width], 1, 2).reshape(-1, d, width)[:count]

    @cached_property
    def by_own(self) -> Float[np.ndarray, "k d 3"]:
        """X, rows by the landmarks' own errors in units of their roots."""
        count, d, _ = self.shape
        return np.swapaxes(self.own_numbers, 1, 2).reshape(-1, d, 3)[:count]

    @property
    def own_numbers(self) -> Float[np.ndarray, "g s l"]:
        """Numbers of X in groups of landmarks, zero where the last group is filled up."""
        _, d, width = self.shape
        return self.kept[:, d * width : d * (width + 3)]


class NewModes(NamedTuple):
    """Next modes as combinations of the old ones.

    (x, m) = kept m' + dropped f, m' and f of unit covariance.

    Attributes
    ----------
    turned : ndarray of float, shape (q, q)
        Kept and dropped side by side.
    rows : ndarray of float, shape (r, N)
        The modes' factor.
    explained : ndarray of float, shape (r,)
        Squares of standard deviations that each mode explains in observations.
    """

    turned: Float[np.ndarray, "q q"]
    rows: Float[np.ndarray, "r N"]
    explained: Float[np.ndarray, " r"]

    @property
    def kept(self) -> Float[np.ndarray, "q r"]:
        """Combinations that stay shared."""
        return self.turned[:, : len(self.rows)]

    @property
    def dropped(self) -> Float[np.ndarray, "q c"]:
        """Combinations that become every landmark's own."""
        return self.turned[:, len(self.rows) :]


class Closing(NamedTuple):
    """Transition of landmarks and modes at the end of an epoch.

    Attributes
    ----------
    at : ndarray of int, shape (k,)
        Rows of the observed landmarks, as in ``white``.
    correction : Correction
        Of all errors, about the mean before.
    columns : ndarray of int, shape (p,)
        Pose and modes among these errors.
    reset : ndarray of float, shape (n, n)
        Derivative of the state's errors about the mean after the update by those about the mean before.
    by_pose : ndarray of float, shape (q, 3, c)
        (q, 3, 3) of new landmarks, their dependence on the pose and their own root.
    roots : ndarray of float, shape (q, 3, 3)
        (q, 3, 3) of new landmarks, their dependence on the pose and their own root.
    remembered : ndarray of float, shape (r,)
        What modes explained before, as far as it still counts.
    behind : tuple[int, int]
        Rows of landmarks, first and last, whose turn it is to be brought up to date.
    """

    at: Int[np.ndarray, " k"]
    white: WhitenedLandmarks
    correction: Correction
    columns: Int[np.ndarray, " p"]
    reset: Float[np.ndarray, "n n"]
    by_pose: Float[np.ndarray, "q 3 c"]
    roots: Float[np.ndarray, "q 3 3"]
    remembered: Float[np.ndarray, " r"]
    behind: tuple[int, int]

    @property
    def error(self) -> Float[np.ndarray, " p"]:
        """Correction of pose and modes."""
        return self.correction.error[self.columns]

    @property
    def factor(self) -> Float[np.ndarray, "p N"]:
        """Their rows after the update, about the mean before."""
        return self.correction.factor[self.columns]


class LandmarkSteps(Protocol):
    """Steps of an epoch: `NumpySteps` defines them, `compiled_steps.CompiledSteps` takes them in C."""

    def refresh(self, stored: LandmarkArrays, rows: Int[np.ndarray, " q"]) -> None:
        """Bring landmarks in these rows up to the present epoch's modes."""
        ...

    def whitened(
        self,
        stored: LandmarkArrays,
        at: Int[np.ndarray, " k"],
        linear: Float[np.ndarray, "k d w"],
        weights: Float[np.ndarray, " k"],
    ) -> WhitenedLandmarks:
        """Whitened rows of observations of the landmarks in rows ``at``."""
        ...

    def lever_squares(
        self, stored: LandmarkArrays, at: Int[np.ndarray, " k"], white: WhitenedLandmarks
    ) -> Float[np.ndarray, "3"]:
        """Sums of squares of X, of the roots of landmarks in rows ``at``, and of their points about the mean."""
        ...

    def corrected(
        self,
        white: WhitenedLandmarks,
        factor: Float[np.ndarray, "N N"],
        columns: Int[np.ndarray, " q"],
        log_noise: float,
    ) -> Correction:
        """Correction by whitened observations of errors with this factor."""
        ...

    def solved(
        self,
        observations: MapObservations,
        x: Float[np.ndarray, " m"],
        factor: Float[np.ndarray, "N N"],
        limit: float,
    ) -> tuple[Correction, WhitenedLandmarks] | None:
        """`whitened` and `corrected` at once; None where it cannot, or a squared innovation exceeds the limit."""
        ...

    def solved_rows(
        self,
        observations: MapObservations,
        linear: Float[np.ndarray, "k d w"],
        log_noise: float,
        factor: Float[np.ndarray, "N N"],
        limit: float,
    ) -> tuple[Correction, WhitenedLandmarks] | None:
        """The same of rows, all of them valid; log_noise of all."""
        ...

    def regressed(
        self, observations: MapObservations, spread: PoseSpread, points: SigmaPoints
    ) -> LinearisedObservations | None:
        """Statistical linear regression of the observations; None where it cannot."""
        ...

    def close(self, stored: LandmarkArrays, closing: Closing) -> ClosedEpoch:
        """Finish an epoch after the correction: the map moves to the next one."""
        ...


NEW_LANDMARK_SHARE = 0.5
"""Of the information of a new landmark's own covariance that its next observation has of it, about."""


class NumpySteps:
    """Landmark steps in NumPy; `compiled_steps.CompiledSteps` takes the same in C."""

    def refresh(self, stored: LandmarkArrays, rows: Int[np.ndarray, " q"]) -> None:
        """Bring landmarks in these rows up to the present epoch's modes."""
        rows = rows[stored.epoch[rows] != stored.now]
        # The slot of a row's epoch leads to now: point += A shift, A <- A transform, own covariance += A spread A'.
        slot = stored.epoch[rows] % len(stored.shift)
        A, L = stored.modes[rows].astype(float), stored.roots[rows].astype(float)
        stored.points[rows] += (A @ stored.shift[slot, :, None])[..., 0]
        value, vector = np.linalg.eigh(A @ stored.spread[slot] @ np.swapaxes(A, 1, 2))
        extra = vector * np.sqrt(np.maximum(value, 0.0))[:, None, :]  # below zero by rounding alone
        stored.modes[rows] = A @ stored.transform[slot]
        stored.roots[rows] = lower_roots(np.concatenate([L, extra], axis=2))
        stored.epoch[rows] = stored.now

    def whitened(
        self,
        stored: LandmarkArrays,
        at: Int[np.ndarray, " k"],
        linear: Float[np.ndarray, "k d w"],
        weights: Float[np.ndarray, " k"],
    ) -> WhitenedLandmarks:
        """Whitened rows of observations, with X and H_p L kept.

        The landmarks are in rows ``at``; their own errors are noise to the rows.

        Parameters
        ----------
        linear : ndarray of float, shape (k, d, w)
            Whitened by the sensor's noise: by c columns of the state, by the landmark (3), the innovation.
        weights : ndarray of float, shape (k,)
            Positive; noise has 1 / weight times the covariance.
        """
        modes, roots = stored.modes[at].astype(float), stored.roots[at].astype(float)
        scaled = linear * np.sqrt(weights)[:, None, None]
        by_state, by_landmark, innovation = scaled[..., :-4], scaled[..., -4:-1], scaled[..., -1:]
        # Columns [by state | by landmark (3) | innovation]; the landmark's own error is noise: I + gram gram', gram = H_p L.
        gram = by_landmark @ roots
        unit = np.broadcast_to(np.eye(gram.shape[1]), (len(gram), gram.shape[1], gram.shape[1]))
        root = lower_roots(np.concatenate([unit, gram], axis=2))
        # One substitution whitens [by state | by modes | innovation | gram]; the last three columns become X.
        every = np.concatenate([by_state, by_landmark @ modes, innovation, gram], axis=2)
        every = np.linalg.solve(root, every)
        log_noise = np.log(np.abs(np.diagonal(root, axis1=1, axis2=2))).sum(axis=1)
        log_noise = float((log_noise - 0.5 * linear.shape[1] * np.log(weights)).sum())
        rows, X = every[..., :-3], every[..., -3:]
        parts = [array.reshape(len(at), array.shape[1] * array.shape[2], 1) for array in (rows, X, gram)]
        kept = np.concatenate(parts, axis=1)
        return WhitenedLandmarks(kept, rows.shape, log_noise)

    def lever_squares(
        self, stored: LandmarkArrays, at: Int[np.ndarray, " k"], white: WhitenedLandmarks
    ) -> Float[np.ndarray, "3"]:
        """Sums of squares of X, of the roots of landmarks in rows ``at``, and of their points about the mean."""
        points, roots = stored.points[at], stored.roots[at].astype(float)
        parts = white.own_numbers, roots, points - points.mean(axis=0)
        return np.array([np.vdot(part, part) for part in parts])

    def corrected(
        self,
        white: WhitenedLandmarks,
        factor: Float[np.ndarray, "N N"],
        columns: Int[np.ndarray, " q"],
        log_noise: float,
    ) -> Correction:
        """Correction by whitened observations of errors with this factor.

        Parameters
        ----------
        columns : ndarray of int, shape (q,)
            The errors, which are observed.
        log_noise : float
            Of the sensor's noise, before whitening.
        """
        # Rows of all landmarks in one column of blocks, [H | innovation], rotated to as many rows as H has columns.
        tall = white.rows.reshape(-1, white.shape[2])
        innovation, H, residual = compressed(tall[:, -1], tall[:, :-1])
        Y, log_noise = H @ factor[columns], log_noise + white.log_noise
        return square_root_update(
            MeasurementPrediction(innovation, Y, factor, residual, len(tall), log_noise)
        )

    def solved(
        self,
        observations: MapObservations,
        x: Float[np.ndarray, " m"],
        factor: Float[np.ndarray, "N N"],
        limit: float,
    ) -> tuple[Correction, WhitenedLandmarks] | None:
        """`whitened` and `corrected` at once, if no squared innovation exceeds the limit. Here always None."""
        return None

    def solved_rows(
        self,
        observations: MapObservations,
        linear: Float[np.ndarray, "k d w"],
        log_noise: float,
        factor: Float[np.ndarray, "N N"],
        limit: float,
    ) -> tuple[Correction, WhitenedLandmarks] | None:
        """The same of rows, all of them valid; log_noise of all."""
        return None

    def regressed(
        self, observations: MapObservations, spread: PoseSpread, points: SigmaPoints
    ) -> LinearisedObservations | None:
        """Compiled form of `Spread.regressed`; here always None."""
        return None

    def close(self, stored: LandmarkArrays, closing: Closing) -> ClosedEpoch:
        """Finish an epoch after the correction: the map moves to the next one."""
        # Kept and dropped parts have rows [pose (c) | modes]: new landmarks depend on the pose alone, rows before c.
        c = closing.by_pose.shape[2]
        new = _new_modes(closing)
        late = np.flatnonzero(stored.epoch[: stored.count] < stored.now - (len(stored.shift) - 2))
        self.refresh(stored, np.union1d(np.arange(*closing.behind), late))
        next_epoch(stored, new.kept[c:], new.dropped[c:], closing.error[c:])
        _observe(stored, closing, new)
        own = lower_roots(np.concatenate([closing.roots, closing.by_pose @ new.dropped[:c]], axis=2))
        return ClosedEpoch(new, closing.by_pose @ new.kept[:c], own, _factor_after(closing, new))


def _factor_after(closing: Closing, new: NewModes) -> Float[np.ndarray, "N N"]:
    """Rows of the state (n), reset; of the modes (r), the new ones; of the map's own move, unchanged."""
    n, result = len(closing.reset), closing.correction.factor.copy()
    result[:n] = closing.reset @ result[:n]
    result[n : n + len(new.rows)] = new.rows
    return result


def next_epoch(
    stored: LandmarkArrays,
    transform: Float[np.ndarray, "r r"],
    dropped: Float[np.ndarray, "r c"],
    shift: Float[np.ndarray, " r"],
) -> None:
    """Advance every slot's transformation one step.

    m_before = shift + transform m + dropped f; the new epoch's is the identity.
    """
    # All from the old transform T of each slot: shift += T shift, spread += (T dropped)(T dropped)', then T <- T transform.
    moved = stored.transform @ dropped
    stored.shift += stored.transform @ shift
    stored.spread += moved @ np.swapaxes(moved, 1, 2)
    stored.transform[...] = stored.transform @ transform
    stored.now += 1
    slot = stored.now % len(stored.shift)
    stored.transform[slot], stored.spread[slot], stored.shift[slot] = np.eye(len(shift)), 0.0, 0.0


def _new_modes(closing: Closing) -> NewModes:
    """Modes that explain most of the landmarks' dependence on pose and modes, and the transformation to them."""
    rows, X, r = closing.white.rows[..., :-1], _own_parts(closing.white)[0], len(closing.remembered)
    size = rows.shape[2]
    c = size - r
    # seen: whitened H_p times the updated landmark's dependence on [pose | modes], [0 | A] - L X' rows.
    seen = -(X @ (np.swapaxes(X, 1, 2) @ rows))
    seen[..., c:] += rows[..., c:]
    tall, fresh = seen.reshape(-1, size), np.linalg.solve(closing.roots, closing.by_pose).reshape(-1, c)
    # G over [pose | modes]: observed landmarks, a share of the new ones by pose, and on the modes' diagonal what was remembered.
    G = tall.T @ tall
    G[:c, :c] += NEW_LANDMARK_SHARE * (fresh.T @ fresh)
    G[range(c, size), range(c, size)] += closing.remembered
    # Factor' = turn R: eigenvectors of R G R' in descending order; the first r are kept, the others dropped.
    turn, R = np.linalg.qr(closing.factor.T)
    value, vector = np.linalg.eigh(R @ G @ R.T)
    vector = vector[:, ::-1]
    return NewModes(R.T @ vector, vector[:, :r].T @ turn.T, value[::-1][:r].copy())


def _observe(stored: LandmarkArrays, closing: Closing, new: NewModes) -> None:
    """Correct observed landmarks, and express them by the new modes."""
    at, (X, gram) = closing.at, _own_parts(closing.white)
    modes, roots = stored.modes[at].astype(float), stored.roots[at].astype(float)
    # pull = L X' rows, columns [pose | modes | innovation]; errors of a landmark by both: [0 | A] - pull.
    pull = roots @ (np.swapaxes(X, 1, 2) @ closing.white.rows)
    by_both = -pull[..., :-1]
    by_both[..., len(closing.error) - modes.shape[2] :] += modes
    # Own root after the update: L U'^-1 with U U' = I + gram' gram; what the kept modes drop joins it.
    left = lower_roots(
        np.concatenate([np.broadcast_to(np.eye(3), roots.shape), np.swapaxes(gram, 1, 2)], axis=2)
    )
    own = np.swapaxes(np.linalg.solve(left, np.swapaxes(roots, 1, 2)), 1, 2)
    stored.points[at] += by_both @ closing.error + pull[..., -1]
    stored.modes[at] = by_both @ new.kept
    stored.roots[at] = lower_roots(np.concatenate([own, by_both @ new.dropped], axis=2))
    stored.epoch[at] = stored.now
    stored.last[at], stored.wrong[at] = stored.now - 1, 0
    stored.hits[at] += 1


def _own_parts(white: WhitenedLandmarks) -> tuple[Float[np.ndarray, "k d 3"], Float[np.ndarray, "k d 3"]]:
    """X and H_p L."""
    count, d, width = white.shape
    # Behind the rows (d x width) stand X and H_p L (d x 3 each).
    parts = white.kept[:, d * width :].reshape(count, 2, d, 3)
    return parts[:, 0], parts[:, 1]
