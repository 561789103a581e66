"""From predicted sightings to the rows of one joint correction."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Measurement
from spinfilters.estimators.landmarks.approximation import Approximation, Rows, SightedFrom
from spinfilters.estimators.landmarks.gauge_rules import Point
from spinfilters.estimators.multiplicative_filter import usable
from spinfilters.estimators.robustness import SensorGuard
from spinfilters.models.landmark_sensor import LandmarkSensor
from spinfilters.state.layout import StateLayout

LANDMARK_DIM = 3


@dataclass(frozen=True)
class JointState:
    """A state and its landmarks, held in anchored coordinates; ``linearised_at``: where sightings are differentiated."""

    mean: Float[np.ndarray, " m"]
    anchors: Float[np.ndarray, "k 7"]
    coordinates: Float[np.ndarray, "k 3"]
    linearised_at: Float[np.ndarray, "k 3"]
    factor: Float[np.ndarray, "N N"]

    @property
    def state_dim(self) -> int:
        """n, components of the state's error."""
        return len(self.factor) - LANDMARK_DIM * len(self.coordinates)

    def seen_from(self, rows: Int[np.ndarray, " q"]) -> SightedFrom:
        """What sightings of the landmarks in these rows are predicted from."""
        n = self.state_dim
        blocks = _chosen(self.factor[n:].reshape(-1, LANDMARK_DIM, len(self.factor)), rows)
        here = self.coordinates[rows]
        at = here if self.linearised_at is self.coordinates else self.linearised_at[rows]
        rows_of = blocks.astype(float, copy=False)
        return SightedFrom(
            self.mean, self.root, self.anchors[rows], here, at, rows_of[:, :, :n], rows_of[:, :, n:]
        )

    @property
    def here(self) -> Point:
        """Where its errors are counted from."""
        return Point(self.mean, self.anchors, self.coordinates)

    def displaced(
        self, layout: StateLayout, y: Float[np.ndarray, " m"]
    ) -> tuple[Float[np.ndarray, " n"], Point]:
        """The state's error at the first m coordinates ``y`` of the factor, and the point that lies there."""
        n = self.state_dim
        error = self.factor[:, : len(y)] @ y.astype(self.factor.dtype, copy=False)
        error = error.astype(float, copy=False)
        coordinates = self.coordinates + error[n:].reshape(-1, LANDMARK_DIM)
        return error[:n], Point(layout.retract(self.mean, error[:n]), self.anchors, coordinates)

    @property
    def root(self) -> Float[np.ndarray, "n n"]:
        """Factor of the state alone."""
        n = self.state_dim
        return self.factor[:n, :n].astype(float)


def predicted_sightings(
    approximation: Approximation, joint: JointState, measurement: Measurement, at: Int[np.ndarray, " q"]
) -> tuple[Rows, Float[np.ndarray, "q 3 c"]]:
    """Predicted sightings of the landmarks in rows ``at``, one per value, and the landmarks' factor rows on their coordinates."""
    sensor = measurement.model
    if not isinstance(sensor, LandmarkSensor) or sensor.dim > LANDMARK_DIM:
        raise InputError(f"sensor {sensor.name!r} names landmarks, but cannot see them; leave out their ids")
    place = joint.seen_from(at)
    return approximation.sightings(sensor, place, measurement.values, measurement.parameters), place.rest


def stacked(
    rows: Rows, weights: Float[np.ndarray, " q"], at: Int[np.ndarray, " q"], factor: Float[np.ndarray, "N N"]
) -> tuple[Float[np.ndarray, "l N"], Float[np.ndarray, " l"]]:
    """Lower trapezoid of rows over the coordinates of the factor, and the innovations beside it; see `corrected`.

    A sighting's three rows are turned among themselves until its landmark's own block is triangular.
    """
    n, size, dtype = rows.by_state.shape[2], len(factor), factor.dtype
    count = (size - n) // LANDMARK_DIM
    use = np.flatnonzero(weights > 0)
    scale, at = np.sqrt(weights[use]), at[use]
    every = (
        np.concatenate([rows.by_landmark, rows.by_state, rows.innovation[:, :, None]], axis=2)[use]
        * scale[:, None, None]
    )
    blocks = factor[n:, n:].reshape(count, LANDMARK_DIM, size - n)
    diagonal = blocks[at[:, None], :, (LANDMARK_DIM * at)[:, None] + np.arange(LANDMARK_DIM)]
    diagonal = np.swapaxes(diagonal, 1, 2)
    turned = _lower_first(every[:, :, :LANDMARK_DIM] @ diagonal, every)
    Y = np.zeros((count, LANDMARK_DIM, size), dtype=dtype)
    rho = np.zeros((count, LANDMARK_DIM), dtype=dtype)
    dim = turned.shape[1]
    Y[at, -dim:, :n] = turned[:, :, LANDMARK_DIM:-1]
    Y[at, -dim:, n:] = turned[:, :, :LANDMARK_DIM].astype(dtype, copy=False) @ _chosen(blocks, at)
    rho[at, -dim:] = turned[:, :, -1]
    return _without_rounding(Y, n).reshape(-1, size), rho.reshape(-1)


def _chosen(blocks: Float[np.ndarray, "k 3 N"], rows: Int[np.ndarray, " q"]) -> Float[np.ndarray, "q 3 N"]:
    """The blocks in ascending rows; all of them without a copy."""
    return blocks if len(rows) == len(blocks) else blocks[rows]


def _lower_first(
    blocks: Float[np.ndarray, "q r 3"], every: Float[np.ndarray, "q r c"]
) -> Float[np.ndarray, "q r c"]:
    """``every`` turned by the orthogonal matrices that make the blocks lower triangular."""
    turn = np.linalg.qr(blocks[:, ::-1, ::-1], mode="complete")[0]
    return (np.swapaxes(turn, 1, 2) @ every[:, ::-1])[:, ::-1]


def _without_rounding(Y: Float[np.ndarray, "k 3 N"], n: int) -> Float[np.ndarray, "k 3 N"]:
    """Exact zeros above the diagonal of each landmark's own block, where the turn has left rounding."""
    k = np.arange(len(Y))
    for row, column in ((0, 1), (0, 2), (1, 2)):
        Y[k, row, n + LANDMARK_DIM * k + column] = 0.0
    return Y


def guarded_weights(
    guard: SensorGuard, rows: Rows, rest: Float[np.ndarray, "q l c"]
) -> Float[np.ndarray, " q"]:
    """Weights of predicted values; 0 for those that are not valid, not finite, or refused by the gate.

    Parameters
    ----------
    rest: the landmarks' factor rows on their own coordinates; (q, 0, 0) for sensors that see none.
    """
    keep = np.flatnonzero(usable(rows.innovation, rows.valid))
    result = np.zeros(len(rows.innovation))
    if not keep.size:
        return result

    def deviations(chosen: Bool[np.ndarray, " k"]) -> Float[np.ndarray, "s r c"]:
        those = keep[chosen]
        return np.concatenate([rows.by_state[those], rows.by_landmark[those] @ rest[those]], axis=2)

    weights = guard.weights(rows.innovation[keep], deviations)
    result[keep] = 1.0 if weights is None else weights
    return result
