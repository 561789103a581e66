"""Right-hand sides of every error that the models may have, about a smoothed motion.

Each function takes the motion and gives whitened rows per unit of the error, a column per component; None where the error does not
apply. The order is that of a recording: what moves the body, what a clock, a gyro or a tracker adds, and what a camera does. The
table `alternatives` says of each what it is, how large it may be and what to do about it.
"""

from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.polynomial.legendre import legvander

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.camera_trajectory import Displacement, levered
from spinfilters.core.linear_algebra import at_times
from spinfilters.io.consider_parameter import ConsiderParameter
from spinfilters.io.sensor_format import sensor_format
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.state_blocks import ATTITUDE, POSITION, VELOCITY
from spinfilters.verdict.model_errors.linear_rows import Columns
from spinfilters.verdict.model_errors.smoothed_motion import (
    RIGHT,
    KnownCamera,
    MeasuredRows,
    Shift,
    SmoothedMotion,
    U,
    V,
    centred_time,
    displaced_camera,
)

SHEARS: Final = np.array(
    [
        [[0, 1, 0], [1, 0, 0], [0, 0, 0]],
        [[0, 0, 1], [0, 0, 0], [1, 0, 0]],
        [[0, 0, 0], [0, 0, 1], [0, 1, 0]],
        [[1, 0, 0], [0, -1, 0], [0, 0, 0]],
        [[0, 0, 0], [0, 1, 0], [0, 0, -1]],
    ],
    dtype=float,
)
"""Basis of the symmetric matrices without trace."""
CHANGES: Final = np.concatenate([SHEARS, np.eye(3)[np.newaxis]])
"""Basis of the symmetric matrices; the last one brakes the rotation as drag does."""


class Drive(NamedTuple):
    """Angular acceleration of an error of a size, in addition to that of the state.

    Attributes
    ----------
    angular : (k, 3) float array
        rad/s^2, g axes.
    by_size : (k, 3, m) float array
        Its derivative by the size.
    """

    angular: Float[np.ndarray, "k 3"]
    by_size: Float[np.ndarray, "k 3 m"]


# Forces and torques


def constant_acceleration(motion: SmoothedMotion) -> Columns | None:
    """v' gains a constant, i axes."""
    if not motion.translates:
        return None
    return motion.disturbed(linear=np.tile(np.eye(3), (len(motion.time), 1, 1)))


def air_resistance(motion: SmoothedMotion) -> Columns | None:
    """v' loses k |v| v."""
    if not motion.translates:
        return None
    v = motion.block(VELOCITY.name)
    return motion.disturbed(linear=-(np.linalg.norm(v, axis=1, keepdims=True) * v)[:, :, None])


SHARE, FEWEST = 0.05, 2
"""Of the epochs within which a contact ends or begins, and how many they are at least."""
MOST_SHARE = 0.25
"""Of a recording: a touch for longer is a constant force or torque."""


def contact_at_begin(motion: SmoothedMotion) -> Columns | None:
    """A constant force and torque in the first epochs."""
    return _contact(motion, at_end=False)


def contact_at_end(motion: SmoothedMotion) -> Columns | None:
    """A constant force and torque in the last epochs."""
    return _contact(motion, at_end=True)


def _contact(motion: SmoothedMotion, at_end: bool) -> Columns | None:
    count = max(FEWEST, round(SHARE * len(motion.time)))
    if count > MOST_SHARE * len(motion.time):
        return None
    touched = np.zeros(len(motion.time))
    touched[-count:] += at_end
    touched[:count] += not at_end
    each = touched[:, None, None] * np.eye(3)
    none = np.zeros_like(each)
    if not motion.translates:
        return motion.disturbed(angular=each)
    return motion.disturbed(
        angular=np.concatenate([each, none], axis=2), linear=np.concatenate([none, each], axis=2)
    )


def drag(motion: SmoothedMotion) -> Columns:
    """w' loses d |w| w."""
    speed = np.linalg.norm(motion.rates, axis=1, keepdims=True)
    return motion.disturbed(angular=-(speed * motion.rates)[:, :, None])


def constant_torque(motion: SmoothedMotion) -> Columns:
    """w' gains a constant, g axes."""
    return motion.disturbed(angular=np.tile(np.eye(3), (len(motion.time), 1, 1)))


# Bodies with moving parts


def hinge(motion: SmoothedMotion) -> Columns:
    """Linear change of the inertia over time, as of a hinge, to first order (`hinge_drive`).

    Without the change that brakes the rotation as drag does.
    """
    return motion.disturbed(angular=hinge_drive(motion, np.zeros(len(SHEARS))).by_size)


