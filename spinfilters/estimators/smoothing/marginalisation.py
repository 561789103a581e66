"""Landmarks and frames that leave: what they say of the rest goes, in square-root form, into what is carried.

A landmark leaves with all its sightings: a root of what they say of the poses is all that stays. The oldest frames leave with their
measurements, the prior and the steps that follow. Their rows are stacked under the carried root, the leaving errors' columns
first; a QR decomposition then leaves the new root below theirs, so that what is carried is never subtracted from and cannot
become indefinite.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg.lapack import dpstrf, dtpqrt, dtrtrs

from spinfilters.estimators.smoothing.carried import Carried, column_errors, gauge_columns
from spinfilters.estimators.smoothing.elimination import POSE, eliminate
from spinfilters.estimators.smoothing.motion import Motion, prior_rows
from spinfilters.estimators.smoothing.problem import Normal, Point, Problem
from spinfilters.estimators.smoothing.sightings import LinearSightings
from spinfilters.estimators.smoothing.unknowns import Unknowns
from spinfilters.estimators.smoothing.window import Window

NARROW, WIDE, WIDE_ENOUGH = 8, 32, 300
"""Columns per block of a QR decomposition, of matrices narrower than the last number and of others: what was fastest."""


def without_landmarks(
    window: Window, problem: Problem, at: tuple[Point, Normal], landmarks: Bool[np.ndarray, " L"]
) -> Window:
    """The window with some landmarks, numbered as in its sightings, turned into what is carried.

    Parameters
    ----------
    at: the linear problem in which they are eliminated, and the point it is about.
    """
    here, unknowns = at[0].trajectory, problem.unknowns
    first = _first_estimates(window, unknowns, here)
    rows = _spread_poses(_of_landmarks(at, landmarks, unknowns), unknowns, 0)
    new = _at_first_estimates(rows, unknowns, first, here)
    root = _triangular(window.carried, new, unknowns, 0)
    return replace(window.without(landmarks), carried=_carried(root, unknowns, first, window.carried))


def without_oldest(
    window: Window,
    problem: Problem,
    at: tuple[Point, Normal],
    landmarks: Bool[np.ndarray, " L"],
    count: int = 1,
) -> Window:
    """The window without its oldest frames, and without some landmarks, among which are all that those saw.

    Parameters
    ----------
    at: as for `without_landmarks`.   count: of the frames that leave; one stays at least.
    """
    unknowns, here = problem.unknowns, at[0].trajectory
    first, more = _first_estimates(window, unknowns, here), count * len(unknowns.chain)
    rows = [_spread_step(at[0].dynamics.rows[k], k, count, unknowns) for k in range(count)]
    for k in range(count):
        rows += [_spread_frame(part, k, count, unknowns) for part in _alone(problem.motion, k, here)]
    if landmarks.any():
        rows.append(_spread_poses(_of_landmarks(at, landmarks, unknowns), unknowns, more))
    new = _at_first_estimates(np.concatenate(rows), unknowns, first, here, more)
    gone = count * len(unknowns.moving)
    root = _triangular(window.carried, new, unknowns, count)[gone:, gone:]
    after = replace(unknowns, frames=unknowns.frames - count)
    first = _handed_over(unknowns, first[0], first[count:], here[count])
    return window.without(landmarks).shifted(count, _carried(root, after, first, window.carried))


def _of_landmarks(
    at: tuple[Point, Normal], landmarks: Bool[np.ndarray, " L"], unknowns: Unknowns
) -> Float[np.ndarray, "r w"]:
    here, normal = at
    if normal.eliminated is None or here.linear is None:
        return np.zeros((0, unknowns.frames * len(unknowns.pose) + 1))
    return landmark_rows(normal, here.linear, landmarks, unknowns.frames)


def _spread_poses(rows: Float[np.ndarray, "r w"], unknowns: Unknowns, more: int) -> Float[np.ndarray, "r x"]:
    """Rows over poses alone over a carried quadratic's columns and ``more``."""
    size = rows.shape[1] - 1 + len(unknowns.constant) + len(unknowns.chain) + more
    out = np.zeros((len(rows), size + 1))
    out[:, : rows.shape[1] - 1], out[:, -1] = rows[:, :-1], rows[:, -1]
    return out


