"""Second-order terms of the motion along soft directions of a belief, which a covariance along tangents lacks.

Let sigma be the standard deviation of the mass distribution s along a principal direction of its covariance, b the change of the
state that one such deviation brings with it, and f the motion over a stretch of time, with the derivative F. For u ~ N(0, 1)

    f(x [+] b u) = f(x) [+] (F b u + c u^2 / 2 + ...),    c = (f(x [+] b) [-] f(x)) + (f(x [+] -b) [-] f(x)),

so that the mean square of the errors about f(x) is F P F' + 3/4 c c'. Where little disturbs the motion, a filter without these
terms keeps for certain what it learnt along a tangent while its mean moves along the curve, and ends over-confident.

The terms of neighbouring steps have the same u, and add up: over n steps to n^2 of one, not to n. They are therefore computed for
a stretch of many steps, in which the body turns by a small angle, and count from its begin, as F^-1 c, so that all values within it
are weighted with them.
"""

from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.filters.estimator import ProcessModel, Snapshot
from spinfilters.filters.square_root import triangular_factor
from spinfilters.models.rotation_integrator import IntegrationError
from spinfilters.models.state_blocks import MASS_DISTRIBUTION, RATE
from spinfilters.models.state_layout import StateLayout

TURN: Final = 1.0
"""Angle by which the body turns in a stretch, rad, where an epoch is not longer."""
SOFT: Final = 0.02
"""Standard deviation of the logarithm of second moments, beyond which states may bend by more than noise moves them."""
LONGEST_STEP: Final = 0.35
"""Of these logarithms from the mean to the states that a bend is computed of; of a softer direction it is enlarged from there."""
NEGLIGIBLE, LONGEST_PAUSE = 0.1, 64
"""Deviations of a belief below which a bend does not count, and stretches that pass at most before the next is computed. Ten
stretches of such bends would widen deviations by 4 %; those that make a filter over-confident, as of short throws, are of 1 to 30.
Each bend that does not count doubles the pause."""
LEFT: Final = "flow_curvature.left"
"""Name in a snapshot."""


class FlowCurvature:
    """When a belief is widened by second-order terms, and how.

    Parameters
    ----------
    turn : float
        Angle by which the body turns in a stretch, rad; infinite of a filter of first order.

    Attributes
    ----------
    turn : float
        The same.
    """

    def __init__(self, turn: float = np.inf) -> None:
        self.turn = turn
        self.begin()

    @property
    def widens(self) -> bool:
        """Whether it ever widens a belief."""
        return bool(np.isfinite(self.turn))

    def begin(self) -> None:
        """Begin with a new belief."""
        self._left = 0.0 if self.widens else np.inf  # infinite: no belief to come is widened
        self._pause = 1

    def widened(
        self,
        process: ProcessModel,
        mean: Float[np.ndarray, " m"],
        factor: Float[np.ndarray, "N N"],
        dt: float,
    ) -> Float[np.ndarray, "N N"]:
        """The covariance factor before a step, with the terms of a stretch where one begins.

        Parameters
        ----------
        dt : float
            Duration of the step, s.
        """
        if not self.is_due(dt):
            return factor
        stretch = self.next_stretch(process.layout, mean, factor, dt)
        if stretch is None:
            self.end()
            return factor
        n = process.layout.error_dim
        bends = bends_over(process, mean, factor[:n], stretch)
        is_negligible = _largest(bends, factor[:n]) < NEGLIGIBLE
        self.begin_stretch(stretch, is_negligible)
        if is_negligible or not np.isfinite(bends).all():
            return factor
        # S S' + 3/4 sum of c c'
        rows = np.zeros((len(factor), len(bends)))
        rows[:n] = np.sqrt(0.75) * bends.T
        return triangular_factor(np.concatenate([factor, rows], axis=1).T)

    def is_due(self, dt: float) -> bool:
        """Whether a stretch begins with a step of this duration (s)."""
        return self._left < dt / 2

    def next_stretch(
        self,
        layout: StateLayout,
        mean: Float[np.ndarray, " m"],
        factor: Float[np.ndarray, "N N"],
        dt: float,
    ) -> float | None:
        """Duration (s) of the stretch that begins with a step of dt; None where none begins."""
        if not self.is_due(dt) or not _is_soft(layout, factor):
            return None
        return self.stretch(float(np.linalg.norm(mean[layout.mean_slice(RATE.name)])), dt)

    def stretch(self, rate: float, dt: float) -> float:
        """Duration (s) of a stretch at a rate (rad/s), of no less than a step."""
        return max(self.turn / rate, dt) if rate else dt

    def begin_stretch(self, stretch: float, is_negligible: bool) -> None:
        """Note that a stretch begins, and whether its terms count."""
        self._pause = min(2 * self._pause, LONGEST_PAUSE) if is_negligible else 1
        self._left = self._pause * stretch

    def end(self) -> None:
        """Widen no more: the mass distribution is known, and does not change."""
        self._left = np.inf

    def pass_step(self, dt: float) -> None:
        """Note that a step was made, of this duration."""
        self._left -= dt

    def begun(self) -> "FlowCurvature":
        """The same of another run, from its begin on."""
        return FlowCurvature(self.turn)

    def stretch_left(self) -> Float[np.ndarray, "2"]:
        """Seconds until the next stretch begins, and the pause in stretches."""
        return np.array([self._left, self._pause])

    def go_on(self, left: Float[np.ndarray, "2"]) -> None:
        """Go on within a stretch, as of `stretch_left`."""
        self._left, self._pause = float(left[0]), int(left[1])

    def snapshot(self) -> Snapshot:
        """What is left of a stretch."""
        return {LEFT: self.stretch_left()}

    def restore(self, snapshot: Snapshot) -> None:
        """Go on from a snapshot."""
        self.go_on(snapshot[LEFT])