def hinge_drive(motion: SmoothedMotion, size: Float[np.ndarray, " m"]) -> Drive:
    """What a linear change of the inertia over time adds to w'.

    K = J + s D, with D = J^1/2 B J^1/2 and s from -1 to 1; B is symmetric, of the coefficients ``size`` of the first of `CHANGES`.
    With K for J

        w' = K^-1 ((K w) x w - s' D w),      dw'/dB = K^-1 (s (D_B w) x w - s D_B w' - s' D_B w).

    What is constant is of the body's own shape.
    """
    J, w = motion.inertia, motion.rates
    half = (motion.time[-1] - motion.time[0]) / 2
    s = ((motion.time - motion.time[0]) / half - 1)[:, None]
    values, axes = np.linalg.eigh(J)
    root = axes * np.sqrt(values) @ axes.T
    parts = root @ CHANGES[: len(size)] @ root
    D = np.tensordot(size, parts, axes=1)
    K = J + s[:, :, None] * D
    # the rates change by what the state holds, and by what K adds to J
    added = np.cross(w @ D, w) * s - w @ D / half - s * motion.rate_change @ D
    added = np.linalg.solve(K, added[:, :, None])[:, :, 0]
    change = motion.rate_change + added
    gained = [s * (np.cross(w @ part, w) - change @ part) - w @ part / half for part in parts]
    return Drive(added, np.linalg.solve(K, np.stack(gained, axis=2)))


def energy_loss(motion: SmoothedMotion) -> Columns:
    """Energy dissipation at constant angular momentum: J w' loses k |h| (w less its part along h)."""
    momentum = motion.rates @ motion.inertia
    size = np.linalg.norm(momentum, axis=1, keepdims=True)
    along = momentum / np.maximum(size, np.finfo(float).tiny)
    across = motion.rates - along * np.einsum("ki,ki->k", along, motion.rates)[:, None]
    lost = np.linalg.solve(motion.inertia, (size * across).T).T
    return motion.disturbed(angular=-lost[:, :, None])


def flywheel(motion: SmoothedMotion) -> Columns:
    """Constant angular momentum h of a flywheel inside: J w' gains h x w; h in units of J times rad/s.

    What of it the moments take up leaves no residual: h along a spin about a principal axis is such a part, for there J w + h is
    the J' w of another body.
    """
    cross = np.cross(np.eye(3)[:, None], motion.rates[None])  # h along each axis, epoch
    gained = np.linalg.solve(motion.inertia, np.moveaxis(cross, 0, 2))
    return motion.disturbed(angular=gained)


# Clocks


def clock_jitter(motion: SmoothedMotion) -> Columns | None:
    """Every epoch is late by a time of its own."""
    return motion.in_time(lambda model: np.ones((len(motion.time), 1)))


def keeps_order(size: Float[np.ndarray, " m"], motion: SmoothedMotion) -> bool:
    """Whether stamps with jitter of this size stay in order: less than an interval."""
    return bool(size[0] < np.median(np.diff(motion.time)))


def clock_drift(motion: SmoothedMotion) -> Columns | None:
    """Linear clock drift: epochs are late by the square of the time from the middle, in units of its span."""
    span = motion.time[-1] - motion.time[0]
    late = 4 * ((motion.time - motion.time.mean()) / span) ** 2
    return motion.in_time(lambda model: late[:, None])


def runs_forward(size: Float[np.ndarray, " m"], motion: SmoothedMotion) -> bool:
    """Whether a clock that drifts by this size runs forward at both ends."""
    return bool(abs(size[0]) < (motion.time[-1] - motion.time[0]) / 4)


def sensor_delay(motion: SmoothedMotion) -> Columns | None:
    """All measurements of a sensor are late against those of the last one: a column per sensor but that."""
    names = list(dict.fromkeys(each.model.name for each in motion.measured))
    if len(names) < 2:
        return None

    def late(model: MeasurementModel) -> Float[np.ndarray, "k m"]:
        """Delay of a sensor's measurements, s per unit."""
        own = np.zeros((len(motion.time), len(names) - 1))
        number = names.index(model.name)
        own[:, number : number + 1] = 1.0  # of the last there is no column
        return own

    return motion.in_time(late)


# Gyros


def gyro_bias(motion: SmoothedMotion) -> Columns | None:
    """w reads w + b."""
    return _of_gyros(motion, np.tile(np.eye(3), (len(motion.time), 1, 1)))


def gyro_drift(motion: SmoothedMotion) -> Columns | None:
    """Linear drift of the gyro bias: w reads w + b s, with s from -1 at the begin to 1 in the end."""
    time = motion.time
    share = (2 * time - time[0] - time[-1]) / (time[-1] - time[0])
    return _of_gyros(motion, share[:, None, None] * np.eye(3))


def gyro_scale(motion: SmoothedMotion) -> Columns | None:
    """w reads (1 + k) w."""
    return _of_gyros(motion, motion.rates[:, :, None])


