"""The textbook's EKF with every landmark in its state: one covariance matrix, one linearisation per update.

It is the baseline that the map of shared modes is compared with. State error and landmark errors stand in one vector; nothing is
approximated beyond the derivatives, so that the cost of an update grows with the square of the number of landmarks (Smith, Self,
Cheeseman 1990; Durrant-Whyte, Bailey 2006, Eqs 4 to 8). The covariance is a full matrix, P <- (I - K H) P, made symmetric after
every step. An observation beyond its own chi-square gate is left out.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.errors import InputError
from spinfilters.filters.estimator import (
    NO_IDS,
    Belief,
    Estimator,
    MapChange,
    Measurement,
    ProcessModel,
    Snapshot,
    UpdateReport,
)
from spinfilters.filters.measurement_prediction import linear_rows, usable
from spinfilters.filters.outlier_rejection import RobustOptions, gate
from spinfilters.filters.square_root import LOG_2_PI
from spinfilters.models.measurement import LandmarkSensor
from spinfilters.models.state_layout import Gaussian

LARGEST_JOINT_MAP = 200
"""Landmarks in the state: with more, those that were seen longest ago leave it by marginalisation."""


class _JointRows(NamedTuple):
    """Whitened observations of k values: innovations, Jacobians by all unknowns, and log determinants of the noise factors."""

    innovation: Float[np.ndarray, "k d"]
    jacobian: Float[np.ndarray, "k d N"]
    log_noise: Float[np.ndarray, " k"]

    def only(self, keep: Bool[np.ndarray, " k"]) -> "_JointRows":
        """The chosen values."""
        return _JointRows(*(part[keep] for part in self))


class JointEkf(Estimator):
    """EKF over the state and all landmarks, with the errors of the state's layout and additive ones of the points.

    Parameters
    ----------
    process : ProcessModel
        The process model.
    robust : RobustOptions or None
        Its ``gate_probability`` is that of the gate; the loss is not read.

    Attributes
    ----------
    ids : ndarray of int, shape (k,)
        Landmarks in the state.
    points : ndarray of float, shape (k, 3)
        Their positions, m, frame g.
    covariance : ndarray of float, shape (n + 3k, n + 3k)
        Of the errors of the state, then of the landmarks.
    """

    name = "ekf-joint"

    def __init__(self, process: ProcessModel, robust: RobustOptions | None = None) -> None:
        super().__init__(process)
        self._gate_probability = (robust or RobustOptions()).gate_probability
        n = self.layout.error_dim
        self.mean, self.covariance = self.layout.origin(), np.full((n, n), np.nan)
        self.ids, self.points, self._last, self._now = NO_IDS, np.zeros((0, 3)), NO_IDS, 0

    def start(self, belief: Belief) -> None:
        """Begin with a belief of the state, alone or with landmarks, of which the best known fit into the state."""
        if belief.layout != self.layout:
            raise InputError(
                f"belief has the blocks {belief.layout.blocks}, the process has {self.layout.blocks}"
            )
        self.mean = belief.state.mean.copy()
        joint = belief.joint
        if joint is None:
            self.ids, self.points = NO_IDS, np.zeros((0, 3))
            self.covariance = belief.state.covariance
        else:
            best = np.sort(np.argsort(np.linalg.norm(joint.roots, axis=(1, 2)))[:LARGEST_JOINT_MAP])
            parts = {name: getattr(joint, name)[best] for name in ("ids", "points", "modes", "roots")}
            joint = replace(joint, **parts)
            self.ids, self.points = joint.ids.copy(), joint.points_in_g.copy()
            factor = joint.joint_factor()
            self.covariance = factor @ factor.T
        self._last, self._now = np.zeros(len(self.ids), dtype=int), 0

    def rebase(self, belief: Belief) -> None:
        """Restart from a belief of the present time, landmarks included."""
        self.start(belief)

    @property
    def belief(self) -> Gaussian:
        """Belief of the state, landmarks marginalised.

        Raises
        ------
        numpy.linalg.LinAlgError
            Its covariance is not positive definite; it is not repaired.
        """
        n = self.layout.error_dim
        P = self.covariance[:n, :n]
        scale = np.sqrt(np.maximum(np.diag(P), 0.0))
        if not (np.isfinite(scale) & (scale > 0)).all():
            raise np.linalg.LinAlgError(f"covariance has the diagonal {np.diag(P).tolist()}")
        factor = scale[:, None] * np.linalg.cholesky(P / np.outer(scale, scale))
        return Gaussian(self.layout, self.mean.copy(), factor)

    def predict(self, dt: float) -> None:
        """P <- F P F' + Q in the rows and columns of the state; landmarks do not move in frame g."""
        n, P = self.layout.error_dim, self.covariance.copy()
        self.mean, F, G = self.process.linearise(self.mean, dt)
        # [P_xx P_xm] <- F [P_xx P_xm], then the columns by F': landmarks m keep P_mm, and Q joins P_xx.
        P[:n] = F @ P[:n]
        P[:, :n] = P[:, :n] @ F.T
        P[:n, :n] += G @ G.T
        self.covariance = _symmetric(P)

    def update(self, measurement: Measurement) -> UpdateReport:
        """Update by one sensor's values; landmarks that the state does not hold are added by their first observation."""
        count = len(measurement.values)
        if measurement.ids is None:
            report = self._correct(self._rows_of_state(measurement))
            return UpdateReport(
                report.nis, report.dof, report.accepted, count - report.accepted, report.log_likelihood
            )
        sensor = measurement.model.landmark_sensor
        assert sensor is not None
        row = {int(key): place for place, key in enumerate(self.ids)}
        at = np.array([row.get(int(key), -1) for key in measurement.ids], dtype=int)
        known = at >= 0
        report = self._correct(self._rows_of_landmarks(sensor, measurement, at, known))
        self._now += 1
        self._last[at[known]] = self._now
        added = self._add(sensor, measurement, ~known)
        removed = self._remove_stalest()
        used = report.accepted + len(added)
        change = MapChange(measurement.ids[known], np.ones(int(known.sum())), added, removed)
        return UpdateReport(report.nis, report.dof, used, count - used, report.log_likelihood, change)

    def snapshot(self) -> Snapshot:
        """Copies of mean, landmarks and covariance."""
        return {
            "mean": self.mean.copy(),
            "covariance": self.covariance.copy(),
            "ids": self.ids.copy(),
            "points": self.points.copy(),
            "last": self._last.copy(),
            "now": np.array(self._now),
        }

    def restore(self, snapshot: Snapshot) -> None:
        """Take mean, landmarks and covariance from a `snapshot`."""
        self.mean, self.covariance = snapshot["mean"].copy(), snapshot["covariance"].copy()
        self.ids, self.points = snapshot["ids"].copy(), snapshot["points"].copy()
        self._last, self._now = snapshot["last"].copy(), int(snapshot["now"])

    def _rows_of_state(self, m: Measurement) -> _JointRows:
        rows = linear_rows(m, self.mean)
        H = np.zeros((*rows.innovation.shape, len(self.covariance)))
        H[..., rows.columns] = rows.jacobian
        return _JointRows(rows.innovation, H, rows.log_noise)

    def _rows_of_landmarks(
        self, sensor: LandmarkSensor, m: Measurement, at: Int[np.ndarray, " k"], known: Bool[np.ndarray, " k"]
    ) -> _JointRows:
        at, n = at[known], self.layout.error_dim
        parameters = m.parameters[known].copy()
        parameters[:, :3] = self.points[at]
        found = sensor.linearise_landmarks(self.mean, parameters, m.values[known])
        H = np.zeros((*found.innovation.shape, len(self.covariance)))
        H[..., sensor.columns] = found.jacobian
        # Block row i of H: the state's columns are filled above, the three of landmark `place` follow after the state.
        for i, place in enumerate(at):  # by the landmark's own three columns
            H[i, :, n + 3 * place : n + 3 * place + 3] = found.by_landmark[i]
        rows = _JointRows(found.innovation, H, found.log_noise)
        return rows.only(usable(found.innovation, found.valid))

    def _correct(self, rows: _JointRows) -> UpdateReport:
        """K = P H' S^-1,  x <- x [+] K y,  P <- (I - K H) P,  then the reset of the state's error."""
        rows = rows.only(self._within_gate(rows))
        used, d = rows.innovation.shape
        if not used:
            return UpdateReport(0.0, 0, 0, 0)
        n, P = self.layout.error_dim, self.covariance
        y, H = rows.innovation.reshape(-1), rows.jacobian.reshape(used * d, -1)
        # H P, S and K' = S^-1 H P of all observations at once: rows are whitened, so the noise in S is I.
        HP = H @ P
        S = HP @ H.T + np.eye(len(y))
        root = np.linalg.cholesky(S)
        K = np.linalg.solve(S, HP).T
        error, nis = K @ y, float(np.square(np.linalg.solve(root, y)).sum())
        P = P - K @ HP
        J = self.layout.reset_jacobian(error[:n])
        # The reset moves the state's error alone: rows, then columns, of P_xx and P_xm.
        P[:n] = J @ P[:n]
        P[:, :n] = P[:, :n] @ J.T
        self.mean, self.covariance = self.layout.retract(self.mean, error[:n]), _symmetric(P)
        self.points = self.points + error[n:].reshape(-1, 3)
        log_root = float(np.log(np.diag(root)).sum()) + float(rows.log_noise.sum())
        return UpdateReport(nis, len(y), used, 0, -0.5 * (nis + len(y) * LOG_2_PI) - log_root)

    def _within_gate(self, rows: _JointRows) -> Bool[np.ndarray, " k"]:
        """Whether each observation by itself is within its gate."""
        count, d = rows.innovation.shape
        if not count or self._gate_probability >= 1:
            return np.ones(count, dtype=bool)
        S = rows.jacobian @ self.covariance @ np.swapaxes(rows.jacobian, 1, 2) + np.eye(d)
        square = np.einsum(
            "kd,kd->k", rows.innovation, np.linalg.solve(S, rows.innovation[..., None])[..., 0]
        )
        return square <= gate(self._gate_probability, d)

    def _add(
        self, sensor: LandmarkSensor, m: Measurement, new: Bool[np.ndarray, " k"]
    ) -> Int[np.ndarray, " a"]:
        """Add the landmarks of observations that determine a point each: l = g(x, z), with the derivatives of g."""
        assert m.ids is not None
        if not new.any():
            return NO_IDS
        made = sensor.new_landmarks(self.mean, m.parameters[new], m.values[new])
        good = made.determined & np.isfinite(made.points).all(axis=1)
        count, ids = int(good.sum()), m.ids[new][good]
        if not count:
            return NO_IDS
        # P <- [P, P G'; G P, G P G' + N N'], G by the state's columns, N by the sensor's noise of each landmark alone.
        G = np.zeros((3 * count, len(self.covariance)))
        G[:, sensor.columns] = made.jacobian[good].reshape(3 * count, -1)
        noise = np.zeros((count, 3, count, 3))
        root = made.root[good]
        noise[np.arange(count), :, np.arange(count)] = root @ np.swapaxes(root, 1, 2)
        GP = G @ self.covariance
        corner = GP @ G.T + noise.reshape(3 * count, 3 * count)
        self.covariance = _symmetric(np.block([[self.covariance, GP.T], [GP, corner]]))
        self.ids, self.points = np.append(self.ids, ids), np.concatenate([self.points, made.points[good]])
        self._last = np.append(self._last, np.full(count, self._now))
        return ids

    def _remove_stalest(self) -> Int[np.ndarray, " r"]:
        """Remove the landmarks that were seen longest ago where there are too many: their rows and columns go."""
        excess, n = len(self.ids) - LARGEST_JOINT_MAP, self.layout.error_dim
        if excess <= 0:
            return NO_IDS
        stays = np.ones(len(self.ids), dtype=bool)
        stays[np.argsort(self._last, kind="stable")[:excess]] = False
        removed = self.ids[~stays]
        kept = np.concatenate([np.ones(n, dtype=bool), np.repeat(stays, 3)])
        self.covariance = self.covariance[np.ix_(kept, kept)]
        self.ids, self.points, self._last = self.ids[stays], self.points[stays], self._last[stays]
        return removed


def _symmetric(P: Float[np.ndarray, "N N"]) -> Float[np.ndarray, "N N"]:
    return (P + P.T) / 2
