"""Columns of the marginalization: rows of one epoch or step among those of a window.

The order is poses of all epochs, constants, then velocities of the epochs that are removed and of the next, and the right-hand
side. Elimination takes the removed epochs first, so that the triangle below theirs is the new prior.
"""

import numpy as np
from jaxtyping import Float, Int

from spinfilters.estimators.smoothing.factors.variable_ordering import VariableOrdering


def spread_poses(
    rows: Float[np.ndarray, "r w"], ordering: VariableOrdering, more: int
) -> Float[np.ndarray, "r x"]:
    """Pose rows spread over the prior's columns and ``more``."""
    size = rows.shape[1] - 1 + len(ordering.constant) + len(ordering.tridiagonal) + more
    out = np.zeros((len(rows), size + 1))
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