def gyro_misalignment(motion: SmoothedMotion) -> Columns | None:
    """w reads (I + M) w, M symmetric and traceless.

    Non-orthogonal axes and different scales; an alignment as a whole is one of frame g.
    """
    return _of_gyros(motion, np.einsum("mij,kj->kim", SHEARS, motion.rates))


def gyro_low_pass(motion: SmoothedMotion) -> Columns | None:
    """Low-pass filter of the gyro: w reads w + tau^2 w'' / 2.

    Amplitudes fall with the square of the frequency; its lag is a shift of time.
    """
    return _of_gyros(motion, np.gradient(motion.rate_change, motion.time, axis=0)[:, :, None] / 2)


def _of_gyros(motion: SmoothedMotion, change: Float[np.ndarray, "k 3 m"]) -> Columns | None:
    """Right-hand sides of gyros that read rates changed by so much, g axes."""
    return motion.shifted(lambda each: change[each.epoch] if each.model.reads_rate else None)


# Trackers that give poses


def position_delay(motion: SmoothedMotion) -> Columns | None:
    """Positions are later than the attitudes of the same rows.

    As of a tracker that filters both, or joins two of its parts.
    """
    if not motion.translates:
        return None
    velocity = motion.change[:, motion.rows.problem.layout.slice(POSITION.name)]
    return _of_positions(motion, velocity[:, :, None])


def point_drift(motion: SmoothedMotion) -> Columns | None:
    """The tracked point moves evenly in the body, or the centre of mass does.

    As of a marker that slips, a tracker whose model of the body creeps, or a load that moves inside. Its size is the way from the
    first epoch to the last, g axes.
    """
    if not motion.translates:
        return None
    since = (motion.time - motion.time[0]) / (motion.time[-1] - motion.time[0])
    turned = matrix_from_quaternion(motion.block(ATTITUDE.name))
    return _of_positions(motion, since[:, None, None] * turned)


def _of_positions(motion: SmoothedMotion, moved: Float[np.ndarray, "k 3 m"]) -> Columns | None:
    """Right-hand sides of poses whose positions alone move by so much, i axes."""

    def shift(each: MeasuredRows) -> Float[np.ndarray, "r i m"] | None:
        """Change of the innovations; None of what is no pose."""
        positions = sensor_format(each.model.name).quaternion
        if not positions:
            return None
        found = np.zeros((len(each.epoch), each.model.dim, moved.shape[2]))
        found[:, :positions] = moved[each.epoch]
        return found

    return motion.shifted(shift)


# Images: changes of the observations in px


def camera_shake(motion: SmoothedMotion) -> Columns | None:
    """All observations of an image have a shift of u and v in common."""

    def shift(each: MeasuredRows) -> Float[np.ndarray, "r i m"]:
        by = np.zeros((len(each.epoch), each.model.dim, 2))
        by[:, U, 0] = by[:, V, 1] = 1.0
        if each.model.dim > RIGHT:
            by[:, RIGHT, 0] = 1.0
        return by

    return _of_images(motion, shift)


def distortion(motion: SmoothedMotion) -> Columns | None:
    """Radial distortion of every camera that the calibration lacks: x' = x (1 + k r^2)."""

    def shift(each: MeasuredRows) -> Float[np.ndarray, "r i m"]:
        xy, focal = each.image
        squares = xy**2
        # squared distances from the principal points, of the right camera in the row of the left one
        radius = np.stack([squares[:, k] + squares[:, V] for k in [U, U, RIGHT][: xy.shape[1]]], axis=1)
        return (focal * xy * radius)[:, :, None]

    return _of_images(motion, shift)


def right_camera_turned(motion: SmoothedMotion) -> Columns | None:
    """Yaw, pitch and roll of the right camera, rad, as far as they move its columns."""

    def shift(each: MeasuredRows) -> Float[np.ndarray, "r i m"]:
        xy, focal = each.image
        x, y, f = xy[:, RIGHT], xy[:, V], focal[:, U]
        by = np.zeros((len(x), each.model.dim, 3))
        by[:, RIGHT, 0], by[:, RIGHT, 1], by[:, RIGHT, 2] = f * (1 + x * x), f * x * y, f * y
        return by

    return _of_images(motion, shift, cameras=2)


def right_camera_late(motion: SmoothedMotion) -> Columns | None:
    """The right image is taken later than the left one: u_right moves with the image during the delay."""

    def shift(each: MeasuredRows) -> Float[np.ndarray, "r i m"]:
        used = each.whitening[:, 0, 0] > 0  # of a lower triangle, zero of what does not count
        counts = slice(None) if used.all() else used
        by = np.zeros((*each.change.shape, 1))
        by[counts, RIGHT, 0] = _solve_lower(each.whitening[counts], each.change[counts])[:, RIGHT]
        return by

    return _of_images(motion, shift, cameras=2)


