"""An estimated motion between its epochs: torque-free from the epoch before and from the one after, blended."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import (
    inverse,
    multiply,
    quaternion_from_rotation_vector,
    rotate,
    rotation_between,
)
from spinfilters.core.camera_trajectory import CameraTrajectory
from spinfilters.core.errors import InputError
from spinfilters.core.linear_algebra import at_times
from spinfilters.core.mass_distribution import inertia_matrix
from spinfilters.evaluation.estimated_motion import trajectory_of
from spinfilters.filters.history import EstimateHistory
from spinfilters.models.state_blocks import CENTRE_OF_MASS

STEP_ANGLE: Final = 0.03
"""Largest rotation between two samples of a motion, rad: between them it turns about a fixed axis."""
MOST_SAMPLES: Final = 400_000


@dataclass(frozen=True)
class MotionSample:
    """Motion at k times.

    Attributes
    ----------
    position, velocity : (k, 3) float array
        Of the centre of mass in i, m and m/s; zero where only rotation is seen.
    q_ig : (k, 4) float array
        Attitude.
    rate : (k, 3) float array
        Rate about the axes of g, rad/s.
    acceleration : (k, 3) float array
        Its derivative, rad/s^2.
    centre : (k, 3) float array
        Centre of mass in g, m.
    std_position, std_attitude : (k,) float array
        Root mean squares over the axes of the standard deviations, m and rad.
    """

    position: Float[np.ndarray, "k 3"]
    velocity: Float[np.ndarray, "k 3"]
    q_ig: Float[np.ndarray, "k 4"]
    rate: Float[np.ndarray, "k 3"]
    acceleration: Float[np.ndarray, "k 3"]
    centre: Float[np.ndarray, "k 3"]
    std_position: Float[np.ndarray, " k"]
    std_attitude: Float[np.ndarray, " k"]


class ContinuousMotion:
    """Motion of an estimator's own finite epochs at any time between the first and the last of them.

    Every interval is propagated from both its ends without torques, with the inertia of the last epoch, and blended in proportion
    to the distance from the ends; at an epoch it is the estimate itself.

    Raises
    ------
    InputError
        Fewer than two epochs of the estimator's own are finite.
    """

    def __init__(self, history: EstimateHistory) -> None:
        trajectory, layout = trajectory_of(history), history.layout
        own = np.zeros(len(history.time), dtype=bool)
        own[history.own] = True
        rows = np.flatnonzero(own & trajectory.is_finite)
        if len(rows) < 2:
            raise InputError(
                f"{history.name}: fewer than two epochs are finite; there is no motion to compare"
            )
        motion = trajectory.at(rows)
        mean = history.mean[rows]
        self.name = history.name
        self.sees_position = trajectory.sees_position
        self.epochs = motion.time
        self.inertia = inertia_matrix(mean[-1, layout.mean_slice("s")])
        held = CENTRE_OF_MASS in layout.constant
        self._centre = mean[:, layout.mean_slice("c")] if held else np.zeros((len(rows), 3))
        self._std = [np.sqrt(np.mean(std**2, axis=1)) for std in (motion.std_position, motion.std_attitude)]
        self._velocity = motion.velocity
        self.velocity_std, self.rate_std = (
            float(np.median(np.sqrt(np.mean(std**2, axis=1))))
            for std in (motion.std_velocity, motion.std_rate)
        )
        rate = rotate(inverse(motion.q_ig), motion.rate_i)
        self._sample(motion.time, motion.q_ig, rate, motion.position)

    @property
    def span(self) -> tuple[float, float]:
        """First and last time, s."""
        return float(self.epochs[0]), float(self.epochs[-1])

    @property
    def final_centre(self) -> Float[np.ndarray, " 3"]:
        """Centre of mass in g after the last epoch, m."""
        return self._centre[-1]

    @property
    def typical_rate(self) -> float:
        """Median of the rate, rad/s."""
        return float(np.median(np.linalg.norm(self._rates, axis=1)))

    def at(self, time: Float[np.ndarray, " k"]) -> MotionSample:
        """The motion at times within `span`, s; shortly before and after it the rate and the velocity stay as they are."""
        beyond = (time - np.clip(time, *self.span))[:, None]
        time = np.clip(time, *self.span)
        poses = self._poses.at(time)
        rate = at_times(time, self._time, self._rates)
        torque = np.cross(rate @ self.inertia, rate)
        velocity = at_times(time, self.epochs, self._velocity)
        return MotionSample(
            position=poses[:, :3] + beyond * velocity,
            velocity=velocity,
            q_ig=multiply(poses[:, 3:], quaternion_from_rotation_vector(beyond * rate)),
            rate=rate,
            acceleration=np.linalg.solve(self.inertia, torque.T).T,
            centre=at_times(time, self.epochs, self._centre),
            std_position=np.interp(time, self.epochs, self._std[0]),
            std_attitude=np.interp(time, self.epochs, self._std[1]),
        )

    def _sample(self, time: np.ndarray, q: np.ndarray, rate: np.ndarray, position: np.ndarray) -> None:
        """Samples between epochs, close enough for slerp."""
        dt = np.diff(time)
        fastest = float(np.max(np.linalg.norm(rate, axis=1)))
        steps = int(np.clip(np.ceil(fastest * dt.max() / STEP_ANGLE), 1, max(MOST_SAMPLES // len(time), 1)))
        ahead = _propagate_motions(self.inertia, q[:-1], rate[:-1], dt / steps, steps)
        behind = [
            part[::-1] for part in _propagate_motions(self.inertia, q[1:], rate[1:], -dt / steps, steps)
        ]
        share = (np.arange(steps + 1) / steps)[:, None, None]
        turn = rotation_between(ahead[0], behind[0])
        attitudes = multiply(ahead[0], quaternion_from_rotation_vector(share * turn))
        rates = (1 - share) * ahead[1] + share * behind[1]
        # the centre of mass moves on a straight line: r_k + v_k s dt and r_k+1 - v_k+1 (1 - s) dt
        moved = share * dt[:, None]
        places = (1 - share) * (position[:-1] + self._velocity[:-1] * moved)
        places = places + share * (position[1:] - self._velocity[1:] * (dt[:, None] - moved))
        times = time[:-1] + share[..., 0] * dt
        self._time = _in_order(times, time[-1:])
        self._rates = _in_order(rates, rate[-1:])
        self._poses = CameraTrajectory(
            self._time, np.hstack([_in_order(places, position[-1:]), _in_order(attitudes, q[-1:])])
        )


def _in_order(block: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Samples (s, n, ...) interval by interval, each without its last one, which begins the next, and the last of all."""
    rows = np.swapaxes(block[:-1], 0, 1)
    return np.concatenate([rows.reshape(-1, *block.shape[2:]), last])


def _propagate_motions(
    J: Float[np.ndarray, "3 3"], q: np.ndarray, w: np.ndarray, dt: np.ndarray, steps: int
) -> tuple[Float[np.ndarray, "s n 4"], Float[np.ndarray, "s n 3"]]:
    """Torque-free attitudes and rates of many motions after 0 to ``steps`` steps of their own length dt, s.

    The rate by a Runge-Kutta step of Euler's equation, the attitude by the mean rate of the step: w = (w0 + 4 w_half + w1) / 6.
    """
    h = dt[:, None]

    def derivative(rate: np.ndarray) -> np.ndarray:
        return np.linalg.solve(J, np.cross(rate @ J, rate).T).T

    attitudes, rates = [q], [w]
    for _ in range(steps):
        k1 = derivative(w)
        k2 = derivative(w + h / 2 * k1)
        k3 = derivative(w + h / 2 * k2)
        k4 = derivative(w + h * k3)
        middle = w + h / 4 * (k1 + k2)
        after = w + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        mean = (w + 4 * middle + after) / 6
        q, w = multiply(q, quaternion_from_rotation_vector(h * mean)), after
        attitudes.append(q)
        rates.append(w)
    return np.stack(attitudes), np.stack(rates)
