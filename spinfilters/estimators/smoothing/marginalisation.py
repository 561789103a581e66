"""Landmarks and frames that leave: what they say of the rest goes, in square-root form, into what is carried.

A landmark leaves with all its sightings: a root of what they say of the poses is all that stays. The oldest frame leaves with its
measurements, its prior and the step that follows. Their rows are stacked under the carried root, the leaving errors' columns
first; a QR decomposition then leaves the new root below theirs, so that what is carried is never subtracted from and cannot
become indefinite.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg.lapack import dgeqrt, dpstrf, dtrtrs

from spinfilters.estimators.smoothing.carried import Carried, column_errors, gauge_columns
from spinfilters.estimators.smoothing.elimination import POSE, eliminate
from spinfilters.estimators.smoothing.motion import Motion, prior_rows
from spinfilters.estimators.smoothing.problem import Normal, Point, Problem
from spinfilters.estimators.smoothing.sightings import LinearSightings
from spinfilters.estimators.smoothing.unknowns import CONSTANT, Unknowns
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
    root = _triangular([_carried_rows(window, unknowns), new])
    return replace(window.without(landmarks), carried=_carried(root, unknowns, first, 0, window.carried))


def without_oldest(
    window: Window,
    problem: Problem,
    at: tuple[Point, Normal] | None = None,
    landmarks: Bool[np.ndarray, " L"] | None = None,
) -> Window:
    """The window without its oldest frame, and without some landmarks, among which are all that it saw.

    Parameters
    ----------
    at: as for `without_landmarks`; None when no landmarks leave, and everything is linearised where the window is.
    """
    unknowns = problem.unknowns
    point = problem.at(window.trajectory, window.points) if at is None else at[0]
    here, v = point.trajectory, len(unknowns.chain)
    first = _first_estimates(window, unknowns, here)
    rows = [_spread_step(point.dynamics.rows[0], unknowns)]
    rows += [_spread_frame(part, unknowns) for part in _alone(problem.motion, here)]
    if at is not None and landmarks is not None and landmarks.any():
        rows.append(_spread_poses(_of_landmarks(at, landmarks, unknowns), unknowns, v))
    new = _at_first_estimates(np.concatenate(rows), unknowns, first, here, v)
    old = _with_gap(_carried_rows(window, unknowns), v)
    if landmarks is not None:
        window = window.without(landmarks)
    root = _triangular([part[:, _leaving_first(unknowns)] for part in (old, new)])
    after, gone = replace(unknowns, frames=unknowns.frames - 1), len(unknowns.moving)
    first = _handed_over(unknowns, first, here[1])
    return window.shifted(_carried(root, after, first, gone, window.carried))


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


def _with_gap(rows: Float[np.ndarray, "r w"], width: int) -> Float[np.ndarray, "r x"]:
    """Room for the second frame's chain before the right-hand side."""
    return np.concatenate([rows[:, :-1], np.zeros((len(rows), width)), rows[:, -1:]], axis=1)


def _leaving_first(unknowns: Unknowns) -> np.ndarray:
    """Columns in the order: the oldest frame's pose and chain, then the rest as a carried quadratic has it."""
    p, v = len(unknowns.pose), len(unknowns.chain)
    chain = unknowns.frames * p + len(unknowns.constant)
    parts = [(0, p), (chain, chain + v), (p, chain), (chain + v, chain + 2 * v + 1)]
    return np.concatenate([np.arange(*part) for part in parts])


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
    unknowns: Unknowns, first: Float[np.ndarray, "k m"], now: Float[np.ndarray, " m"]
) -> Float[np.ndarray, "j m"]:
    """First estimates without the oldest frame: the next one has the constants' from it, and its own velocities as they are now."""
    layout, after = unknowns.layout, first[1:].copy()
    chained = set(unknowns.chain.tolist())
    for block in layout.blocks:
        at = layout.mean_slice(block)
        if block in CONSTANT:
            after[0, at] = first[0, at]
        elif layout.slice(block).start in chained:
            after[0, at] = now[at]
    return after


