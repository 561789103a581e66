"""The embedded filter in NumPy with plain covariances.

It defines the filter, and its test vectors come from it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from spinfilters.estimators.landmarks.landmark_map import CONFIRMED, WRONG_IN_A_ROW
from spinfilters.estimators.robust.gate_weights import RobustOptions, gate
from spinfilters.models.landmark_sensor import LandmarkSensor
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.process import TorqueFreeProcess


@dataclass
class OwnLandmark:
    """A landmark with a covariance of its own: point (3,) m, covariance (3, 3) m^2."""

    point: Float[np.ndarray, " 3"]
    covariance: Float[np.ndarray, "3 3"]
    hits: int = CONFIRMED
    wrong: int = 0


class ReferenceFilter:
    """State and covariance, and landmarks with independent errors.

    An observation of a landmark tells the pose with the landmark's covariance in its noise. The landmark is then moved from that
    pose, whose covariance goes into its own.

    Attributes
    ----------
    mean: (m,) point.   covariance: (n, n).   landmarks: by place in the map.
    """

    def __init__(
        self, process: TorqueFreeProcess, mean: Float[np.ndarray, " m"], covariance: Float[np.ndarray, "n n"]
    ) -> None:
        self.process, self.layout = process, process.layout
        self.mean, self.covariance = mean.copy(), covariance.copy()
        self.landmarks: dict[int, OwnLandmark] = {}

    def predict(self, dt: float) -> None:
        """Predict dt seconds ahead."""
        self.mean, transition, noise = self.process.linearise(self.mean, dt)
        self.covariance = transition @ self.covariance @ transition.T + noise @ noise.T

    def update(
        self, model: MeasurementModel, value: Float[np.ndarray, " v"], parameters: Float[np.ndarray, " p"]
    ) -> bool:
        """Update with one value of a sensor without landmarks; False outside the gate."""
        found = model.linearise(self.mean, parameters[None], value[None])
        H = np.zeros((model.dim, self.layout.error_dim))
        H[:, model.columns] = found.jacobian[0]
        if _distance(H, found.innovation[0], self.covariance) > _limit(model.dim):
            return False
        self._correct(H, found.innovation[0])
        return True

    def observe(
        self,
        model: LandmarkSensor,
        values: Float[np.ndarray, "k 3"],
        camera: Float[np.ndarray, " c"],
        places: Int[np.ndarray, " k"],
    ) -> None:
        """Update with all observations of an epoch."""
        rows, pose = [], self.covariance[np.ix_(model.columns, model.columns)]
        used: dict[int, bool | None] = {}
        for value, place in zip(values, places.tolist(), strict=True):
            landmark = self.landmarks.get(place)
            if landmark is None:
                continue
            rho, H, by_landmark, valid = self._linearised(model, landmark.point, value, camera)
            L = np.linalg.cholesky(by_landmark @ landmark.covariance @ by_landmark.T + np.eye(3))
            rho, H = np.linalg.solve(L, rho), np.linalg.solve(L, H)
            good = _distance(H, rho, pose) <= _limit(3)
            used[place] = good if valid else None
            if valid and good:
                rows.append((rho, H))
        if rows:
            H = np.zeros((3 * len(rows), self.layout.error_dim))
            H[:, model.columns] = np.concatenate([row for _, row in rows])
            self._correct(H, np.concatenate([rho for rho, _ in rows]))
        for value, place in zip(values, places.tolist(), strict=True):
            self._keep_house(model, value, camera, place, used.get(place))

    def _keep_house(
        self,
        model: LandmarkSensor,
        value: Float[np.ndarray, " 3"],
        camera: Float[np.ndarray, " c"],
        place: int,
        used: bool | None,
    ) -> None:
        landmark, pose = self.landmarks.get(place), self.covariance[np.ix_(model.columns, model.columns)]
        if landmark is not None:
            if used is None:
                return
            if used:
                self._move(model, landmark, value, camera)
                return
            landmark.wrong += 1
            if landmark.hits >= CONFIRMED and landmark.wrong < WRONG_IN_A_ROW:
                return
            del self.landmarks[place]
        made = model.new_landmarks(self.mean, np.concatenate([np.zeros(3), camera])[None], value[None])
        if made.determined[0]:
            by_pose, root = made.jacobian[0], made.root[0]
            covariance = by_pose @ pose @ by_pose.T + root @ root.T
            self.landmarks[place] = OwnLandmark(made.points[0], covariance, 1)

    def _move(
        self,
        model: LandmarkSensor,
        landmark: OwnLandmark,
        value: Float[np.ndarray, " 3"],
        camera: Float[np.ndarray, " c"],
    ) -> None:
        """Correction of the landmark by an observation, given the pose after the epoch."""
        pose = self.covariance[np.ix_(model.columns, model.columns)]
        rho, H, by_landmark, _ = self._linearised(model, landmark.point, value, camera)
        spread = landmark.covariance @ by_landmark.T
        gain = np.linalg.solve(by_landmark @ spread + np.eye(3), spread.T).T
        pulled = gain @ H
        landmark.point = landmark.point + gain @ rho
        landmark.covariance = landmark.covariance - gain @ spread.T + pulled @ pose @ pulled.T
        landmark.hits, landmark.wrong = landmark.hits + 1, 0

    def _linearised(
        self,
        model: LandmarkSensor,
        point: Float[np.ndarray, " 3"],
        value: Float[np.ndarray, " 3"],
        camera: Float[np.ndarray, " c"],
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
        parameters = np.concatenate([point, camera])[None]
        found = model.linearise_landmarks(self.mean, parameters, value[None])
        return found.innovation[0], found.jacobian[0], found.by_landmark[0], bool(found.valid[0])

    def _correct(self, H: Float[np.ndarray, "k n"], rho: Float[np.ndarray, " k"]) -> None:
        information = np.linalg.inv(self.covariance) + H.T @ H
        P = np.linalg.inv((information + information.T) / 2)
        error = P @ (H.T @ rho)
        J = self.layout.reset_jacobian(error)
        self.mean = self.layout.retract(self.mean, error)
        self.covariance = J @ ((P + P.T) / 2) @ J.T


def _distance(
    H: Float[np.ndarray, "d n"], rho: Float[np.ndarray, " d"], P: Float[np.ndarray, "n n"]
) -> float:
    return float(rho @ np.linalg.solve(H @ P @ H.T + np.eye(len(rho)), rho))


def _limit(dof: int) -> float:
    return gate(RobustOptions().gate_probability, dof)
