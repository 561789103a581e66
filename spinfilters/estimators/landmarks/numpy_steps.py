"""Steps of an epoch in NumPy, the reference without a compiler."""

import numpy as np
from jaxtyping import Float, Int

from spinfilters.estimators.filters.sigma_points import SigmaPoints
from spinfilters.estimators.filters.square_root_update import (
    Correction,
    MeasurementPrediction,
    compressed,
    lower_roots,
    square_root_update,
)
from spinfilters.estimators.landmarks.steps import (
    AddedLandmarks,
    Closing,
    LandmarkArrays,
    LinearisedObservations,
    MapObservations,
    NewModes,
    PoseSpread,
    WhitenedLandmarks,
)

NEW_LANDMARK_SHARE = 0.5
"""Of the information of a new landmark's own covariance that its next observation has of it, about."""


class NumpySteps:
    """Landmark steps in NumPy; `compiled_steps.CompiledSteps` takes the same in C."""

    def refresh(self, stored: LandmarkArrays, rows: Int[np.ndarray, " q"]) -> None:
        """Bring landmarks in these rows up to the present epoch's modes."""
        rows = rows[stored.epoch[rows] != stored.now]
        slot = stored.epoch[rows] % len(stored.shift)
        A, L = stored.modes[rows].astype(float), stored.roots[rows].astype(float)
        stored.points[rows] += (A @ stored.shift[slot, :, None])[..., 0]
        value, vector = np.linalg.eigh(A @ stored.spread[slot] @ np.swapaxes(A, 1, 2))
        extra = vector * np.sqrt(np.maximum(value, 0.0))[:, None, :]  # below zero by rounding alone
        stored.modes[rows] = A @ stored.transform[slot]
        stored.roots[rows] = lower_roots(np.concatenate([L, extra], axis=2))
        stored.epoch[rows] = stored.now

    def whitened(
        self,
        stored: LandmarkArrays,
        at: Int[np.ndarray, " k"],
        linear: Float[np.ndarray, "k d w"],
        weights: Float[np.ndarray, " k"],
    ) -> WhitenedLandmarks:
        """Whitened rows of observations, with X and H_p L kept.

        The landmarks are in rows ``at``; their own errors are noise to the rows.

        Parameters
        ----------
        linear: whitened by the sensor's noise: by c columns of the state, by the landmark (3), the innovation.
        weights: positive; noise has 1 / weight times the covariance.
        """
        modes, roots = stored.modes[at].astype(float), stored.roots[at].astype(float)
        scaled = linear * np.sqrt(weights)[:, None, None]
        by_state, by_landmark, innovation = scaled[..., :-4], scaled[..., -4:-1], scaled[..., -1:]
        gram = by_landmark @ roots
        unit = np.broadcast_to(np.eye(gram.shape[1]), (len(gram), gram.shape[1], gram.shape[1]))
        root = lower_roots(np.concatenate([unit, gram], axis=2))
        every = np.concatenate([by_state, by_landmark @ modes, innovation, gram], axis=2)
        every = np.linalg.solve(root, every)
        log_noise = np.log(np.abs(np.diagonal(root, axis1=1, axis2=2))).sum(axis=1)
        log_noise = float((log_noise - 0.5 * linear.shape[1] * np.log(weights)).sum())
        rows, X = every[..., :-3], every[..., -3:]
        parts = [array.reshape(len(at), array.shape[1] * array.shape[2], 1) for array in (rows, X, gram)]
        kept = np.concatenate(parts, axis=1)
        return WhitenedLandmarks(kept, rows.shape, log_noise)

    def corrected(
        self,
        white: WhitenedLandmarks,
        factor: Float[np.ndarray, "N N"],
        columns: Int[np.ndarray, " q"],
        log_noise: float,
    ) -> Correction:
        """Correction by whitened observations of errors with this factor.

        Parameters
        ----------
        columns: (c + r,) of the errors, which are observed.   log_noise: of the sensor's noise, before whitening.
        """
        tall = white.rows.reshape(-1, white.shape[2])
        innovation, H, residual = compressed(tall[:, -1], tall[:, :-1])
        Y, log_noise = H @ factor[columns], log_noise + white.log_noise
        return square_root_update(
            MeasurementPrediction(innovation, Y, factor, residual, len(tall), log_noise)
        )

    def solved(
        self,
        observations: MapObservations,
        x: Float[np.ndarray, " m"],
        factor: Float[np.ndarray, "N N"],
        limit: float,
    ) -> tuple[Correction, WhitenedLandmarks] | None:
        """`whitened` and `corrected` at once, if no squared innovation exceeds the limit. Here always None."""
        return None

    def solved_rows(
        self,
        observations: MapObservations,
        linear: Float[np.ndarray, "k d w"],
        log_noise: float,
        factor: Float[np.ndarray, "N N"],
        limit: float,
    ) -> tuple[Correction, WhitenedLandmarks] | None:
        """The same of rows, all of them valid; log_noise of all."""
        return None

    def regressed(
        self, observations: MapObservations, spread: PoseSpread, points: SigmaPoints
    ) -> LinearisedObservations | None:
        """Compiled form of `Spread.regressed`; here always None."""
        return None

    def close(self, stored: LandmarkArrays, closing: Closing) -> AddedLandmarks:
        """Finish an epoch after the correction.

        The map moves to the next epoch; returned is what new landmarks begin with.
        """
        c = closing.by_pose.shape[2]
        new = _new_modes(closing)
        late = np.flatnonzero(stored.epoch[: stored.count] < stored.now - (len(stored.shift) - 2))
        self.refresh(stored, np.union1d(np.arange(*closing.behind), late))
        next_epoch(stored, new.kept[c:], new.dropped[c:], closing.error[c:])
        _observe(stored, closing, new)
        own = lower_roots(np.concatenate([closing.roots, closing.by_pose @ new.dropped[:c]], axis=2))
        return AddedLandmarks(new, closing.by_pose @ new.kept[:c], own)