def _of_images(motion: SmoothedMotion, shift: Shift, cameras: int = 1) -> Columns | None:
    """Right-hand sides of observations by at least so many cameras at once that an error shifts."""
    return motion.shifted(lambda each: shift(each) if each.model.images >= cameras else None)


def _solve_lower(
    lower: Float[np.ndarray, "r i i"], right: Float[np.ndarray, "r i"]
) -> Float[np.ndarray, "r i"]:
    """Solutions of many small lower triangular systems by forward substitution."""
    found = np.empty_like(right)
    for i in range(right.shape[1]):
        known = np.einsum("rj,rj->r", lower[:, i, :i], found[:, :i])
        found[:, i] = (right[:, i] - known) / lower[:, i, i]
    return found


def of_calibration(motion: SmoothedMotion, parameter: ConsiderParameter) -> Columns | None:
    """Error of a calibration that estimates consider: the data are of a larger number than they are read with."""

    def shift(each: MeasuredRows) -> Float[np.ndarray, "r i m"] | None:
        by = each.by_calibration(parameter)
        return None if by is None else -by

    return motion.shifted(shift)


def of_baseline(motion: SmoothedMotion, parameter: ConsiderParameter) -> Columns | None:
    """Relative error of the baseline: the pixels of a longer one, and the motion in its unit."""
    measured = of_calibration(motion, parameter)
    return None if measured is None else motion.scaling(measured)


# Moving cameras

DEGREE, HIGHEST_DEGREE = 4, 14
"""Of the polynomials in time of a camera that moves; the latter where the motion is beyond its disturbances, as before a camera
that swings some times. Places of degree 1 are a velocity of the body."""
BEYOND: Final = 2.0
"""Mean square of the whitened steps from which the motion is beyond its disturbances."""


def of_inspector(motion: SmoothedMotion, displacement: Displacement) -> Columns | None:
    """All poses of a moving camera are displaced; None of a camera at rest."""
    camera = KnownCamera.of(motion)
    if camera is None or not camera.moves:
        return None
    return displaced_camera(motion, displacement, camera)


def of_lever(motion: SmoothedMotion) -> Columns | None:
    """A lever arm from the point of the given poses to the camera, its axes, m.

    The estimated motion moves with it: t_k by R_k l less the first, which is a shift of frame i, and v_k by the change of that.
    Images are then as they were, and the lever is seen by the forces that such a path needs. Relative to a motion that stays, the
    states would follow the lever nearly, as a body can move on a circle too, and leave too little of it to tell it from rounding.
    """
    measured = of_inspector(motion, levered_since_first)
    camera = KnownCamera.of(motion)
    if measured is None or camera is None:
        return None
    layout, ordering = motion.rows.problem.layout, motion.rows.problem.ordering
    seen = motion.time[camera.seen]
    lever = levered_since_first(seen, camera.poses[camera.seen])[:, :3].reshape(len(seen), 9)
    # between epochs in which it sees nothing it is somewhere: any path of the states leaves the error what it is
    place = at_times(motion.time, seen, lever)
    states = np.zeros((len(motion.time), layout.error_dim, 3))
    states[:, layout.slice(POSITION.name)] = -place.reshape(-1, 3, 3)
    states[:, layout.slice(VELOCITY.name)] = -np.gradient(place, motion.time, axis=0).reshape(-1, 3, 3)
    return motion.rows.less_states(measured, states[:, ordering.moving])


def levered_since_first(
    time: Float[np.ndarray, " k"], poses: Float[np.ndarray, "k 7"]
) -> Float[np.ndarray, "k 6 3"]:
    """Displacement by a lever less the first, which is a shift of frame i."""
    found = levered(time, poses)
    return found - found[0]


def inspector_missing(motion: SmoothedMotion) -> Columns | None:
    """The camera moves smoothly, and no trajectory is given.

    Polynomials in time of its attitude, then of its place, whose first frame is i; None where a trajectory is given.
    """
    camera = KnownCamera.of(motion)
    if camera is None or camera.moves:
        return None
    steps = motion.rows.left.steps
    degree = HIGHEST_DEGREE if float(np.mean(steps**2)) > BEYOND else DEGREE
    return displaced_camera(motion, smooth_paths(degree), camera)


def smooth_paths(degree: int) -> Displacement:
    """Legendre polynomials of every axis, zero at the first time."""

    def displacement(
        time: Float[np.ndarray, " k"], poses: Float[np.ndarray, "k 7"]
    ) -> Float[np.ndarray, "k 6 m"]:
        """Attitudes of all degrees, then places of those that are no velocity."""
        values = legvander(centred_time(time), degree)
        values = values - values[0]
        turns, places = np.eye(6)[:, 3:], np.eye(6)[:, :3]
        return np.concatenate(
            [np.kron(values[:, None, 1:], turns), np.kron(values[:, None, 2:], places)], axis=2
        )

    return displacement