def landmark_rows(
    normal: Normal, linear: LinearSightings, landmarks: Bool[np.ndarray, " L"], frames: int
) -> Float[np.ndarray, "r w"]:
    """What the sightings of some landmarks say of the poses when those are unknown: a root of it, with the right-hand side.

    The root is that of the information which elimination leaves to the poses, scaled and with pivots, for it lacks the rank that
    the gauge and unseen poses would need. Its last row holds what no pose can explain.
    """
    fit = normal.eliminated
    assert fit is not None
    weight = np.where(landmarks[fit.sightings.landmark] & fit.used, fit.weight, 0.0)
    size = frames * POSE
    part = eliminate(fit.sightings, linear, weight, size, frames)
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
    rows = np.zeros((rank + 1, size + 1))
    rows[:rank, order] = root
    rows[:, :-1] *= scale
    rows[:rank, -1] = y
    rest = weight @ np.where(weight > 0, linear.square, 0.0) - (part.gradient[part.told] ** 2).sum() - y @ y
    rows[rank, -1] = np.sqrt(max(rest, 0.0))
    return rows


def _first_estimates(
    window: Window, unknowns: Unknowns, now: Float[np.ndarray, "k m"]
) -> Float[np.ndarray, "k m"]:
    """Of what is carried already the points at which it was, of the rest those of now."""
    if window.carried is None:
        return now.copy()
    first, layout = np.concatenate([window.carried.first, now[len(window.carried.first) :]]), unknowns.layout
    if not window.carried.knows_constants:
        posed = set(unknowns.pose.tolist())
        for block in layout.blocks:
            if layout.slice(block).start not in posed:
                first[0, layout.mean_slice(block)] = now[0, layout.mean_slice(block)]
    return first


def _handed_over(
    unknowns: Unknowns,
    oldest: Float[np.ndarray, " m"],
    rest: Float[np.ndarray, "j m"],
    now: Float[np.ndarray, " m"],
) -> Float[np.ndarray, "j m"]:
    """First estimates of the rest: the next frame has the constants' of the oldest, and its own velocities as they are now."""
    layout, after = unknowns.layout, rest.copy()
    chained = set(unknowns.chain.tolist())
    after[0, layout.constant_indices] = oldest[layout.constant_indices]
    for block in layout.moving:
        if layout.slice(block.name).start in chained:
            after[0, layout.mean_slice(block.name)] = now[layout.mean_slice(block.name)]
    return after


def _at_first_estimates(
    rows: Float[np.ndarray, "r w"],
    unknowns: Unknowns,
    first: Float[np.ndarray, "k m"],
    here: Float[np.ndarray, "k m"],
    more: int = 0,
) -> Float[np.ndarray, "r w"]:
    """Rows made about the points of now, about the first estimates, and blind to the same moves of frame g there.

    Parameters
    ----------
    more: columns between those of a carried quadratic and the right-hand side, of errors whose first estimate is that of now.
    """
    result, p, last = rows.copy(), len(unknowns.pose), rows.shape[1] - 1 - more
    if p:
        now, then = gauge_columns(unknowns, here), gauge_columns(unknowns, first)
        change = rows[:, :last] @ (now - then)
        result[:, :p] += np.linalg.solve(then[:p].T, change.T).T
    away = column_errors(unknowns, unknowns.layout.local(first, here))
    result[:, -1] += result[:, :last] @ away
    return result


def _spread_step(
    rows: Float[np.ndarray, "d w"], k: int, count: int, unknowns: Unknowns
) -> Float[np.ndarray, "d x"]:
    """Rows of step k over poses, constants, the chains of ``count`` frames and of the next, right-hand side."""
    p, c, v, K = len(unknowns.pose), len(unknowns.constant), len(unknowns.chain), unknowns.frames
    d, chain = p + v, K * p + c
    out = np.zeros((len(rows), chain + (count + 1) * v + 1))
    for moving, frame in ((0, k), (d, k + 1)):
        out[:, frame * p : (frame + 1) * p] = rows[:, moving : moving + p]
        out[:, chain + frame * v : chain + (frame + 1) * v] = rows[:, moving + p : moving + d]
    out[:, K * p : chain], out[:, -1] = rows[:, 2 * d : -1], rows[:, -1]
    return out


