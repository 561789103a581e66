"""Marginalization of landmarks and epochs into a square-root prior."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.compiled import address
from spinfilters.core.linear_algebra import dpstrf, dtpqrt, dtrtrs
from spinfilters.smoother.elimination import POSE, eliminate
from spinfilters.smoother.kernels import kernels
from spinfilters.smoother.landmark_factors import LinearObservations
from spinfilters.smoother.motion_factors import EpochFactors, prior_rows
from spinfilters.smoother.priors import (
    MarginalizationPrior,
    VariableOrdering,
    column_errors,
    column_resets,
    gauge_columns,
    prior_structure,
    with_columns_reset,
)
from spinfilters.smoother.problem import LinearProblem, NormalEquations, Problem
from spinfilters.smoother.window import Window


def spread_poses(
    rows: Float[np.ndarray, "r w"], ordering: VariableOrdering, more: int
) -> Float[np.ndarray, "r x"]:
    """Pose rows spread over the prior's columns and ``more``."""
    size = rows.shape[1] - 1 + len(ordering.constant) + len(ordering.tridiagonal) + more
    out = np.zeros((len(rows), size + 1))
    # Poses first, right-hand side last; constants, velocities and `more` between them stay zero.
    out[:, : rows.shape[1] - 1], out[:, -1] = rows[:, :-1], rows[:, -1]
    return out


def spread_step(
    rows: Float[np.ndarray, "d w"], k: int, count: int, ordering: VariableOrdering
) -> Float[np.ndarray, "d x"]:
    """Dynamics rows of step k over the columns of the marginalization.

    Poses, constants, velocities of ``count`` epochs and of the next, right-hand side.
    """
    p, c, v, K = len(ordering.pose), len(ordering.constant), len(ordering.tridiagonal), ordering.epochs
    d, tridiagonal = p + v, K * p + c
    out = np.zeros((len(rows), tridiagonal + (count + 1) * v + 1))
    # Rows [pose_k | velocity_k | pose_k+1 | velocity_k+1 | constants | right], to poses | constants | velocities | right.
    for moving, epoch in ((0, k), (d, k + 1)):
        out[:, epoch * p : (epoch + 1) * p] = rows[:, moving : moving + p]
        out[:, tridiagonal + epoch * v : tridiagonal + (epoch + 1) * v] = rows[:, moving + p : moving + d]
    out[:, K * p : tridiagonal], out[:, -1] = rows[:, 2 * d : -1], rows[:, -1]
    return out


def spread_epoch(
    rows: Float[np.ndarray, "r w"], k: int, count: int, ordering: VariableOrdering
) -> Float[np.ndarray, "r x"]:
    """Rows of epoch k alone over the same columns."""
    p, c, v, K = len(ordering.pose), len(ordering.constant), len(ordering.tridiagonal), ordering.epochs
    tridiagonal = K * p + c
    out = np.zeros((len(rows), tridiagonal + (count + 1) * v + 1))
    # Rows [pose | velocity | constants | right] of epoch k, to poses | constants | velocities | right.
    out[:, k * p : (k + 1) * p], out[:, tridiagonal + k * v : tridiagonal + (k + 1) * v] = (
        rows[:, :p],
        rows[:, p : p + v],
    )
    out[:, K * p : tridiagonal], out[:, -1] = rows[:, p + v : -1], rows[:, -1]
    return out


def elimination_order(ordering: VariableOrdering, removed: int) -> Int[np.ndarray, " w"]:
    """Columns of the marginalization prior in the order of elimination.

    Velocities after that of its first epoch, then the rest and the right-hand side, as epochs are removed.
    """
    p, v, K = len(ordering.pose), len(ordering.tridiagonal), ordering.epochs
    tridiagonal = K * p + len(ordering.constant)
    epochs = min(max(removed, 1) + 1, K)
    parts: list[tuple[int, int]] = []
    for k in range(epochs):
        parts += [(k * p, (k + 1) * p)]
        parts += [(tridiagonal + k * v, tridiagonal + (k + 1) * v)] if k <= removed else []
    ends = (tridiagonal + (removed + 1) * v, tridiagonal + (removed + 1) * v + 1)
    return np.concatenate([np.arange(*part) for part in (*parts, (epochs * p, tridiagonal), ends)])