def _carried_rows(window: Window, unknowns: Unknowns) -> Float[np.ndarray, "q q1"]:
    """The carried root over all frames of the window."""
    p, c, v = len(unknowns.pose), len(unknowns.constant), len(unknowns.chain)
    size = unknowns.frames * p + c + v
    if window.carried is None:
        return np.zeros((0, size + 1))
    old = window.carried
    poses = len(old.first) * p
    rows = np.zeros((len(old.root), size + 1))
    rows[:, :poses] = old.root[:, :poses]
    rows[:, unknowns.frames * p : -1] = old.root[:, poses:]
    rows[:, -1] = old.right
    return rows


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


def _spread_step(rows: Float[np.ndarray, "d w"], unknowns: Unknowns) -> Float[np.ndarray, "d x"]:
    """Rows of the first step over poses, constants, the first chain and the second, right-hand side."""
    p, c, v, K = len(unknowns.pose), len(unknowns.constant), len(unknowns.chain), unknowns.frames
    d, chain = p + v, K * p + c
    out = np.zeros((len(rows), chain + 2 * v + 1))
    out[:, :p], out[:, p : 2 * p] = rows[:, :p], rows[:, d : d + p]
    out[:, chain : chain + v], out[:, chain + v : -1] = rows[:, p:d], rows[:, d + p : 2 * d]
    out[:, K * p : chain], out[:, -1] = rows[:, 2 * d : -1], rows[:, -1]
    return out


def _spread_frame(rows: Float[np.ndarray, "r w"], unknowns: Unknowns) -> Float[np.ndarray, "r x"]:
    """Rows of the first frame alone over the same columns."""
    p, c, v, K = len(unknowns.pose), len(unknowns.constant), len(unknowns.chain), unknowns.frames
    chain = K * p + c
    out = np.zeros((len(rows), chain + 2 * v + 1))
    out[:, :p], out[:, chain : chain + v] = rows[:, :p], rows[:, p : p + v]
    out[:, K * p : chain], out[:, -1] = rows[:, p + v : -1], rows[:, -1]
    return out


def _alone(motion: Motion, trajectory: Float[np.ndarray, "k m"]) -> list[Float[np.ndarray, "r w"]]:
    """Rows of the first frame's prior and sensors."""
    parts: list[np.ndarray] = []
    if motion.prior is not None:
        inside = prior_rows(motion.unknowns, trajectory[0], motion.prior)
        parts.append(inside)
    for sensor in motion.sensors:
        here = sensor.frame == 0
        if here.any():
            mine = replace(
                sensor,
                frame=sensor.frame[here],
                values=sensor.values[here],
                parameters=sensor.parameters[here],
            )
            rows = motion.sensor_rows(mine, trajectory)[0]
            parts.append(rows.reshape(-1, rows.shape[2]))
    return parts


def _triangular(parts: list[Float[np.ndarray, "r w"]]) -> Float[np.ndarray, "w w"]:
    """Upper triangle of a QR decomposition of stacked rows, square."""
    width, count = parts[0].shape[1], sum(len(part) for part in parts)
    rows, done = np.zeros((max(count, width), width), order="F"), 0
    for part in parts:
        rows[done : done + len(part)] = part
        done += len(part)
    return np.triu(dgeqrt(NARROW if width < WIDE_ENOUGH else WIDE, rows, overwrite_a=1)[0][:width])


def _carried(
    root: Float[np.ndarray, "w w"],
    unknowns: Unknowns,
    first: Float[np.ndarray, "k m"],
    gone: int,
    before: Carried | None,
) -> Carried:
    """What is below the rows of those that left."""
    lost = float(root[-1, -1] ** 2) + (0.0 if before is None else before.lost)
    return Carried(unknowns, first, root[gone:-1, gone:-1].copy(), root[gone:-1, -1].copy(), lost)
