"""What happens to a covariance when an update moves the point it stands at, so that the gauge of g gains no information.

Transition and sightings respect the gauge at whatever point they are linearised: Phi N(x) = N(x') and H N(x) = 0. What breaks it is
the update, after which the directions N are those of another point while the errors are still counted as before. A rule maps errors
about the old point to errors about the new one, d' = M d with M N_before = N_after; it differs from the identity by the size of the
correction. (Huang, Mourikis, Roumeliotis 2010 for first estimates and the observability constraint; Barrau and Bonnabel 2015 for
the invariant error.)
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.models.anchored_point import anchored_points
from spinfilters.models.gauge import GAUGE_DIM, gauge_directions, gauge_of_points
from spinfilters.state.layout import StateLayout


@dataclass(frozen=True)
class Point:
    """Where a joint error is counted from: a state, and landmarks in anchored coordinates."""

    mean: Float[np.ndarray, " m"]
    anchors: Float[np.ndarray, "k 7"]
    coordinates: Float[np.ndarray, "k 3"]

    def landmark_directions(self) -> Float[np.ndarray, "l 6"]:
        """Errors of the landmarks' coordinates per unit of a gauge move."""
        points, slopes = anchored_points(self.anchors, self.coordinates)
        moves = gauge_of_points(points).reshape(-1, 3, GAUGE_DIM)
        return np.linalg.solve(slopes, moves).reshape(-1, GAUGE_DIM)


class GaugeRule(ABC):
    """How errors are carried from the point before an update to the point after it."""

    name: str

    @abstractmethod
    def carried(
        self, layout: StateLayout, before: Point, after: Point, reset: Float[np.ndarray, "n n"]
    ) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "l n"]]:
        """(A, B): the state's new errors are A d, those of the landmarks their old ones plus B d, d the state's old errors.

        Parameters
        ----------
        reset: derivative of the new errors by the old in the chart itself (`StateLayout.reset_jacobian`).
        """

    def linearised_at(
        self, present: Float[np.ndarray, "k 3"], first: Float[np.ndarray, "k 3"]
    ) -> Float[np.ndarray, "k 3"]:
        """Coordinates at which sightings are differentiated: the present ones, or those of the first sighting."""
        return present


class Standard(GaugeRule):
    """Errors are counted as before: the textbook filter, which takes its own corrections for information about the gauge."""

    name = "standard"

    def carried(
        self, layout: StateLayout, before: Point, after: Point, reset: Float[np.ndarray, "n n"]
    ) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "l n"]]:
        return reset, np.zeros((3 * len(after.coordinates), layout.error_dim))


class _Projected(GaugeRule):
    """M = reset + (N_after - reset N_before) S with some left inverse S of the state's rows of N_before."""

    def carried(
        self, layout: StateLayout, before: Point, after: Point, reset: Float[np.ndarray, "n n"]
    ) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "l n"]]:
        old, new = gauge_directions(layout, before.mean), gauge_directions(layout, after.mean)
        inverse = self._left_inverse(layout, old)
        shifted = self._landmark_change(before, after)
        return reset + (new - reset @ old) @ inverse, shifted @ inverse

    @abstractmethod
    def _left_inverse(
        self, layout: StateLayout, directions: Float[np.ndarray, "n 6"]
    ) -> Float[np.ndarray, "6 n"]:
        """S with S N = I."""

    def _landmark_change(self, before: Point, after: Point) -> Float[np.ndarray, "l 6"]:
        return after.landmark_directions() - before.landmark_directions()


class Invariant(_Projected):
    """The error of everything in g is counted in the frame of the pose's error, where the gauge directions are constant."""

    name = "invariant"

    def _left_inverse(
        self, layout: StateLayout, directions: Float[np.ndarray, "n 6"]
    ) -> Float[np.ndarray, "6 n"]:
        pose = np.r_[layout.slice("t"), layout.slice("a")]
        inverse = np.zeros((directions.shape[1], len(directions)))
        inverse[:, pose] = np.linalg.inv(directions[pose])
        return inverse


class FirstEstimates(Invariant):
    """Sightings are differentiated at each landmark's first estimate for ever; the state's own errors are carried on."""

    name = "first-estimates"

    def _landmark_change(self, before: Point, after: Point) -> Float[np.ndarray, "l 6"]:
        return np.zeros((3 * len(after.coordinates), GAUGE_DIM))

    def linearised_at(
        self, present: Float[np.ndarray, "k 3"], first: Float[np.ndarray, "k 3"]
    ) -> Float[np.ndarray, "k 3"]:
        return first


class Constrained(_Projected):
    """The smallest change of the state's errors that meets the constraint, each counted in its own unit."""

    name = "constrained"

    def _left_inverse(
        self, layout: StateLayout, directions: Float[np.ndarray, "n 6"]
    ) -> Float[np.ndarray, "6 n"]:
        return np.linalg.pinv(directions)


GAUGE_RULES: dict[str, GaugeRule] = {
    rule.name: rule for rule in (Standard(), Invariant(), FirstEstimates(), Constrained())
}


def gauge_rule(name: str) -> GaugeRule:
    """The rule of that name. InputError when there is none."""
    if name not in GAUGE_RULES:
        raise InputError(f"gauge rule {name!r} is unknown; use one of {', '.join(GAUGE_RULES)}")
    return GAUGE_RULES[name]