def columns_of(old: VariableOrdering, now: VariableOrdering) -> Int[np.ndarray, " q"]:
    """Indices of a shorter prior's columns among those of a longer one."""
    p, c, v = len(old.pose), len(old.constant), len(old.tridiagonal)
    return np.concatenate([np.arange(old.epochs * p), now.epochs * p + np.arange(c + v)])


NARROW, WIDE, WIDE_ENOUGH = 8, 32, 300
"""Columns per block of a QR decomposition, of matrices narrower than the last number and of others: what was fastest."""


def without_landmarks(
    window: Window,
    problem: Problem,
    linear: LinearProblem,
    landmarks: Bool[np.ndarray, " L"],
) -> Window:
    """Window with some landmarks, numbered as in its observations, marginalized into the prior.

    Parameters
    ----------
    linear : LinearProblem
        The linear problem in which they are eliminated, and the point it is about.
    """
    here, ordering = linear.point.trajectory, problem.ordering
    first = _first_estimates(window, ordering, here)
    rows = spread_poses(_of_landmarks(linear, landmarks, ordering), ordering, 0)
    new = _at_first_estimates(rows, ordering, first, here)
    root = _triangular(window.marginal_prior, new, ordering, 0)
    return replace(
        window.without(landmarks),
        marginal_prior=_marginal_prior(root, ordering, first, window.marginal_prior),
    )


def without_oldest(
    window: Window,
    problem: Problem,
    linear: LinearProblem,
    landmarks: Bool[np.ndarray, " L"],
    count: int = 1,
) -> Window:
    """The window without its oldest epochs and their landmarks.

    The removed landmarks must include all that those epochs observed.

    Parameters
    ----------
    linear : LinearProblem
        As for `without_landmarks`.
    count : int
        Of the epochs that leave; one stays at least.
    """
    ordering, here = problem.ordering, linear.point.trajectory
    first, more = _first_estimates(window, ordering, here), count * len(ordering.tridiagonal)
    # Everything that involves a removed epoch: its step, its prior and landmark-free rows, its landmarks' remainder.
    rows = [spread_step(linear.point.dynamics.rows[k], k, count, ordering) for k in range(count)]
    for k in range(count):
        rows += [spread_epoch(part, k, count, ordering) for part in _rows_of_epoch(problem.motion, k, here)]
    if landmarks.any():
        rows.append(spread_poses(_of_landmarks(linear, landmarks, ordering), ordering, more))
    new = _at_first_estimates(np.concatenate(rows), ordering, first, here, more)
    # Removed variables come first: the triangle after their rows and columns is the prior of those that stay.
    gone = count * len(ordering.moving)
    root = _triangular(window.marginal_prior, new, ordering, count)[gone:, gone:]
    after = replace(ordering, epochs=ordering.epochs - count)
    first = _handed_over(ordering, first[0], first[count:], here[count])
    return window.without(landmarks).shifted(
        count, _marginal_prior(root, after, first, window.marginal_prior)
    )


def _of_landmarks(
    linear: LinearProblem,
    landmarks: Bool[np.ndarray, " L"],
    ordering: VariableOrdering,
) -> Float[np.ndarray, "r w"]:
    here, normal = linear.point, linear.normal
    if normal.eliminated is None or here.linear is None:
        return np.zeros((0, ordering.epochs * len(ordering.pose) + 1))
    return landmark_rows(normal, here.linear, landmarks, ordering.epochs)


