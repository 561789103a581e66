"""One update with sightings: the most probable error, iterated where the sightings are bent.

The error is sought in the coordinates y of the factor, x(y) = x [+] F y, as the minimum of |y|^2 + sum of w |r(x(y))|^2. The first
solution is that of the ordinary filter. If the innovations at the point it leads to are not what the linear model foretold, all is
differentiated again there (`spinfilters.estimators.iterated`); a linear sighting changes nothing.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.estimators.estimator import Measurement
from spinfilters.estimators.iterated import IterationOptions, agrees, iterate
from spinfilters.estimators.landmarks.approximation import Approximation, Rows
from spinfilters.estimators.landmarks.gauge_rules import GaugeRule
from spinfilters.estimators.landmarks.joint_factor import JointCorrection, corrected
from spinfilters.estimators.landmarks.sightings import LANDMARK_DIM, JointState, predicted_sightings, stacked
from spinfilters.models.anchored_point import anchored_points
from spinfilters.state.layout import StateLayout

Weigh = Callable[[Rows, Float[np.ndarray, "q 3 c"]], Float[np.ndarray, " q"]]
"""Weights of predicted sightings, from them and their landmarks' factor rows on the landmarks' coordinates."""


@dataclass(frozen=True)
class JointUpdate:
    """Sightings as last predicted, their weights, and what they say."""

    rows: Rows
    weights: Float[np.ndarray, " q"]
    correction: JointCorrection

    @property
    def coordinates(self) -> Float[np.ndarray, " N"]:
        """The most probable y."""
        return self.correction.coordinates

    @property
    def root(self) -> Float[np.ndarray, "m m"]:
        """Upper triangular R, R'R = I + Y'Y in reversed order."""
        return self.correction.root

    @property
    def nis(self) -> float:
        """Normalised innovation squared."""
        return self.correction.nis

    @property
    def dof(self) -> int:
        """Number of scalars that count."""
        return int(np.count_nonzero(self.weights > 0)) * self.rows.innovation.shape[1]

    def length(self, step: Float[np.ndarray, " N"]) -> float:
        """A step of y in standard deviations of what the sightings leave uncertain."""
        return float(np.linalg.norm(self.correction.root @ step[::-1]))


@dataclass(frozen=True)
class SightingProblem:
    """Sightings of the landmarks in rows ``at`` of a joint state.

    Attributes
    ----------
    rule: how errors about one point are those about another.
    scale: by which the sensor's covariance differs from the stated one.
    """

    layout: StateLayout
    approximation: Approximation
    rule: GaugeRule
    joint: JointState
    measurement: Measurement
    at: Int[np.ndarray, " q"]
    scale: float = 1.0

    def solve(self, weigh: Weigh, options: IterationOptions) -> JointUpdate:
        """The update; weights are those of the first prediction throughout."""
        rows, rest = self._predicted_from(self.joint)
        weights = weigh(rows, rest)
        first = JointUpdate(rows, weights, corrected(*stacked(rows, weights, self.at, self.joint.factor)))
        if options.iterations == 1 or self._is_good(first, options):
            return first
        y, last = iterate(
            first, lambda y: self._solution(weights, y), lambda y: self._objective(weights, y), options
        )
        return replace(last, correction=replace(last.correction, coordinates=y))

    def _is_good(self, first: JointUpdate, options: IterationOptions) -> bool:
        """Whether the innovations at the first solution are what the linear model foretold."""
        used = first.weights > 0
        found, valid = self._innovations_at(first.coordinates)
        foretold = first.rows.innovation - self._change(first.rows, first.coordinates)
        root = np.sqrt(first.weights[used])[:, None]
        off = (root * found[used]).reshape(-1), (root * foretold[used]).reshape(-1)
        return bool(valid[used].all()) and agrees(*off, options)

    def _solution(self, weights: Float[np.ndarray, " q"], y: Float[np.ndarray, " N"]) -> JointUpdate:
        """The solution of the problem linearised at y."""
        rows = self._predicted_at(y)
        back = replace(rows, innovation=rows.innovation + self._change(rows, y))
        correction = corrected(*stacked(back, weights, self.at, self.joint.factor))
        return JointUpdate(rows, weights, correction)

    def _objective(self, weights: Float[np.ndarray, " q"], y: Float[np.ndarray, " N"]) -> float:
        """|y|^2 + sum of w |r|^2, infinite where a sighting is impossible."""
        used = weights > 0
        innovation, valid = self._innovations_at(y)
        if not valid[used].all():
            return np.inf
        squared = np.einsum("qr,qr->q", innovation[used], innovation[used])
        return float(y @ y + weights[used] @ squared)

    def _innovations_at(
        self, y: Float[np.ndarray, " N"]
    ) -> tuple[Float[np.ndarray, "q r"], Bool[np.ndarray, " q"]]:
        """Innovations from x(y), whitened as at y = 0, and where they are valid."""
        there = self.joint.displaced(self.layout, y)[1]
        sensor, values = self.measurement.model, self.measurement.values
        points = anchored_points(there.anchors[self.at], there.coordinates[self.at])[0]
        placed = np.concatenate([points, self.measurement.parameters[:, LANDMARK_DIM:]], axis=1)
        innovation, valid = sensor.innovations(there.mean, placed, values)
        whitening = sensor.whitening(self.joint.mean, placed) / np.sqrt(self.scale)
        return (whitening @ innovation[..., None])[..., 0], valid

    def _predicted_at(self, y: Float[np.ndarray, " N"]) -> Rows:
        """Sightings from x(y), in the coordinates of the prior's factor."""
        joint, n = self.joint, self.joint.state_dim
        error, there = joint.displaced(self.layout, y)
        reset = self.layout.reset_jacobian(error)
        state, landmarks = self.rule.carried(self.layout, joint.here, there, reset)
        factor = joint.factor.copy()
        factor[:n, :n] = state @ joint.factor[:n, :n]
        factor[n:, :n] += landmarks @ joint.factor[:n, :n]
        at = there.coordinates if joint.linearised_at is joint.coordinates else joint.linearised_at
        moved = replace(
            joint, mean=there.mean, coordinates=there.coordinates, linearised_at=at, factor=factor
        )
        return self._predicted_from(moved)[0]

    def _predicted_from(self, joint: JointState) -> tuple[Rows, Float[np.ndarray, "q 3 c"]]:
        rows, rest = predicted_sightings(self.approximation, joint, self.measurement, self.at)
        return rows.scaled(self.scale), rest

    def _change(self, rows: Rows, y: Float[np.ndarray, " N"]) -> Float[np.ndarray, "q r"]:
        """What coordinates y move in the sightings, to first order."""
        n = self.joint.state_dim
        own = (self.joint.factor[n:, n:] @ y[n:]).reshape(-1, 3)[self.at]
        return rows.by_state @ y[:n] + np.einsum("qri,qi->qr", rows.by_landmark, own)