def next_epoch(
    stored: LandmarkArrays,
    transform: Float[np.ndarray, "r r"],
    dropped: Float[np.ndarray, "r c"],
    shift: Float[np.ndarray, " r"],
) -> None:
    """Advance every slot's transformation one step.

    m_before = shift + transform m + dropped f; the new epoch's is the identity.
    """
    moved = stored.transform @ dropped
    stored.shift += stored.transform @ shift
    stored.spread += moved @ np.swapaxes(moved, 1, 2)
    stored.transform[...] = stored.transform @ transform
    stored.now += 1
    slot = stored.now % len(stored.shift)
    stored.transform[slot], stored.spread[slot], stored.shift[slot] = np.eye(len(shift)), 0.0, 0.0


def _new_modes(closing: Closing) -> NewModes:
    """Modes that explain most of the landmarks' dependence on pose and modes.

    The transformation of the old modes to them comes with them.
    """
    rows, X, r = closing.white.rows[..., :-1], _own_parts(closing.white)[0], len(closing.remembered)
    size = rows.shape[2]
    c = size - r
    seen = -(X @ (np.swapaxes(X, 1, 2) @ rows))
    seen[..., c:] += rows[..., c:]
    tall, fresh = seen.reshape(-1, size), np.linalg.solve(closing.roots, closing.by_pose).reshape(-1, c)
    G = tall.T @ tall
    G[:c, :c] += NEW_LANDMARK_SHARE * (fresh.T @ fresh)
    G[range(c, size), range(c, size)] += closing.remembered
    turn, R = np.linalg.qr(closing.factor.T)
    value, vector = np.linalg.eigh(R @ G @ R.T)
    vector = vector[:, ::-1]
    return NewModes(R.T @ vector, vector[:, :r].T @ turn.T, value[::-1][:r].copy())


def _observe(stored: LandmarkArrays, closing: Closing, new: NewModes) -> None:
    """Move observed landmarks, and tell them by the new modes."""
    at, (X, gram) = closing.at, _own_parts(closing.white)
    modes, roots = stored.modes[at].astype(float), stored.roots[at].astype(float)
    pull = roots @ (np.swapaxes(X, 1, 2) @ closing.white.rows)
    by_both = -pull[..., :-1]
    by_both[..., len(closing.error) - modes.shape[2] :] += modes
    left = lower_roots(
        np.concatenate([np.broadcast_to(np.eye(3), roots.shape), np.swapaxes(gram, 1, 2)], axis=2)
    )
    own = np.swapaxes(np.linalg.solve(left, np.swapaxes(roots, 1, 2)), 1, 2)
    stored.points[at] += by_both @ closing.error + pull[..., -1]
    stored.modes[at] = by_both @ new.kept
    stored.roots[at] = lower_roots(np.concatenate([own, by_both @ new.dropped], axis=2))
    stored.epoch[at] = stored.now
    stored.last[at], stored.wrong[at] = stored.now - 1, 0
    stored.hits[at] += 1


def _own_parts(white: WhitenedLandmarks) -> tuple[Float[np.ndarray, "k d 3"], Float[np.ndarray, "k d 3"]]:
    """X and H_p L."""
    count, d, width = white.shape
    parts = white.kept[:, d * width :].reshape(count, 2, d, 3)
    return parts[:, 0], parts[:, 1]