def _is_soft(layout: StateLayout, factor: Float[np.ndarray, "N N"]) -> bool:
    """Whether states of a belief may bend: along its widest direction of the mass distribution, if it has one."""
    if not layout.has(MASS_DISTRIBUTION):
        return False
    rows = factor[layout.slice(MASS_DISTRIBUTION.name)]
    return bool(np.isfinite(rows).all() and np.linalg.norm(rows, 2) > SOFT)


def _largest(bends: Float[np.ndarray, "q n"], factor: Float[np.ndarray, "n e"]) -> float:
    """The largest bend in deviations of its belief; infinite where that is singular."""
    square = factor if factor.shape[0] == factor.shape[1] else triangular_factor(factor.T)
    try:
        return float(np.linalg.norm(np.linalg.solve(square, bends.T), axis=0).max(initial=0.0))
    except np.linalg.LinAlgError:
        return np.inf


def bends_over(
    process: ProcessModel,
    mean: Float[np.ndarray, " m"],
    factor: Float[np.ndarray, "n r"],
    duration: float,
) -> Float[np.ndarray, "q n"]:
    """F^-1 c of a stretch along each soft direction, principal ones of the mass distribution; none where the belief has none.

    Parameters
    ----------
    mean : (m,) float array
        State at the begin.
    factor : (n, r) float array
        Its covariance factor.
    duration : float
        Of the stretch, s.

    Returns
    -------
    (q, n) float array
        Changes of the state at the begin; not finite where F has no inverse.
    """
    layout = process.layout
    rows = factor[layout.slice(MASS_DISTRIBUTION.name)]
    directions, widths, _ = np.linalg.svd(rows, full_matrices=False)
    soft = widths > SOFT
    count = int(np.count_nonzero(soft))
    # b = P[:, s] e / sigma, shortened to a step that stays where the second order holds; a row for each direction
    length = np.minimum(1.0, LONGEST_STEP / widths[soft])
    b = (factor @ (rows.T @ (directions[:, soft] * (length / widths[soft])))).T
    around = layout.retract(
        np.tile(mean, (2 * count + 1, 1)), np.concatenate([b, -b, np.zeros((1, len(factor)))])
    )
    try:
        ends = process.step(around, duration)
        away = layout.local_each(ends[-1], ends[:-1])
        c = (away[:count] + away[count:]) / length[:, np.newaxis] ** 2
        return np.linalg.solve(process.linearise(mean, duration).transition, c.T).T
    except (IntegrationError, np.linalg.LinAlgError):
        return np.full(b.shape, np.nan)
