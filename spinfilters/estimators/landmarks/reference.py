"""The steps of an epoch in NumPy: what defines them, and serves where there is no compiler."""

import numpy as np
from jaxtyping import Float, Int

from spinfilters.estimators.gain import Correction, MeasurementPrediction, apply_gain, compressed, lower_roots
from spinfilters.estimators.landmarks.steps import Closing, NewModes, Steps, Stored, WhitenedRows

NEW_LANDMARK_SHARE = 0.5
"""Of the information of a new landmark's own covariance that its next observation has of it, about."""


class NumpySteps(Steps):
    """The reference."""

    def refresh(self, stored: Stored, rows: Int[np.ndarray, " q"]) -> None:
        rows = rows[stored.epoch[rows] != stored.now]
        slot = stored.epoch[rows] % len(stored.shift)
        A, L = stored.modes[rows].astype(float), stored.roots[rows].astype(float)
        stored.points[rows] += (A @ stored.shift[slot, :, None])[..., 0]
        value, vector = np.linalg.eigh(A @ stored.spread[slot] @ np.swapaxes(A, 1, 2))
        extra = vector * np.sqrt(np.maximum(value, 0.0))[:, None, :]  # below zero by rounding alone
        stored.modes[rows] = A @ stored.transform[slot]
        stored.roots[rows] = lower_roots(np.concatenate([L, extra], axis=2))
        stored.epoch[rows] = stored.now

    def compose(
        self,
        stored: Stored,
        transform: Float[np.ndarray, "r r"],
        dropped: Float[np.ndarray, "r c"],
        shift: Float[np.ndarray, " r"],
    ) -> None:
        moved = stored.transform @ dropped
        stored.shift += stored.transform @ shift
        stored.spread += moved @ np.swapaxes(moved, 1, 2)
        stored.transform[...] = stored.transform @ transform

    def whitened(
        self,
        stored: Stored,
        at: Int[np.ndarray, " k"],
        linear: Float[np.ndarray, "k d w"],
        weights: Float[np.ndarray, " k"],
    ) -> WhitenedRows:
        modes, roots = stored.modes[at].astype(float), stored.roots[at].astype(float)
        scaled = linear * np.sqrt(weights)[:, None, None]
        by_state, by_landmark, innovation = scaled[..., :-4], scaled[..., -4:-1], scaled[..., -1:]
        gram = by_landmark @ roots
        unit = np.broadcast_to(np.eye(gram.shape[1]), (len(gram), gram.shape[1], gram.shape[1]))
        root = lower_roots(np.concatenate([unit, gram], axis=2))
        every = np.concatenate([by_state, by_landmark @ modes, innovation, gram], axis=2)
        every = np.linalg.solve(root, every)
        log_noise = np.log(np.abs(np.diagonal(root, axis1=1, axis2=2))).sum(axis=1)
        return WhitenedRows(every[..., :-3], every[..., -3:], gram, log_noise)

    def corrected(
        self,
        rows: Float[np.ndarray, "k d w"],
        factor: Float[np.ndarray, "N N"],
        columns: Int[np.ndarray, " q"],
    ) -> Correction:
        tall = rows.reshape(-1, rows.shape[2])
        innovation, H, residual = compressed(tall[:, -1], tall[:, :-1])
        return apply_gain(
            MeasurementPrediction(innovation, H @ factor[columns], factor, residual, len(tall), 0.0)
        )

    def compress(
        self,
        white: WhitenedRows,
        new: Float[np.ndarray, "q 3 c"],
        factor: Float[np.ndarray, "p N"],
        remembered: Float[np.ndarray, " r"],
    ) -> NewModes:
        rows, X, r = white.rows[..., :-1], white.spread, len(remembered)
        size = rows.shape[2]
        c = size - r
        seen = -(X @ (np.swapaxes(X, 1, 2) @ rows))
        seen[..., c:] += rows[..., c:]
        tall, fresh = seen.reshape(-1, size), new.reshape(-1, c)
        G = tall.T @ tall
        G[:c, :c] += NEW_LANDMARK_SHARE * (fresh.T @ fresh)
        G[range(c, size), range(c, size)] += remembered
        turn, R = np.linalg.qr(factor.T)
        value, vector = np.linalg.eigh(R @ G @ R.T)
        vector = vector[:, ::-1]
        return NewModes(R.T @ vector, vector[:, :r].T @ turn.T, value[::-1][:r].copy())

    def observe(
        self,
        stored: Stored,
        at: Int[np.ndarray, " k"],
        white: WhitenedRows,
        error: Float[np.ndarray, " q"],
        new: NewModes,
    ) -> None:
        modes, roots = stored.modes[at].astype(float), stored.roots[at].astype(float)
        pull = roots @ (np.swapaxes(white.spread, 1, 2) @ white.rows)
        by_both = -pull[..., :-1]
        by_both[..., len(error) - modes.shape[2] :] += modes
        gram = np.swapaxes(white.gram, 1, 2)
        left = lower_roots(np.concatenate([np.broadcast_to(np.eye(3), roots.shape), gram], axis=2))
        own = np.swapaxes(np.linalg.solve(left, np.swapaxes(roots, 1, 2)), 1, 2)
        stored.points[at] += by_both @ error + pull[..., -1]
        stored.modes[at] = by_both @ new.kept
        stored.roots[at] = lower_roots(np.concatenate([own, by_both @ new.dropped], axis=2))
        stored.epoch[at] = stored.now

    def settled(
        self, by_pose: Float[np.ndarray, "q 3 c"], roots: Float[np.ndarray, "q 3 3"], new: NewModes
    ) -> tuple[Float[np.ndarray, "q 3 r"], Float[np.ndarray, "q 3 3"]]:
        c = by_pose.shape[2]
        own = lower_roots(np.concatenate([roots, by_pose @ new.dropped[:c]], axis=2))
        return by_pose @ new.kept[:c], own

    def close(
        self, stored: Stored, closing: Closing
    ) -> tuple[NewModes, Float[np.ndarray, "q 3 r"], Float[np.ndarray, "q 3 3"]]:
        c = closing.by_pose.shape[2]
        scaled = np.linalg.solve(closing.roots, closing.by_pose)
        new = self.compress(closing.white, scaled, closing.factor, closing.remembered)
        late = np.flatnonzero(stored.epoch[: stored.count] < stored.now - (len(stored.shift) - 2))
        self.refresh(stored, np.union1d(np.arange(*closing.behind), late))
        self.compose(stored, new.kept[c:], new.dropped[c:], closing.error[c:])
        next_epoch(stored)
        self.observe(stored, closing.at, closing.white, closing.error, new)
        return new, *self.settled(closing.by_pose, closing.roots, new)


def next_epoch(stored: Stored) -> None:
    """Count one epoch on; its slot begins with the identity."""
    stored.now += 1
    slot = stored.now % len(stored.shift)
    stored.transform[slot], stored.spread[slot], stored.shift[slot] = np.eye(stored.shift.shape[1]), 0.0, 0.0