def landmark_rows(
    normal: NormalEquations, linear: LinearObservations, landmarks: Bool[np.ndarray, " L"], epochs: int
) -> Float[np.ndarray, "r w"]:
    """Information of landmarks' observations on the poses, landmarks unknown.

    It is a square root with the right-hand side: the root of the information which elimination leaves to the
    poses, scaled and with pivots, for it lacks the rank that the gauge and unseen poses would need. Its last
    row holds what no pose can explain.
    """
    fit = normal.eliminated
    assert fit is not None
    weight = np.where(landmarks[fit.observations.landmark] & fit.used, fit.weight, 0.0)
    size = epochs * POSE
    part = eliminate(fit.observations, linear, weight, size, epochs)
    # Root of the scaled information with pivots: P' A P = R' R of rank r, and y = R^-T P' b by forward substitution.
    scale = np.sqrt(np.maximum(np.diagonal(part.information), 0.0))
    scale[scale == 0] = 1.0
    lower, pivots, rank, _ = dpstrf((part.information[:-1] / scale / scale[:, None]).T)
    root = np.triu(lower)[:rank]
    order = pivots - 1
    y = (
        dtrtrs(root[:, :rank], (part.pose_gradient / scale)[order][:rank], trans=1)[0]
        if rank
        else np.zeros(0)
    )
    # Back to the poses' order and units; below it what is left of the squared innovations, |y_0|^2 - |L^-1 g|^2 - |y|^2.
    rows = np.zeros((rank + 1, size + 1))
    rows[:rank, order] = root
    rows[:, :-1] *= scale
    rows[:rank, -1] = y
    rest = (
        weight @ np.where(weight > 0, linear.square, 0.0)
        - (part.gradient[part.is_constrained] ** 2).sum()
        - y @ y
    )
    rows[rank, -1] = np.sqrt(max(rest, 0.0))
    return rows


def _first_estimates(
    window: Window, ordering: VariableOrdering, now: Float[np.ndarray, "k m"]
) -> Float[np.ndarray, "k m"]:
    """Linearisation points: first estimates where a prior exists, else the current ones."""
    if window.marginal_prior is None:
        return now.copy()
    first, layout = (
        np.concatenate([window.marginal_prior.first, now[len(window.marginal_prior.first) :]]),
        ordering.layout,
    )
    if not window.marginal_prior.knows_constants:
        posed = set(ordering.pose.tolist())
        for block in layout.blocks:
            if layout.slice(block).start not in posed:
                first[0, layout.mean_slice(block)] = now[0, layout.mean_slice(block)]
    return first


def _handed_over(
    ordering: VariableOrdering,
    oldest: Float[np.ndarray, " m"],
    rest: Float[np.ndarray, "j m"],
    now: Float[np.ndarray, " m"],
) -> Float[np.ndarray, "j m"]:
    """First estimates of the remaining epochs.

    The next epoch takes the constants of the oldest, and its own velocities as they are now.
    """
    layout, after = ordering.layout, rest.copy()
    assembled = set(ordering.tridiagonal.tolist())
    after[0, layout.constant_indices] = oldest[layout.constant_indices]
    for block in layout.moving:
        if layout.slice(block.name).start in assembled:
            after[0, layout.mean_slice(block.name)] = now[layout.mean_slice(block.name)]
    return after