def _spread_frame(
    rows: Float[np.ndarray, "r w"], k: int, count: int, unknowns: Unknowns
) -> Float[np.ndarray, "r x"]:
    """Rows of frame k alone over the same columns."""
    p, c, v, K = len(unknowns.pose), len(unknowns.constant), len(unknowns.chain), unknowns.frames
    chain = K * p + c
    out = np.zeros((len(rows), chain + (count + 1) * v + 1))
    out[:, k * p : (k + 1) * p], out[:, chain + k * v : chain + (k + 1) * v] = rows[:, :p], rows[:, p : p + v]
    out[:, K * p : chain], out[:, -1] = rows[:, p + v : -1], rows[:, -1]
    return out


def _alone(motion: Motion, k: int, trajectory: Float[np.ndarray, "k m"]) -> list[Float[np.ndarray, "r w"]]:
    """Rows of frame k's sensors, and of the prior for the first."""
    parts: list[np.ndarray] = []
    if motion.prior is not None and k == 0:
        parts.append(prior_rows(motion.unknowns, trajectory[0], motion.prior))
    for sensor in motion.sensors:
        here = sensor.frame == k
        if here.any():
            mine = replace(
                sensor,
                frame=sensor.frame[here],
                values=sensor.values[here],
                parameters=sensor.parameters[here],
            )
            rows = motion.sensor_rows(mine, trajectory)[0]
            whole = np.zeros((rows.shape[0] * rows.shape[1], motion.process.layout.error_dim + 1))
            whole[:, motion.sensor_columns(mine)] = rows.reshape(-1, rows.shape[2])
            parts.append(whole)
    return parts


def _triangular(
    old: Carried | None, new: Float[np.ndarray, "r w"], unknowns: Unknowns, leaving: int
) -> Float[np.ndarray, "w w"]:
    """Upper triangle of old and new rows together, columns in the order of elimination, right-hand side last.

    The old root is a triangle in that order already: only the new rows are turned into it.
    """
    order, width = _elimination_order(unknowns, leaving), new.shape[1]
    root = np.zeros((width, width), order="F")
    if old is not None:
        place = np.empty(width, dtype=int)
        place[order] = np.arange(width)
        to = place[_columns_of(old.unknowns, unknowns)][_elimination_order(old.unknowns, 0)[:-1]]
        within = _elimination_order(old.unknowns, 0)[:-1]
        root[np.ix_(to, to)] = old.root[:, within]
        root[to, -1] = old.right
    if not len(new):
        return root
    rows = np.asfortranarray(new[:, order])
    block = NARROW if width < WIDE_ENOUGH else WIDE
    turned, *_ = dtpqrt(0, block, root, rows, overwrite_a=1, overwrite_b=1)
    return turned  # what is below its diagonal stays zero


def _elimination_order(unknowns: Unknowns, leaving: int) -> Int[np.ndarray, " w"]:
    """Columns of a carried quadratic, of the chains after that of its first frame, and of the right-hand side, as frames leave."""
    p, v, K = len(unknowns.pose), len(unknowns.chain), unknowns.frames
    chain = K * p + len(unknowns.constant)
    frames = min(max(leaving, 1) + 1, K)
    parts: list[tuple[int, int]] = []
    for k in range(frames):
        parts += [(k * p, (k + 1) * p)]
        parts += [(chain + k * v, chain + (k + 1) * v)] if k <= leaving else []
    ends = (chain + (leaving + 1) * v, chain + (leaving + 1) * v + 1)
    return np.concatenate([np.arange(*part) for part in (*parts, (frames * p, chain), ends)])


def _columns_of(old: Unknowns, now: Unknowns) -> Int[np.ndarray, " q"]:
    """Where the columns of a quadratic over fewer frames are among those over more."""
    p, c, v = len(old.pose), len(old.constant), len(old.chain)
    return np.concatenate([np.arange(old.frames * p), now.frames * p + np.arange(c + v)])


def _carried(
    root: Float[np.ndarray, "w w"],
    unknowns: Unknowns,
    first: Float[np.ndarray, "k m"],
    before: Carried | None,
) -> Carried:
    """From a triangle in the order of elimination."""
    lost = float(root[-1, -1] ** 2) + (0.0 if before is None else before.lost)
    columns = np.empty((len(root) - 1, len(root) - 1))
    columns[:, _elimination_order(unknowns, 0)[:-1]] = root[:-1, :-1]
    return Carried(unknowns, first, columns, root[:-1, -1].copy(), lost)
