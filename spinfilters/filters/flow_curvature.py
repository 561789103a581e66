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

from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

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
        return widened_runs([self], process, mean[np.newaxis], factor[np.newaxis], np.array([dt])).get(
            0, factor
        )

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
        if not self.is_due(dt) or not _is_soft(layout, factor[np.newaxis]).all():
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


def widened_runs(
    curvatures: Sequence[FlowCurvature],
    process: ProcessModel,
    mean: Float[np.ndarray, "r m"],
    factor: Float[np.ndarray, "r N N"],
    dt: Float[np.ndarray, " r"],
) -> dict[int, Float[np.ndarray, "N N"]]:
    """`FlowCurvature.widened` of many runs, each to the numbers of a run by itself.

    Parameters
    ----------
    curvatures : Sequence[FlowCurvature]
        Of each run.
    mean, factor : ndarray
        Beliefs of the runs before their next step.
    dt : ndarray of float, shape (r,)
        Duration of that step, s.

    Returns
    -------
    dict[int, ndarray]
        Covariance factors of the runs that are widened, by the run's place.
    """
    layout = process.layout
    due = np.array([k for k, each in enumerate(curvatures) if each.is_due(float(dt[k]))], dtype=np.int64)
    if not due.size:
        return {}
    soft = _is_soft(layout, factor[due])
    for k in due[~soft].tolist():
        curvatures[k].end()
    due = due[soft]
    if not due.size:
        return {}
    S = factor[due, : layout.error_dim]
    rates = np.linalg.norm(mean[due][:, layout.mean_slice(RATE.name)], axis=1)
    stretches = [
        curvatures[k].stretch(rate, step)
        for k, rate, step in zip(due.tolist(), rates.tolist(), dt[due].tolist(), strict=True)
    ]
    bends = bends_of_runs(process, mean[due], S, np.array(stretches))
    negligible = _sizes(bends, S) < NEGLIGIBLE
    finite = np.asarray(np.isfinite(bends).all(axis=(1, 2)))
    found = {}
    for k, c, stretch, small, known in zip(due.tolist(), bends, stretches, negligible, finite, strict=True):
        curvatures[k].begin_stretch(stretch, bool(small))
        if known and not small:
            rows = np.zeros((factor.shape[1], len(c)))
            rows[: layout.error_dim] = np.sqrt(0.75) * c.T
            # S S' + 3/4 sum of c c'
            found[k] = triangular_factor(np.concatenate([factor[k], rows], axis=1).T)
    return found


def _is_soft(layout: StateLayout, factor: Float[np.ndarray, "r N N"]) -> Bool[np.ndarray, " r"]:
    """Whether states of each belief may bend: along its widest direction of the mass distribution, if it has one."""
    if not layout.has(MASS_DISTRIBUTION):
        return np.zeros(len(factor), dtype=bool)
    rows = factor[:, layout.slice(MASS_DISTRIBUTION.name)]
    square = np.einsum(
        "rie,rie->r", rows, rows
    )  # the largest singular value lies between root(square / 5) and root(square)
    soft = (square > SOFT**2) & (square < np.inf)
    narrow = soft & (square <= 1.01 * rows.shape[1] * SOFT**2)
    if narrow.any():
        soft[narrow] = np.linalg.norm(rows[narrow], 2, axis=(1, 2)) > SOFT
    return soft


def _sizes(bends: Float[np.ndarray, "r q n"], factor: Float[np.ndarray, "r n e"]) -> Float[np.ndarray, " r"]:
    """The largest bend of each run in deviations of its belief; infinite where that is singular."""
    square = factor
    if factor.shape[1] != factor.shape[2]:
        square = np.stack([triangular_factor(each.T) for each in factor])
    try:
        return np.linalg.norm(np.linalg.solve(square, np.swapaxes(bends, 1, 2)), axis=1).max(axis=1)
    except np.linalg.LinAlgError:
        if len(bends) == 1:
            return np.array([np.inf])
        return np.concatenate([_sizes(bends[[k]], square[[k]]) for k in range(len(bends))])


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
    (bends,) = bends_of_runs(process, mean[np.newaxis], factor[np.newaxis], np.array([duration]))
    return bends[np.any(bends != 0, axis=1)]


def bends_of_runs(
    process: ProcessModel,
    mean: Float[np.ndarray, "r m"],
    factor: Float[np.ndarray, "r n e"],
    duration: Float[np.ndarray, " r"],
) -> Float[np.ndarray, "r q n"]:
    """F^-1 c of a stretch of each run along its principal directions of the mass distribution.

    Parameters
    ----------
    mean : (r, m) float array
        States at the begin.
    factor : (r, n, e) float array
        Their covariance factors.
    duration : (r,) float array
        Of each run's stretch, s.

    Returns
    -------
    (r, q, n) float array
        Changes of the state at the begin, zero along directions that are not soft; not finite where F has no inverse.
    """
    layout = process.layout
    rows = factor[:, layout.slice(MASS_DISTRIBUTION.name)]
    directions, widths, _ = np.linalg.svd(rows, full_matrices=False)
    bends = np.zeros((*widths.shape, layout.error_dim))
    run, direction = np.nonzero(widths > SOFT)
    if not run.size:
        return bends
    # b = P[:, s] e / sigma, shortened to a step that stays where the second order holds; a row for each run and direction
    soft = widths[run, direction]
    length = np.minimum(1.0, LONGEST_STEP / soft)
    e = directions[run, :, direction] * (length / soft)[:, np.newaxis]
    b = (factor[run] @ (np.swapaxes(rows, 1, 2)[run] @ e[:, :, np.newaxis]))[:, :, 0]
    both, runs, count = np.concatenate([run, run]), np.arange(len(mean)), len(b)
    around = np.concatenate([layout.retract(mean[both], np.concatenate([b, -b])), mean])
    try:
        of = np.concatenate([both, runs])
        ends, transition = process.steps(around, duration[of], of), process.transitions(mean, duration)
        away = layout.local_pairs(ends[2 * count :][both], ends[: 2 * count])
        c = away[:count] + away[count:]
        bends[run, direction] = c / length[:, np.newaxis] ** 2
        return np.swapaxes(np.linalg.solve(transition, np.swapaxes(bends, 1, 2)), 1, 2)
    except (IntegrationError, np.linalg.LinAlgError):  # of one run, for which others need not pay
        if len(runs) == 1:
            return np.full_like(bends, np.nan)
        alone = [bends_of_runs(process, mean[[k]], factor[[k]], duration[[k]]) for k in runs]
        return np.concatenate(alone)