def _at_first_estimates(
    rows: Float[np.ndarray, "r w"],
    ordering: VariableOrdering,
    first: Float[np.ndarray, "k m"],
    here: Float[np.ndarray, "k m"],
    more: int = 0,
) -> Float[np.ndarray, "r w"]:
    """Rows of the current points, moved to the first estimates.

    They stay blind to the same gauge moves of frame g there.

    Parameters
    ----------
    more : int
        Columns between those of a carried quadratic and the right-hand side, of errors whose first estimate is that of now.
    """
    library, call = kernels(), prior_structure(ordering, first)
    if library is not None and call is not None:
        result, here = np.ascontiguousarray(rows), np.ascontiguousarray(here)
        result = result.copy() if result is rows else result
        if library.rows_at_first(*call.addresses, address(here), *rows.shape, address(result)):
            raise MemoryError("no memory to move rows to the first estimates")
        return result
    errors = ordering.layout.local(first, here)
    # Errors about here by those about the first estimates: e = G (d - away), with the reset Jacobian G of each epoch.
    result = with_columns_reset(rows, column_resets(ordering, errors))
    p, last = len(ordering.pose), rows.shape[1] - 1 - more
    # Columns of the first pose take up the change of the gauge: (J G + D) N_then = J N_now, with D in those p columns alone.
    if p:
        now, then = gauge_columns(ordering, here), gauge_columns(ordering, first)
        change = rows[:, :last] @ now - result[:, :last] @ then
        result[:, :p] += np.linalg.solve(then[:p].T, change.T).T
    # The right-hand side refers to the first estimates: y + J (here [-] first).
    result[:, -1] += result[:, :last] @ column_errors(ordering, errors)
    return result


def _rows_of_epoch(
    motion: EpochFactors, k: int, trajectory: Float[np.ndarray, "k m"]
) -> list[Float[np.ndarray, "r w"]]:
    """Rows of epoch k's sensors, and of the prior for the first."""
    parts: list[np.ndarray] = []
    if motion.prior is not None and k == 0:
        parts.append(prior_rows(motion.ordering, trajectory[0], motion.prior))
    for sensor in motion.sensors:
        here = sensor.epoch == k
        if here.any():
            mine = replace(
                sensor,
                epoch=sensor.epoch[here],
                values=sensor.values[here],
                parameters=sensor.parameters[here],
            )
            rows = motion.sensor_rows(mine, trajectory).rows
            whole = np.zeros((rows.shape[0] * rows.shape[1], motion.process.layout.error_dim + 1))
            whole[:, motion.sensor_columns(mine)] = rows.reshape(-1, rows.shape[2])
            parts.append(whole)
    return parts


def _triangular(
    old: MarginalizationPrior | None, new: Float[np.ndarray, "r w"], ordering: VariableOrdering, removed: int
) -> Float[np.ndarray, "w w"]:
    """Upper triangle of old and new rows together.

    Columns in the order of elimination, right-hand side last.
    The old root is a triangle in that order already: only the new rows are turned into it.
    """
    order, width = elimination_order(ordering, removed), new.shape[1]
    root = np.zeros((width, width), order="F")
    if old is not None:
        # Columns of the old root in the place that they have in the new order of elimination.
        place = np.empty(width, dtype=int)
        place[order] = np.arange(width)
        to = place[columns_of(old.ordering, ordering)][elimination_order(old.ordering, 0)[:-1]]
        within = elimination_order(old.ordering, 0)[:-1]
        root[np.ix_(to, to)] = old.information_sqrt[:, within]
        root[to, -1] = old.right
    if not len(new):
        return root
    # QR of [root; rows], of which the root is a triangle already.
    rows = np.asfortranarray(new[:, order])
    block = NARROW if width < WIDE_ENOUGH else WIDE
    turned, *_ = dtpqrt(0, block, root, rows, overwrite_a=1, overwrite_b=1)
    return turned  # what is below its diagonal stays zero


def _marginal_prior(
    root: Float[np.ndarray, "w w"],
    ordering: VariableOrdering,
    first: Float[np.ndarray, "k m"],
    before: MarginalizationPrior | None,
) -> MarginalizationPrior:
    """Marginalization prior from a triangle in the order of elimination."""
    constant_cost = float(root[-1, -1] ** 2) + (0.0 if before is None else before.constant_cost)
    # Columns from the order of elimination back to the prior's own; the last row is the constant cost alone.
    columns = np.empty((len(root) - 1, len(root) - 1))
    columns[:, elimination_order(ordering, 0)[:-1]] = root[:-1, :-1]
    return MarginalizationPrior(ordering, first, columns, root[:-1, -1].copy(), constant_cost)
