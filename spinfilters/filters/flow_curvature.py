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
    """

    def __init__(self, turn: float = np.inf) -> None:
        self._turn = turn
        self.begin()

    def begin(self) -> None:
        """Begin with a new belief."""
        self._left = 0.0 if np.isfinite(self._turn) else np.inf  # infinite: no belief to come is widened
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
        if self._left >= dt / 2:
            return factor
        layout = process.layout
        if not self.widens(layout, factor):  # nor will it ever be: the mass distribution does not change
            self._left = np.inf
            return factor
        rate = float(np.linalg.norm(mean[layout.mean_slice(RATE.name)]))
        stretch = max(self._turn / rate, dt) if rate else dt
        bends = bends_over(process, mean, factor[: layout.error_dim], stretch)
        is_negligible = _size_of(bends, factor[: layout.error_dim]) < NEGLIGIBLE
        self._pause = min(2 * self._pause, LONGEST_PAUSE) if is_negligible else 1
        self._left = self._pause * stretch
        if is_negligible or not np.isfinite(bends).all():
            return factor
        rows = np.zeros((len(factor), len(bends)))
        rows[: layout.error_dim] = np.sqrt(0.75) * bends.T
        return triangular_factor(np.concatenate([factor, rows], axis=1).T)  # S S' + 3/4 sum of c c'

    def steps_in_stretch(self, dt: Float[np.ndarray, " k"]) -> int:
        """How many of the next steps, of these durations, begin within the stretch that has begun."""
        begins_another = self._left_after(dt[:-1]) < dt[1:] / 2
        return int(np.argmax(begins_another)) + 1 if begins_another.any() else len(dt)

    def pass_steps(self, dt: Float[np.ndarray, " k"]) -> None:
        """Note that steps were made, of these durations."""
        if len(dt):
            self._left = float(self._left_after(dt)[-1])

    def _left_after(self, dt: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Seconds left of the stretch after each step, to the bits of one after the other."""
        return np.subtract.accumulate(np.concatenate([[self._left], dt]))[1:]

    def begun(self) -> "FlowCurvature":
        """The same of another run, from its begin on."""
        return FlowCurvature(self._turn)

    def widens(self, layout: StateLayout, factor: Float[np.ndarray, "N N"]) -> bool:
        """Whether a filter that begins with a covariance factor is ever widened."""
        if not np.isfinite(self._turn) or not layout.has(MASS_DISTRIBUTION):
            return False
        rows = factor[layout.slice(MASS_DISTRIBUTION.name)]
        return bool(np.isfinite(rows).all() and np.linalg.norm(rows, 2) > SOFT)

    def snapshot(self) -> Snapshot:
        """Seconds until the next stretch begins, and the pause in stretches."""
        return {LEFT: np.array([self._left, self._pause])}

    def restore(self, snapshot: Snapshot) -> None:
        """Go on from a snapshot."""
        self._left, self._pause = float(snapshot[LEFT][0]), int(snapshot[LEFT][1])


def _size_of(bends: Float[np.ndarray, "q n"], factor: Float[np.ndarray, "n r"]) -> float:
    """The largest bend in deviations of a belief; infinite where that is singular."""
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
    """F^-1 c of a stretch along each soft direction; none where the belief has none.

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
    if not soft.any():
        return np.zeros((0, layout.error_dim))
    # b = P[:, s] e / sigma, shortened to a step that stays where the second order holds
    length = np.minimum(1.0, LONGEST_STEP / widths[soft])
    b = (factor @ (rows.T @ (directions[:, soft] * (length / widths[soft])))).T
    here = np.tile(mean, (len(b), 1))
    around = np.concatenate([mean[np.newaxis], layout.retract(here, b), layout.retract(here, -b)])
    try:
        ends, transition = process.step(around, duration), process.linearise(mean, duration).transition
        middle = np.tile(ends[0], (len(b), 1))
        c = layout.local(middle, ends[1 : len(b) + 1]) + layout.local(middle, ends[len(b) + 1 :])
        return np.linalg.solve(transition, (c / length[:, np.newaxis] ** 2).T).T
    except (IntegrationError, np.linalg.LinAlgError):
        return np.full((len(b), layout.error_dim), np.nan)
